"""``recheck``: whether a calibrated arm is still the one that was calibrated, and if not, what changed."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from posture_opt.changes.hypotheses import PRIOR, Hypotheses, visibilities
from posture_opt.changes.new_rows import NewRows, distinct_rows, log_sum
from posture_opt.changes.what_changed import RIVAL_SHARE, GrossRow, LikelyChange, Recheck, Verdict
from posture_opt.errors import InputError, InsufficientDataError, Issue, NoSolutionError
from posture_opt.experiments.measurement_plan import MeasurementPlan
from posture_opt.experiments.plan_measurements import plan_measurements
from posture_opt.experiments.possible_changes import PossibleChange
from posture_opt.interrupts import interruptible
from posture_opt.measurements.measurements import Measurements
from posture_opt.model.effects import Effect
from posture_opt.numerics import Array, Codes
from posture_opt.selection.problem_data import FittedArm, ProblemData


def changed_problem(problem: ProblemData, change: PossibleChange, estimate: Mapping[str, float]) -> ProblemData:
    """Copy of a problem with the parameters of a change off by ``estimate`` [rad, m or SI of the effect]."""
    header = (f"Rechecked: {change.kind} of {change.target} is as new measurements have it, all else as it was.",)
    if change.effect is None:
        return problem.with_fit(FittedArm("", dict(estimate), header=header))
    effect, entries = change.effect, list(problem.to_dict().get("effects") or [])
    step = [estimate[name] for name in effect.parameter_names]
    known = next(((i, own) for i, own in enumerate(problem.effects) if own.name == effect.name), None)
    if known is None:
        return problem.replace(effects=[*entries, effect.with_estimate(step).to_dict()])
    at, own = known
    assert isinstance(own, Effect)
    total = own.with_estimate([a + b for a, b in zip(own.values, step, strict=True)])
    entries[at] = {**entries[at], "estimate": total.to_dict()["estimate"]}
    return problem.replace(effects=entries)


# Sizes of a gross error in standard deviations of a reading, all alike probable: at 0.05 mm from 1 mm to 1 m.
_SIZES = 20.0 * 4.0 ** np.arange(6)


def without_gross_rows(rows: NewRows) -> tuple[Hypotheses, Codes]:
    """What happened by the rows that do not contradict all others, and the places of these rows.

    A row is gross where ``p(r of the others) N(r of it | 0, s²)`` times the prior of a gross row exceeds the evidence
    of all rows, s on a grid; one at a time, the most contradicting first.
    """
    count = len(rows.residuals.data)
    models, kept = Hypotheses.of(rows), np.arange(count)
    for _ in range(min(count // 5, count - 4)):  # where more contradict the others, it is the arm
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
    order = np.argsort(-size, kind="stable")[:8]
    return np.asarray(kept[order[size[order] > 4.0]])  # standard deviations of a reading: what fits is not gross


def _log_gross(rows: NewRows, kept: Codes, others: Codes) -> float:
    """Log of prior times density of the one row that is not among the others, as a gross one."""
    (row,) = set(kept.tolist()) - set(others.tolist())
    r = _by_row(rows, rows.r)[row]
    logs = -0.5 * float(r @ r) / _SIZES**2 - len(r) * np.log(_SIZES * np.sqrt(2 * np.pi))
    return log_sum(logs) - float(np.log(len(_SIZES))) + float(np.log(PRIOR["gross"] / len(kept)))


def _by_row(rows: NewRows, values: Array) -> Array:
    """Whitened values (m,) of the rows alone, (N, b)."""
    count, block = rows.noise.shape[:2]
    return values[: count * block].reshape(count, block)


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
        InputError: measurements of several robots; no joint, and no frame that is stated.
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
    if postures < 4:  # a shift and a turn of a frame alone have six coordinates
        counted = "1 posture is" if postures == 1 else f"{postures} postures are"
        raise InsufficientDataError(
            f"{counted} too few to tell what changed: measure ten; "
            "'optimize-posture plan-measurements --for recheck --count 10' chooses them"
        )
    rows = distinct_rows(NewRows.of(problem, data))
    if not rows.moving:
        hint = "name the file that calibrate wrote, where the frames are stated"
        raise InputError(Issue("base and tool are free: nothing is left that can have changed", ("robot",), hint=hint))
    models, kept = without_gross_rows(rows)
    used = data.take(kept)
    found = models.probabilities
    verdict, named, shared = verdict_of(models)
    estimates = models.estimates(named)
    shares = found.involved
    first = [*named, *shared]
    order = [*first, *(i for i in np.argsort(-shares, kind="stable").tolist() if i not in first)]
    changes = []
    for i in order:
        mean, motion = estimates[i].mean, models.rows.motion(models.changes[i])
        shift = math.sqrt(max(float(mean @ motion @ mean), 0.0))
        changes.append(LikelyChange(models.changes[i], estimates[i], float(shares[i]), shift))
    asks = verdict in ("several", "unclear") or bool(shared)
    plan, why = _next_postures(problem, used, seed) if asks else (None, "")
    after = _errors(rows, kept, changes[: len(named)])
    left_out = np.setdiff1d(np.arange(len(data)), kept).tolist()
    single = verdict == "changed" and not shared
    updated = changed_problem(problem, changes[0].possible, changes[0].deviations) if single else None
    return Recheck(
        problem=problem, data=used, verdict=verdict, changes=tuple(changes), probabilities=found,
        visible=visibilities(models), errors_before=_errors(rows, kept, ())[kept], errors_after=after[kept],
        gross=tuple(GrossRow(int(data.line[i]), float(np.linalg.norm(after[i]))) for i in left_out),
        named_count=len(named), shared_count=len(shared), updated=updated, plan=plan, unplanned=why,
        notes=rows.notes,
    )  # fmt: skip


def _next_postures(problem: ProblemData, data: Measurements, seed: int | None) -> tuple[MeasurementPlan | None, str]:
    try:
        plan = plan_measurements(problem, 10, given=data, purpose="recheck", seed=seed, candidates=500)
    except (InputError, InsufficientDataError, NoSolutionError) as error:
        return None, str(error).splitlines()[0]
    return plan, ""


def verdict_of(models: Hypotheses) -> tuple[Verdict, tuple[int, ...], tuple[int, ...]]:
    """The verdict, the changes that it names: one, two, or none; and those that share the headline with the one."""
    found = models.probabilities
    if found.unchanged >= 0.5:
        return "unchanged", (), ()
    if found.several > found.one:
        pair = max(found.pairs, key=lambda pair: found.pairs[pair], default=())
        return "several", pair if sum(found.pairs.values()) > found.unexplained else (), ()
    best = int(np.argmax(found.singles))
    shared = _alike(models, best)
    together = float(found.singles[[best, *shared]].sum())
    return ("changed", (best,), shared) if together >= 0.5 else ("unclear", (), ())


def _alike(models: Hypotheses, best: int) -> tuple[int, ...]:
    """What shares the headline with the likeliest change: those from which these postures are not expected to tell it.

    The likeliest, until together they have 80 % of the probability of all of these: of 60 draws of the zeros of an iiwa
    44 are named alone and right, 14 with a rival and one of both is right; with 90 % these are 16 and 43.
    """
    p = models.probabilities.singles
    close = [
        i for i in np.argsort(-p, kind="stable").tolist()
        if i != best and p[i] > RIVAL_SHARE * p[best]
        and models.expected_preference(best, i) < -math.log(RIVAL_SHARE)
    ]  # fmt: skip
    have = np.cumsum(p[[best, *close]])
    return tuple(close[: int(np.searchsorted(have, 0.8 * have[-1]))])


def _errors(rows: NewRows, kept: Codes, changes: Sequence[LikelyChange]) -> Array:
    """(N, 3) position errors of the arm with some changes [m]; 0 where a coordinate was not measured."""
    x = rows.x.copy()
    for change in changes:
        x[rows.columns(change.possible)] += change.estimate.mean
    x = rows.take(kept).with_free(x) if changes else x
    error = np.zeros((len(rows.residuals.data), 3))
    axes = rows.residuals.axes
    error[:, axes] = rows.residuals.error(x)[:, axes]
    return rows.residuals.data.about_points(error)
