"""What to measure next: the plan of a problem, whose task says where the arm may go and what it is for."""

from __future__ import annotations

import math
from typing import get_args

import numpy as np

from posture_opt.errors import InputError, Issue, NoSolutionError
from posture_opt.experiments.candidate_postures import ANYWHERE, Box, Room
from posture_opt.experiments.measurement_plan import MeasurementPlan, Purpose, Target
from posture_opt.experiments.planning import plan
from posture_opt.measurements.measurements import Measurements
from posture_opt.measurements.nominal_points import nominal_poses
from posture_opt.numerics import Progress
from posture_opt.problem.problem import Problem
from posture_opt.selection.selector import select_posture
from posture_opt.selection.terms.limit_margin import LimitMargin
from posture_opt.selection.terms.link_height import LinkHeight

NO_TOOL = (
    "the tool is free and starts at the flange: the plan is better where the measured point is roughly stated "
    "(tool: {xyz: [...], free: true})"
)
NO_TABLE = "nothing says where the table is: the arm may reach below its base (state a link_height)"


def plan_measurements(
    problem: Problem,
    count: int,
    *,
    given: Measurements | None = None,
    purpose: Purpose = "parameters",
    seed: int = 0,
    link_height: float | None = None,
    within: Box | None = None,
    repeats: int = 1,
    candidates: int = 2000,
    progress: Progress | None = None,
) -> MeasurementPlan:
    """The ``count`` postures whose measurement tells most, on top of what is known already.

    For ``parameters`` the determinant of their covariance is made smallest (D-optimal); for ``task`` the variance of
    the tool point at the task's best posture, along the directions that count there: ``trace(B J C Jᵀ Bᵀ)``
    (L-optimal), B (t, 3) those directions, J the Jacobian by the parameters, C their covariance. Stated σ's, and the
    tolerance of what has none, count as knowledge as they do in ``calibrate``.

    Postures keep to the joint limits (by 2° and 2 mm at least, or by the task's ``limit_margin``), to one turn of a
    joint that has more, above the task's ``link_height`` with links and tool point, and off the arm itself; any two
    are 20° or 50 mm apart in some joint where there is room for it.

    Args:
        given: measurements made already.
        seed: of the candidates and starts; the same seed, the same plan.
        link_height: in place of the task's [m].
        within: lower and upper corner (3,) of where the tool point may go, world [m]: what the instrument sees, say.
        repeats: visits to each posture, in rounds.
        candidates: random postures to choose from.
        progress: called with (done, total) rounds of the search.

    Raises:
        InputError: no postures asked for, or too few for a calibration; no task to plan for.
        InsufficientDataError: nothing can be determined by measuring this arm.
        NoSolutionError: no posture is allowed, or the task has none.
    """
    if count < 1:
        raise InputError(Issue(f"{count} postures are no plan", ("--count",), count, "plan at least 1"))
    if repeats < 1:
        raise InputError(
            Issue(f"{repeats} visits are none", ("--repeats",), repeats, "visit each posture at least once")
        )
    if purpose not in get_args(Purpose):
        raise InputError(Issue(f"a plan for '{purpose}' is not known", ("--for",), purpose, "parameters or task"))
    height, margin = bounds(problem)
    height = height if link_height is None else link_height
    room = Room.of(problem.robot, height=height, margin=margin, box=within or ANYWHERE)
    target, notes = _target(problem, needed=purpose == "task")
    notes += (NO_TABLE,) * (height == -math.inf and not (within and within[0][2] > -math.inf) and _upright(problem))
    notes += (NO_TOOL,) * (given is None and _at_flange(problem))
    return plan(
        problem, room, count, given=given, purpose=purpose, target=target, seed=seed, candidates=candidates,
        repeats=repeats,
        notes=notes, progress=progress,
    )  # fmt: skip


def bounds(problem: Problem) -> tuple[float, float]:
    """The least height of the links [m] and the least margin to the limits [rad] that the task states."""
    terms = problem.task.subject_to if problem.task is not None else ()
    heights = [term.at_least for term in terms if isinstance(term, LinkHeight)]
    margins = [term.at_least for term in terms if isinstance(term, LimitMargin)]
    return max(heights, default=-math.inf), max(margins, default=0.0)


def _upright(problem: Problem) -> bool:
    """Whether some joint can change the height of what is behind it."""
    rng = np.random.default_rng(0)
    room = Room.of(problem.robot)
    points, _ = nominal_poses(problem.robot, rng.uniform(room.lower, room.upper, (32, problem.robot.n)))
    return bool(np.ptp(points[:, 2]) > 1e-9)


def _at_flange(problem: Problem) -> bool:
    return problem.robot.tool_free and not any(f.nominal for f in problem.robot.tool if f.kind == "translate")


def _target(problem: Problem, needed: bool) -> tuple[Target | None, tuple[str, ...]]:
    """The task's best posture; where none is needed, its lack is only remarked on."""
    if problem.task is None and not needed:
        return None, ()
    if problem.task is None:
        mend = "add task: {kind: insert, position: [...]}, or plan for parameters"
        raise InputError(Issue("the problem states no task to plan for", ("task",), mend=mend))
    try:
        solution = select_posture(problem)
        if solution.status == "infeasible":
            raise NoSolutionError("the task has no posture")
    except (InputError, NoSolutionError) as error:
        if needed:
            raise
        why = error.issues[0].message if isinstance(error, InputError) else str(error).splitlines()[0]
        return None, (f"the task's posture is not known ({why})",)
    return Target(np.array(solution.q), solution.basis.T, solution.programme.task.within), ()
