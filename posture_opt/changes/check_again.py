"""``recheck``: whether a calibrated arm is still the one that was calibrated, and if not, what changed."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from posture_opt.changes.hypotheses import PRIOR, Hypotheses, visibilities
from posture_opt.changes.new_rows import Estimate, NewRows, distinct_rows, log_sum
from posture_opt.changes.what_changed import RIVAL_SHARE, GrossRow, LikelyChange, Recheck, Verdict
from posture_opt.errors import InputError, InsufficientDataError, NoSolutionError
from posture_opt.experiments.measurement_plan import MeasurementPlan
from posture_opt.experiments.plan_measurements import plan_measurements
from posture_opt.experiments.possible_changes import PossibleChange
from posture_opt.interrupts import interruptible
from posture_opt.measurements.measurements import Measurements
from posture_opt.model.effects import Effect
from posture_opt.numerics import Array, Codes
from posture_opt.selection.fitted_arm import FittedArm
from posture_opt.selection.problem_data import ProblemData


def changed_problem(problem: ProblemData, change: PossibleChange, estimate: Mapping[str, float]) -> ProblemData:
    """The same problem with the parameters of a change off by ``estimate`` [rad, m or SI of the effect]."""
    header = (f"Rechecked: {change.kind} of {change.target} is as new measurements have it, all else as it was.",)
    if change.effect is None:
        return problem.with_fit(FittedArm("", dict(estimate), header=header))
    return problem.replace(effects=_with_effect(problem, change.effect, estimate))


def _with_effect(problem: ProblemData, effect: Effect, estimate: Mapping[str, float]) -> list[object]:
    entries = list(problem.to_dict().get("effects") or [])
    names = [known.name for known in problem.effects]
    step = [estimate[name] for name in effect.parameter_names]
    if effect.name not in names:
        return [*entries, effect.with_estimate(step).to_dict()]
    at = names.index(effect.name)
    known = problem.effects[at]
    assert isinstance(known, Effect)
    total = known.with_estimate([a + b for a, b in zip(known.values, step, strict=True)])
    entries[at] = {**entries[at], "estimate": total.to_dict()["estimate"]}
    return entries


# So many rows are left at least.
LEAST_ROWS = 4
# Of the rows: where more contradict the others, it is the arm.
_MOST_SHARE = 0.2
_TRIED = 8  # rows, those of the largest errors, each time
_LEAST_ERROR = 4.0  # standard deviations of a reading: what fits as well is not gross
# Sizes of a gross error in standard deviations of a reading, all alike probable: at 0.05 mm from 1 mm to 1 m.
_SIZES = 20.0 * 4.0 ** np.arange(6)


def without_gross_rows(rows: NewRows) -> tuple[Hypotheses, Codes]:
    """What happened by the rows that do not contradict all others, and the places of these rows.

    A row is gross where ``p(r of the others) N(r of it | 0, s²)`` times the prior of a gross row exceeds the evidence
    of all rows, s on a grid; one at a time, the most contradicting first.
    """
    count = len(rows.residuals.data)
    models, kept = Hypotheses.of(rows), np.arange(count)
    for _ in range(min(int(_MOST_SHARE * count), count - LEAST_ROWS)):
        if models.probabilities.unchanged > models.probabilities.several:
            break
        others = [kept[kept != row] for row in _suspects(models, kept)]
        if not others:
            break
        found = [Hypotheses.of(rows.take(other)) for other in others]
        gains = [m.log_evidence + _log_gross(rows, kept, other) for m, other in zip(found, others, strict=True)]
        best = int(np.argmax(gains))
        if gains[best] <= models.log_evidence:
            break
        models, kept = found[best], others[best]
    return models, kept


def _suspects(models: Hypotheses, kept: Codes) -> Codes:
    best = int(np.argmax(models.log_singles))
    own, estimate = models.own[best][0], models.estimates()[best]
    left = own.r + own.A[:, own.columns(models.changes[best])] @ estimate.mean
    size = np.linalg.norm(_by_row(own, left), axis=1)
    order = np.argsort(-size, kind="stable")[:_TRIED]
    return np.asarray(kept[order[size[order] > _LEAST_ERROR]])


def _log_gross(rows: NewRows, kept: Codes, others: Codes) -> float:
    (row,) = set(kept.tolist()) - set(others.tolist())
    r = _by_row(rows, rows.r)[row]
    logs = -0.5 * float(r @ r) / _SIZES**2 - len(r) * np.log(_SIZES * np.sqrt(2 * np.pi))
    return log_sum(logs) - float(np.log(len(_SIZES))) + float(np.log(PRIOR["gross"] / len(kept)))


def _by_row(rows: NewRows, values: Array) -> Array:
    """Whitened values (m,) of the rows alone, (N, b)."""
    count, block = rows.noise.shape[:2]
    return values[: count * block].reshape(count, block)


# Fewer cannot tell a frame from a joint: a shift and a turn of a frame alone have six coordinates.
LEAST_POSTURES = 4
# Proposed where more than one thing changed, or it is not clear which.
NEXT_POSTURES = 10
_CANDIDATES = 500  # of these postures
_LEAST_PROBABILITY = 0.5  # of a verdict, and of what it names
# Of the probability of changes that the postures cannot tell apart, that the headline holds.  Chosen on 60 draws of
# the zeros of an iiwa: 44 are named alone and right, 14 with a rival and one of both is right; with 0.9 in its place
# these are 16 and 43.
_SURE = 0.8


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
    p = models.probabilities.singles
    close = [
        i for i in np.argsort(-p, kind="stable").tolist()
        if i != best and p[i] > RIVAL_SHARE * p[best]
        and models.expected_preference(best, i) < -math.log(RIVAL_SHARE)
    ]  # fmt: skip
    have = np.cumsum(p[[best, *close]])
    return tuple(close[: int(np.searchsorted(have, _SURE * have[-1]))])


def _change(models: Hypotheses, index: int, estimate: Estimate, probability: float) -> LikelyChange:
    possible = models.changes[index]
    motion = models.rows.motion(possible)
    square = float(estimate.mean @ motion @ estimate.mean)
    shift = math.sqrt(max(square, 0.0))
    return LikelyChange(possible, estimate, probability, shift)


def _errors(rows: NewRows, kept: Codes, changes: tuple[LikelyChange, ...]) -> Array:
    """(N, 3) position errors of the arm with some changes [m]; 0 where a coordinate was not measured."""
    x = rows.x.copy()
    for change in changes:
        x[rows.columns(change.possible)] += change.estimate.mean
    x = rows.take(kept).with_free(x) if changes else x
    error = np.zeros((len(rows.residuals.data), 3))
    axes = rows.residuals.axes
    error[:, axes] = rows.residuals.error(x)[:, axes]
    return rows.residuals.data.about_points(error)
