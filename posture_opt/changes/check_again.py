"""Whether a calibrated arm is still the one that was calibrated, from a few new rows, and if not, what changed."""

from __future__ import annotations

import math

import numpy as np

from posture_opt.changes.changed_arm import changed_problem
from posture_opt.changes.distinct import distinct_rows
from posture_opt.changes.gaussian_evidence import Estimate
from posture_opt.changes.gross_rows import without_gross_rows
from posture_opt.changes.hypotheses import Hypotheses
from posture_opt.changes.new_rows import NewRows
from posture_opt.changes.visibility import visibilities
from posture_opt.changes.what_changed import RIVAL_SHARE, GrossRow, LikelyChange, Recheck, Verdict
from posture_opt.errors import InputError, InsufficientDataError, NoSolutionError
from posture_opt.experiments.measurement_plan import MeasurementPlan
from posture_opt.experiments.plan_measurements import plan_measurements
from posture_opt.interrupts import interruptible
from posture_opt.measurements.measurements import Measurements
from posture_opt.numerics import Array, Codes
from posture_opt.selection.problem_data import ProblemData

LEAST_POSTURES = 4
"""Fewer cannot tell a frame from a joint: a shift and a turn of a frame alone have six coordinates."""
NEXT_POSTURES = 10
"""Proposed where more than one thing changed, or it is not clear which."""
_CANDIDATES = 500  # of these postures
_LEAST_PROBABILITY = 0.5  # of a verdict, and of what it names
_SURE = 0.8
"""Of the probability of changes that the postures cannot tell apart, that the headline holds.

Chosen on 60 draws of the zeros of an iiwa: 44 are named alone and right, 14 with a rival and one of both is right; with
0.9 in its place these are 16 and 43.
"""


@interruptible()
def recheck(problem: ProblemData, data: Measurements, *, seed: int | None = None) -> Recheck:
    """What changed on a calibrated arm since its file was made: nothing, one thing, or more than one.

    The new rows are ``r = J u − A θ + ε`` at the arm of the file, u ~ N(0, C) what the file leaves uncertain of it,
    ε of instrument and scatter. Each change has the prior ``θ ~ N(0, s² M⁻¹)``, M the mean square motion of the tool
    over the rows and s on a grid; models are compared by their exact evidence, ``Bayes factor = p(r | θ) / p(r | 0)``,
    with a sparse prior: one change is likelier than two.

    Args:
        problem: the calibrated arm, with its covariance under ``uncertainty``.
        data: new measurements; 5 to 30 postures are enough, `plan_measurements` for ``recheck`` chooses them.
        seed: of the postures that are proposed where it is not one change, or not clear which; 0 by default.

    Returns:
        ``Recheck``: ``verdict``, and ``changes`` with sizes (SI units, radians) and probabilities, the
        likeliest first.

    Raises:
        InputError: measurements of several robots.
        InsufficientDataError: fewer than four postures.

    Source: Kass, Raftery (1995), Bayes factors; Liang et al. (2008), mixtures of g priors.

    Example:
        >>> import posture_opt as po
        >>> problem = po.load_problem("insert_planar_2r_calibrated")
        >>> q = np.radians([[-60, 30], [-20, 60], [0, 90], [40, 120], [60, 150]])
        >>> x = po.Arm.from_problem(problem).position(q)
        >>> table = {"joint1 [rad]": q[:, 0], "joint2 [rad]": q[:, 1], "x [m]": x[:, 0] + 0.02, "y [m]": x[:, 1]}
        >>> found = po.recheck(problem, po.read_measurements(table, problem))
        >>> found.verdict, found.changes[0].target
        ('changed', 'base')
    """
    postures = len(np.unique(data.q, axis=0))
    if postures < LEAST_POSTURES:
        counted = "1 posture is" if postures == 1 else f"{postures} postures are"
        raise InsufficientDataError(
            f"{counted} too few to tell what changed: measure ten; "
            "'optimize-posture plan-measurements --for recheck --count 10' chooses them"
        )
    rows = distinct_rows(NewRows.of(problem, data))
    models, kept = without_gross_rows(rows)
    used = data.take(kept)
    found = models.probabilities
    verdict, named, shared = verdict_of(models)
    estimates = models.estimates(named)
    shares = found.involved
    first = [*named, *shared]
    order = [*first, *(i for i in np.argsort(-shares, kind="stable").tolist() if i not in first)]
    changes = tuple(_change(models, i, estimates[i], float(shares[i])) for i in order)
    asks = verdict in ("several", "unclear") or bool(shared)
    plan, why = _next_postures(problem, used, seed) if asks else (None, "")
    after = _errors(rows, kept, changes[: len(named)])
    single = verdict == "changed" and not shared
    updated = changed_problem(problem, changes[0].possible, changes[0].deviations) if single else None
    return Recheck(
        problem=problem, data=used, verdict=verdict, changes=changes, probabilities=found,
        visible=visibilities(models), errors_before=_errors(rows, kept, ())[kept], errors_after=after[kept],
        gross=tuple(_gross_row(data, after, i) for i in sorted({*range(len(data))} - {*kept.tolist()})),
        named_count=len(named), shared_count=len(shared), updated=updated, plan=plan, unplanned=why,
        notes=rows.notes,
    )  # fmt: skip


