"""What to measure next: the plan of a problem, whose task says where the arm may go and what it is for."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import get_args

import numpy as np

from posture_opt.collision.scene import Scene
from posture_opt.errors import InputError, InsufficientDataError, Issue, NoSolutionError
from posture_opt.experiments.candidate_postures import ANYWHERE, Box, Workspace
from posture_opt.experiments.change_information import change_information, change_model, change_prior
from posture_opt.experiments.expected_errors import ExpectedErrors, PriorInformation, Unknowns
from posture_opt.experiments.information import (
    GivenInformation,
    MeasurementModel,
    given_information,
    measurement_model,
    nothing_measured,
    repeat_variance,
)
from posture_opt.experiments.kind_workspace import KindWorkspace
from posture_opt.experiments.measurement_plan import MeasurementPlan, Purpose, SecondJoint, Target
from posture_opt.experiments.plan_search import PlanSearch, shortest_tour
from posture_opt.interrupts import interruptible
from posture_opt.limits import MOST_CANDIDATES, MOST_PLANNED
from posture_opt.measurements.kinds.pose_columns import ORIENTATION
from posture_opt.measurements.measurements import Measurements, nominal_poses
from posture_opt.numerics import Array, Progress
from posture_opt.selection.answer.fallbacks import with_fallbacks
from posture_opt.selection.problem_data import ProblemData
from posture_opt.selection.select_posture import planned_posture
from posture_opt.selection.terms.limit_margin import LimitMargin
from posture_opt.selection.terms.link_height import LinkHeight
from posture_opt.statements import Statement, state
from posture_opt.workers import Executor, Serial, Workers, opened

_RANDOM_PLANS = 21  # random plans of the same size that the chosen one is compared with
_MAX_SHOWN_POINTS = 1500  # random postures that are kept to be drawn


@interruptible()
def plan_measurements(
    problem: ProblemData,
    count: int,
    *,
    given: Measurements | None = None,
    purpose: Purpose = "parameters",
    seed: int | None = None,
    link_height: float | None = None,
    within: Box | None = None,
    repeats: int = 1,
    candidates: int = 2000,
    workers: int = 1,
    executor: Executor | None = None,
    progress: Progress | None = None,
) -> MeasurementPlan:
    """The ``count`` postures whose measurement adds most information, on top of what is known already.

    For ``parameters`` the determinant of their covariance is made smallest (D-optimal); for ``task`` the variance of
    the tool point at the task's best posture, along the directions that count there: ``trace(B J C Jᵀ Bᵀ)``
    (L-optimal), B (t, 3) those directions, J the Jacobian by the parameters, C their covariance; for ``recheck`` the
    determinant of what may have changed on a calibrated arm, each change of a size that is worth telling.
    Stated σ's, and the tolerance of what has none, count as knowledge as they do in ``calibrate``.

    Postures keep to the joint limits (by 2° and 2 mm at least, or by the task's ``limit_margin``), to one turn of a
    joint that has more, above the task's ``link_height`` with links and tool point, off the arm itself and the
    cell's obstacles; any two are 20° or 50 mm apart in some joint where there is room for it.

    Args:
        given: measurements made already.
        seed: of the candidates and starts; the same seed, the same plan; 0 by default.
        link_height: in place of the task's [m].
        within: lower and upper corner (3,) of where the tool point may go, world [m]: what the instrument sees, say.
        repeats: of each posture, in rounds.
        candidates: random postures to choose from.
        workers: processes that share the starts of the search; the plan does not depend on it.
        executor: of `concurrent.futures`, or a Dask client, to share them instead; it stays open.
        progress: called with (done, total) rounds of the search.

    Returns:
        ``MeasurementPlan``: ``q`` (count, n) [rad or m] in the order of least travel, and the expected standard
        errors [m, rad].

    Raises:
        InputError: no postures asked for, or too few for a calibration; no task to plan for.
        InsufficientDataError: nothing can be determined by measuring this arm.
        NoSolutionError: no posture is allowed, or the task has none.

    Example:
        >>> import posture_opt as po
        >>> problem = po.load_problem("insert_planar_2r_measured")
        >>> plan = po.plan_measurements(problem, count=6, candidates=100)
        >>> plan.q.shape, bool(plan.gain >= 1)  # random postures have larger standard errors
        ((6, 2), True)
    """
    if count < 1:
        raise InputError(Issue(f"{count} postures are no plan", ("--count",), count, "plan at least 1"))
    MOST_PLANNED.check_at(count, ("--count",))
    MOST_CANDIDATES.check_at(candidates, ("--candidates",))
    if repeats < 1:
        raise InputError(
            Issue(f"{repeats} repeats are none", ("--repeats",), repeats, "measure each posture at least once")
        )
    if purpose not in get_args(Purpose):
        raise InputError(
            Issue(f"a plan for '{purpose}' is not known", ("--for",), purpose, "parameters, task or recheck")
        )
    with opened(workers, executor) as pool:

        def planned(one: ProblemData) -> MeasurementPlan:
            """The plan for a problem, by the workers."""
            height, margin = stated_bounds(one)
            height = height if link_height is None else link_height
            scene = Scene.of(one.robot, one.cell, guessed=True, without_mounting=one.without_mounting)
            workspace = Workspace.of(one.robot, scene, height=height, margin=margin, box=within or ANYWHERE)
            target, remarks = _planned_target(one, needed=purpose == "task")
            floored = height > -math.inf or (within is not None and within[0][2] > -math.inf)
            floored = floored or workspace.scene.plane is not None or not _least_height(one)
            remarks += (state("experiments.no-tool"),) * (given is None and _at_flange(one))
            return plan_postures(
                one, workspace, count, given=given, purpose=purpose, target=target, seed=seed or 0,
                candidates=candidates, repeats=repeats, keeps_height=floored, remarks=remarks, workers=pool,
                progress=progress,
            )  # fmt: skip

        return with_fallbacks(problem, planned)


def stated_bounds(problem: ProblemData) -> tuple[float, float]:
    """The least height of the links [m] and the least margin to the limits [rad] that the task states."""
    terms = problem.task.subject_to if problem.task is not None else ()
    heights = [term.at_least for term in terms if isinstance(term, LinkHeight)]
    margins = [term.at_least for term in terms if isinstance(term, LimitMargin)]
    return max(heights, default=-math.inf), max(margins, default=0.0)


def _least_height(problem: ProblemData) -> bool:
    """Whether some joint can change the height of what is behind it."""
    rng = np.random.default_rng(0)
    workspace = Workspace.of(problem.robot, Scene.of(problem.robot, None))
    points, _ = nominal_poses(problem.robot, rng.uniform(workspace.lower, workspace.upper, (32, problem.robot.n)))
    return bool(np.ptp(points[:, 2]) > 1e-9)


def _at_flange(problem: ProblemData) -> bool:
    """Whether the tool is free and no offset of it is stated: the plan takes the flange for the tool point."""
    return problem.robot.tool_free and not any(f.nominal for f in problem.robot.tool if f.kind == "translate")


def _planned_target(problem: ProblemData, needed: bool) -> tuple[Target | None, tuple[Statement, ...]]:
    """The task's best posture; where none is needed, its lack is only remarked on.

    Raises:
        InputError: a task is needed and the problem has none.
        NoSolutionError: a task is needed and has no posture.
    """
    if problem.task is None and not needed:
        return None, ()
    if problem.task is None:
        hint = "add task: {kind: insert, position: [...]}, or plan for parameters"
        raise InputError(Issue("the problem states no task to plan for", ("task",), hint=hint))
    try:
        solution = planned_posture(problem)
        if solution.status == "infeasible":
            raise NoSolutionError("the task has no posture")
    except (InputError, NoSolutionError) as error:
        if needed:
            raise
        why = error.issues[0].message if isinstance(error, InputError) else str(error).splitlines()[0]
        return None, (state("experiments.task-posture-unknown", reason=why),)
    return Target(np.array(solution.q), solution.basis.T, solution.optimisation_problem.task.within), ()


def plan_postures(
    problem: ProblemData, workspace: Workspace, count: int, *, given: Measurements | None, purpose: Purpose,
    target: Target | None, seed: int, candidates: int, repeats: int = 1, keeps_height: bool = True,
    remarks: tuple[Statement, ...] = (), workers: Workers | None = None, progress: Progress | None = None,
) -> MeasurementPlan:  # fmt: skip
    """The ``count`` postures that add most information, by exchange among random candidates and postures near them.

    The random plans it is compared with are drawn from the same candidates (`_RANDOM_PLANS` of them).

    Raises:
        InputError: fewer postures than a calibration needs.
        InsufficientDataError: no parameter can be determined by this instrument.
        NoSolutionError: hardly any posture is allowed.
    """
    rng = np.random.default_rng(seed)
    measuring, assumed = measurement_model(problem, given, repeats)
    if measuring.places is not None:
        workspace = KindWorkspace.around(workspace, measuring.places)
    pool, share = workspace.postures(max(candidates, 2 * count), rng)
    n = problem.robot.n
    variance = repeat_variance(problem, measuring.residuals.sigma, pool[:, :n])
    if purpose == "recheck":
        measuring = change_model(problem, measuring, pool)
        known = change_information(measuring, given, variance)
    else:
        known = _information_given(problem, given, measuring, variance)
    rows = np.zeros((0, len(known.x))) if target is None else measuring.tool_rows(target.q, known.x, target.basis)
    J = measuring.blocks(pool, known.x)
    if purpose == "recheck":
        prior = change_prior(problem, measuring, J)
    else:
        prior = PriorInformation.of(problem, measuring.parameters, measuring.made)
    unknowns = Unknowns.of(prior, J, known, rows, count)
    if purpose != "recheck":  # a few postures tell changes apart that they could not all determine together
        _check_count(unknowns, measuring, count)
    search = PlanSearch(measuring, unknowns, unknowns.criterion(purpose), workspace, known.x)
    q, chosen = search.best(pool, J, count, seed, workers or Serial(), progress)
    way = shortest_tour(q, workspace.unit_travel(), workspace.passable)
    q, chosen = q[way.order], chosen[way.order]
    way = replace(way, sides=way.sides[:n])
    random = [J[rng.permutation(len(pool))] for _ in range(_RANDOM_PLANS)]
    equivalent, gain = search.compared(chosen, random)
    residuals = measuring.residuals
    return MeasurementPlan(
        problem=problem, q=q[:, :n], points=nominal_poses(problem.robot, q[:, :n])[0], repeats=repeats, purpose=purpose,
        parameters=measuring.parameters, settled=unknowns.settled, undetermined=unknowns.known.words,
        before=unknowns.before(J), after=unknowns.after(chosen),
        random=ExpectedErrors.median([unknowns.after(drawn[:count]) for drawn in random]), gain=gain,
        equivalent=equivalent,
        tried=len(pool), draws=_RANDOM_PLANS, target=target, tour=way, workspace=workspace, share=share,
        reach=nominal_poses(problem.robot, pool[:_MAX_SHOWN_POINTS, :n])[0], given=given,
        spread=float(np.sqrt(known.variance)),
        sigma=residuals.sigma, sigma_rotation=residuals.further.get(ORIENTATION.key, 0.0),
        axes=tuple(residuals.data.kind.axis_names[i] for i in residuals.axes), targets=measuring.targets,
        columns=_columns(measuring, q), second=_second(measuring, q),
        columns_by_row={} if measuring.places is None else measuring.places.columns_by_row(q),
        keeps_height=keeps_height, notes=tuple(dict.fromkeys((*assumed, *known.notes))), remarks=remarks,
    )  # fmt: skip


def _columns(measuring: MeasurementModel, q: Array) -> dict[str, tuple[str, ...]]:
    """What stands beside the joints of each posture (N, w) in a file of such measurements; nothing of positions."""
    return {} if measuring.places is None else measuring.places.columns(q)


def _second(measuring: MeasurementModel, q: Array) -> tuple[SecondJoint, ...]:
    """The joints of a second arm at each posture (N, w)."""
    if measuring.places is None:
        return ()
    joints = zip(measuring.places.further, measuring.places.second(q).T, strict=True)
    return tuple(SecondJoint(name, joint, own) for (name, joint), own in joints)


def _information_given(
    problem: ProblemData, data: Measurements | None, measuring: MeasurementModel, variance: float
) -> GivenInformation:
    """What the data made already say of the unknowns, or of nothing measured with a coordinate of some ``variance``."""
    if data is None:
        return nothing_measured(len(measuring.parameters), variance)
    return given_information(problem, data, measuring.parameters, variance)


def _check_count(unknowns: Unknowns, measuring: MeasurementModel, count: int) -> None:
    """Refuse where nothing can be determined, and where the postures are too few for a calibration of all that can."""
    if not unknowns.settled.any() or not unknowns.count:
        said = "; ".join(unknowns.known.words[:3])
        what = measuring.residuals.data.kind.noun
        raise InsufficientDataError(f"no parameter can be determined by measuring {what}: {said}")
    short = unknowns.count + 1 - unknowns.given.coordinates
    least = max(int(np.ceil(short / measuring.coordinates / measuring.repeats)), 1)
    if count < least:
        message = f"{count} {'posture is' if count == 1 else 'postures are'} too few for {unknowns.count} unknowns"
        raise InputError(Issue(message, ("--count",), count, f"plan at least {least}, better twice as many"))
