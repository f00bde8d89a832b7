"""What to measure next: the plan of a problem, whose task says where the arm may go and what it is for."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import get_args

import numpy as np

from posture_opt.collision.scene import Scene
from posture_opt.errors import InputError, InsufficientDataError, Issue, NoSolutionError
from posture_opt.experiments.candidate_postures import ANYWHERE, Box, Workspace, measured_room
from posture_opt.experiments.information import (
    ExpectedErrors,
    MeasurementModel,
    PriorInformation,
    Unknowns,
    given_information,
    measurement_model,
    nothing_measured,
    repeat_variance,
)
from posture_opt.experiments.measurement_plan import MeasurementPlan, Purpose, SecondJoint, Target
from posture_opt.experiments.plan_search import PlanSearch, shortest_tour
from posture_opt.experiments.possible_changes import change_information, change_model, change_prior
from posture_opt.interrupts import interruptible
from posture_opt.limits import MOST_CANDIDATES, MOST_PLANNED
from posture_opt.measurements.kinds.pose import ORIENTATION
from posture_opt.measurements.measurements import Measurements, nominal_poses
from posture_opt.numerics import Array, Progress
from posture_opt.selection.problem_data import ProblemData, with_fallbacks
from posture_opt.selection.select_posture import planned_posture
from posture_opt.selection.terms.arm_terms import LinkHeight
from posture_opt.selection.terms.joint_terms import LimitMargin
from posture_opt.statements import Statement, state
from posture_opt.workers import Executor, Workers, opened

_RANDOM_PLANS = 21  # random plans of the same size that the chosen one is compared with


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
        problem: the arm with its uncertainty, the instrument, and the task if it is planned for.
        count: number of postures, 1 to 200.
        given: measurements made already.
        purpose: ``parameters``, ``task`` or ``recheck``.
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
    purposes = "parameters, task or recheck"
    checks = {
        "--count": (count, count >= 1, f"{count} postures are no plan", "plan at least 1"),
        "--repeats": (repeats, repeats >= 1, f"{repeats} repeats are none", "measure each posture at least once"),
        "--for": (purpose, purpose in get_args(Purpose), f"a plan for '{purpose}' is not known", purposes),
    }
    for option, (value, fits, message, hint) in checks.items():
        if not fits:
            raise InputError(Issue(message, (option,), value, hint))
    MOST_PLANNED.check_at(count, ("--count",))
    MOST_CANDIDATES.check_at(candidates, ("--candidates",))
    with opened(workers, executor) as pool:
        settings = _Settings(count, given, purpose, seed or 0, link_height, within, repeats, candidates, pool, progress)
        return with_fallbacks(problem, settings.plan)


@dataclass(frozen=True, eq=False)
class _Settings:
    count: int
    given: Measurements | None
    purpose: Purpose
    seed: int
    link_height: float | None
    within: Box | None
    repeats: int
    candidates: int
    workers: Workers
    progress: Progress | None

    def workspace(self, problem: ProblemData) -> tuple[Workspace, bool]:
        """Where the arm may go, and whether something keeps it from reaching below the table."""
        terms = problem.task.subject_to if problem.task is not None else ()
        stated = max((term.at_least for term in terms if isinstance(term, LinkHeight)), default=-math.inf)
        margin = max((term.at_least for term in terms if isinstance(term, LimitMargin)), default=0.0)
        height = stated if self.link_height is None else self.link_height
        scene = Scene.of(problem.robot, problem.cell, guessed=True, without_mounting=problem.without_mounting)
        room = measured_room(problem.robot, None if self.given is None else self.given.q)
        found = Workspace.of(room, scene, height=height, margin=margin, box=self.within or ANYWHERE)
        if max(height, -math.inf if self.within is None else self.within[0][2]) > -math.inf or scene.plane is not None:
            return found, True
        free = Workspace.of(room, Scene.of(problem.robot, None))
        points, _ = nominal_poses(problem.robot, free.drawn(np.random.default_rng(0), 32))
        return found, not np.ptp(points[:, 2]) > 1e-9  # no joint can change the height

    def plan(self, problem: ProblemData) -> MeasurementPlan:
        """The plan by exchange among random candidates and postures near them, compared with random plans."""
        given, count, n, robot = self.given, self.count, problem.robot.n, problem.robot
        workspace, keeps_height = self.workspace(problem)
        target, remarks = _planned_target(problem, needed=self.purpose == "task")
        at_flange = robot.tool_free and not any(f.nominal for f in robot.tool if f.kind == "translate")
        remarks += (state("experiments.no-tool"),) * (given is None and at_flange)
        rng = np.random.default_rng(self.seed)
        measuring, assumed = measurement_model(problem, given, self.repeats)
        residuals, places = measuring.residuals, measuring.places
        workspace = replace(workspace, places=places)
        pool, share = workspace.postures(max(self.candidates, 2 * count), rng)
        variance = repeat_variance(problem, residuals.sigma, pool[:, :n])
        measuring, unknowns, J = self._unknowns(problem, measuring, pool, variance, target)
        known = unknowns.given
        search = PlanSearch(measuring, unknowns, unknowns.criterion(self.purpose), workspace, known.x)
        q, chosen = search.best(pool, J, count, self.seed, self.workers, self.progress)
        way = shortest_tour(q, workspace.unit_travel(), workspace.passable)
        q, chosen = q[way.order], chosen[way.order]
        random = [J[rng.permutation(len(pool))] for _ in range(_RANDOM_PLANS)]
        equivalent, gain = search.compared(chosen, random)
        second: tuple[SecondJoint, ...] = ()
        if places is not None:
            joints = zip(places.further, places.second(q).T, strict=True)
            second = tuple(SecondJoint(name, joint, own) for (name, joint), own in joints)
        points, reach = (nominal_poses(robot, rows[:, :n])[0] for rows in (q, pool[:1500]))  # enough to be drawn
        return MeasurementPlan(
            problem=problem, q=q[:, :n], points=points, repeats=self.repeats, purpose=self.purpose,
            parameters=measuring.parameters, settled=unknowns.settled, undetermined=unknowns.known.words,
            before=unknowns.before(J), after=unknowns.after(chosen),
            random=ExpectedErrors.median([unknowns.after(drawn[:count]) for drawn in random]), gain=gain,
            equivalent=equivalent, tried=len(pool), draws=_RANDOM_PLANS, target=target,
            tour=replace(way, sides=way.sides[:n]), workspace=workspace, share=share, reach=reach, given=given,
            spread=float(np.sqrt(known.variance)), sigma=residuals.sigma,
            sigma_rotation=residuals.further.get(ORIENTATION.key, 0.0),
            axes=tuple(residuals.data.kind.axis_names[i] for i in residuals.axes), targets=measuring.targets,
            columns={} if places is None else places.columns(q), second=second,
            columns_by_row={} if places is None else places.columns_by_row(q),
            keeps_height=keeps_height, notes=tuple(dict.fromkeys((*assumed, *known.notes))), remarks=remarks,
        )  # fmt: skip

    def _unknowns(
        self, problem: ProblemData, measuring: MeasurementModel, pool: Array, variance: float, target: Target | None
    ) -> tuple[MeasurementModel, Unknowns, Array]:
        """What the plan is to determine, and derivatives J (N, b, k) at the candidates ``pool`` (N, w)."""
        recheck = self.purpose == "recheck"
        if recheck:
            measuring = change_model(problem, measuring, pool)
            known = change_information(measuring, self.given, variance)
        elif self.given is None:
            known = nothing_measured(len(measuring.parameters), variance)
        else:
            known = given_information(problem, self.given, measuring.parameters, variance)
        rows = np.zeros((0, len(known.x))) if target is None else measuring.tool_rows(target.q, known.x, target.basis)
        J = measuring.blocks(pool, known.x)
        if recheck:
            prior = change_prior(problem, measuring, J)
        else:
            prior = PriorInformation.of(problem, measuring.parameters, measuring.made)
        unknowns = Unknowns.of(prior, J, known, rows, self.count)
        if not recheck:  # a few postures tell changes apart that they could not all determine together
            _check_count(unknowns, measuring, self.count)
        return measuring, unknowns, J


def _planned_target(problem: ProblemData, needed: bool) -> tuple[Target | None, tuple[Statement, ...]]:
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


def _check_count(unknowns: Unknowns, measuring: MeasurementModel, count: int) -> None:
    if not unknowns.settled.any() or not unknowns.count:
        said = "; ".join(unknowns.known.words[:3])
        what = measuring.residuals.data.kind.noun
        raise InsufficientDataError(f"no parameter can be determined by measuring {what}: {said}")
    short = unknowns.count + 1 - unknowns.given.coordinates
    least = max(int(np.ceil(short / measuring.coordinates / measuring.repeats)), 1)
    if count < least:
        message = f"{count} {'posture is' if count == 1 else 'postures are'} too few for {unknowns.count} unknowns"
        raise InputError(Issue(message, ("--count",), count, f"plan at least {least}, better twice as many"))