def _gross_row(data: Measurements, errors: Array, row: int) -> GrossRow:
    """A row that is left out, with its error (N, 3) beside all others."""
    return GrossRow(int(data.line[row]), float(np.linalg.norm(errors[row])))


def _next_postures(problem: ProblemData, data: Measurements, seed: int | None) -> tuple[MeasurementPlan | None, str]:
    """The postures that tell changes apart best on top of the rows; none, and why, where none can be planned."""
    try:
        plan = plan_measurements(
            problem, NEXT_POSTURES, given=data, purpose="recheck", seed=seed, candidates=_CANDIDATES
        )
    except (InputError, InsufficientDataError, NoSolutionError) as error:
        return None, str(error).splitlines()[0]
    return plan, ""


def verdict_of(models: Hypotheses) -> tuple[Verdict, tuple[int, ...], tuple[int, ...]]:
    """The verdict, the changes that it names: one, two, or none; and those that share the headline with the one."""
    found = models.probabilities
    if found.unchanged >= _LEAST_PROBABILITY:
        return "unchanged", (), ()
    if found.several > found.one:
        pair = max(found.pairs, key=lambda pair: found.pairs[pair], default=())
        return "several", pair if sum(found.pairs.values()) > found.unexplained else (), ()
    best = int(np.argmax(found.singles))
    shared = _alike(models, best)
    together = float(found.singles[[best, *shared]].sum())
    return ("changed", (best,), shared) if together >= _LEAST_PROBABILITY else ("unclear", (), ())


def _alike(models: Hypotheses, best: int) -> tuple[int, ...]:
    """What shares the headline with the likeliest change.

    Of the changes from which these postures are not expected to tell one of its size (a Bayes factor below twenty), the
    likeliest, until together they have `_SURE` of the probability of all of these.
    """
    p = models.probabilities.singles
    close = [
        i for i in np.argsort(-p, kind="stable").tolist()
        if i != best and p[i] > RIVAL_SHARE * p[best]
        and models.expected_preference(best, i) < -math.log(RIVAL_SHARE)
    ]  # fmt: skip
    have = np.cumsum(p[[best, *close]])
    return tuple(close[: int(np.searchsorted(have, _SURE * have[-1]))])


def _change(models: Hypotheses, index: int, estimate: Estimate, probability: float) -> LikelyChange:
    """One change with what it does to the tool."""
    possible = models.changes[index]
    motion = models.rows.motion(possible)
    square = float(estimate.mean @ motion @ estimate.mean)
    shift = math.sqrt(max(square, 0.0))
    return LikelyChange(possible, estimate, probability, shift)


def _errors(rows: NewRows, kept: Codes, changes: tuple[LikelyChange, ...]) -> Array:
    """(N, 3) position errors of the arm with some changes [m]; 0 where a coordinate was not measured.

    Beside changes, what is free is found again, from the rows that are ``kept``.
    """
    x = rows.x.copy()
    for change in changes:
        x[rows.columns(change.possible)] += change.estimate.mean
    x = rows.take(kept).with_free(x) if changes else x
    error = np.zeros((len(rows.residuals.data), 3))
    axes = rows.residuals.axes
    error[:, axes] = rows.residuals.error(x)[:, axes]
    return rows.residuals.data.about_points(error)
