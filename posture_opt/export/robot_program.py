"""``RobotProgram``: stops to drive to and wait at, as every controller's language can say it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from posture_opt import __version__
from posture_opt.errors import NoSolutionError, listed
from posture_opt.export.tool_moves import (
    REDUCED_SPEED,
    Move,
    Stop,
    blocked_legs,
    path_moves,
    runs,
    task_sides,
    with_arrivals,
    with_way,
)
from posture_opt.model.chain import fixed_pose
from posture_opt.numerics import Array
from posture_opt.robot.posture import joints_at_limits
from posture_opt.robot.robot import Robot
from posture_opt.selection.problem_data import ProblemData
from posture_opt.selection.select_posture import Answer
from posture_opt.selection.tasks.path_task import PathTask
from posture_opt.uncertainty.joint_digits import JointDigits, joint_digits

if TYPE_CHECKING:
    from posture_opt.compensation.compensation import Compensation
    from posture_opt.experiments.measurement_plan import MeasurementPlan


@dataclass(frozen=True, eq=False)
class RobotProgram:
    """Stops in their order.

    Args:
        q: (N, n) joint values of the stops [rad or m]; labels: (N,) texts, empty for none.
        speed: percent of what the language takes for full; wait: at every stop [s].
        moves: (N,) how each stop is reached.
        line_speed: of the tool point on lines [m/s]; to and from stops it is no faster than at ``speed``.
        payload: mass at the tool point [kg].
    """

    title: str
    what: str
    robot: Robot
    q: Array
    labels: tuple[str, ...]
    digits: JointDigits
    speed: float = 10.0
    wait: float = 0.0
    notes: tuple[str, ...] = ()
    moves: tuple[Move, ...] = ()
    line_speed: float = REDUCED_SPEED
    payload: float = 0.0

    def __len__(self) -> int:
        return len(self.q)

    @cached_property
    def head(self) -> tuple[str, ...]:
        """The first lines of the program: title, version, convention of the joints, notes."""
        what = f"{self.title}: {self.what}" if self.title else self.what
        convention = "Joint values are those of the joints of the model: its zeros and directions."
        check = "Check that the controller counts the same before the first run."
        return (what, f"Written by posture_opt {__version__}.", convention, check, *self.notes)

    @property
    def has_lines(self) -> bool:
        """Whether the tool moves on a straight line anywhere."""
        return any(move.line for move in self.moves)

    def speed_of(self, move: Move) -> float:
        """Of the tool point on a line [m/s]: a tool plunges to a part and off it at the reduced speed at most."""
        return self.line_speed if move.length is None else min(self.line_speed, REDUCED_SPEED * self.speed / 100)

    @property
    def tool(self) -> Array:
        """(4, 4) the tool point in the flange of the model, lengths in [m]."""
        return fixed_pose(self.robot.tool)

    @property
    def degrees(self) -> list[list[str]]:
        """Joint values as texts, in deg and mm."""
        return self.texts(float(np.pi / 180), 1e-3)

    @property
    def si(self) -> list[list[str]]:
        """Joint values as texts, in rad and m."""
        return self.texts(1.0, 1.0)

    def texts(self, turn: float, slide: float) -> list[list[str]]:
        """Joint values as texts, in units of ``turn`` rad and ``slide`` m."""
        factors = [turn if joint.type == "revolute" else slide for joint in self.robot.joints]
        return [
            [self.digits.text(j, float(v), f) for j, v, f in zip(self.robot.joints, q, factors, strict=True)]
            for q in self.q
        ]


@dataclass(frozen=True)
class MotionRequest:
    """What is asked of a program beside its stops.

    Args:
        wait: at every stop [s].
        approach: distance [m] of a point in front of each stop, or of a path, and of one to retract to; None: what
            `default_approach` says.
    """

    speed: float = 10.0
    wait: float = 0.0
    approach: float | None = None
    with_breaks: bool = False


def default_approach(problem: ProblemData) -> float:
    """50 mm [m], or the length of the held part and the clearance of the cell; zero for tasks that touch nothing."""
    task = problem.task
    if task is None or not (task.touches or task.on_path):
        return 0.0
    part = 0.0 if task.part is None else task.part.length
    return max(0.05, part + problem.scene.margin)


def answer_programs(problem: ProblemData, answer: Answer, asked: MotionRequest) -> list[RobotProgram]:
    """The program of an answer, or one of each part of a path that the arm has to leave."""
    what, answers, labels = _stops(answer)
    on_path, sides = answer.followed is not None, task_sides(problem)
    moves, line_speed = [Move()] * len(answers), REDUCED_SPEED * asked.speed / 100
    if on_path:
        stated = getattr(answer.task, "speed", None)
        line_speed = line_speed if stated is None else answer.law.speed or line_speed
        positions = np.array([problem.arm.position(one.q) for one in answers])
        moves = path_moves(positions, answer.law.lengths, line_speed)
    stops = [Stop(one.q, label, move, sides) for one, label, move in zip(answers, labels, moves, strict=True)]
    backs = [_way_back(one) for one in answers]
    ends = [one.step + 1 for one in answer.breaks] if on_path else []
    if ends and not asked.with_breaks:
        broken = listed(f"{one.first} and {one.last}" for one in answer.breaks)
        hint = "--with-breaks exports the parts of the path"
        raise NoSolutionError(f"no motion leads on between points {broken}: {hint}")
    parts = list(pairwise([0, *ends, len(stops)]))
    one = partial(_program, problem, what, asked=asked, line_speed=line_speed, together=on_path)
    for first, _ in parts:  # driven to joint by joint
        stops[first] = stops[first]._replace(move=replace(stops[first].move, line=False))
    return [one(stops=stops[a:b], backs=backs[a:b]) for a, b in parts]


def _program(
    problem: ProblemData, what: str, *, stops: Sequence[Stop], backs: Sequence[Array], asked: MotionRequest,
    line_speed: float, together: bool,
) -> RobotProgram:  # fmt: skip
    distance = default_approach(problem) if asked.approach is None else asked.approach
    groups = [range(len(stops))] if together else [range(k, k + 1) for k in range(len(stops))]
    rows, notes = list(stops), list[str]()
    if distance > 0:
        of = "the path" if together else "each stop"
        notes = [f"A line of {distance * 1e3:g} mm leads to {of} and off it (--approach)."]
        ways = [with_way(problem, [stops[k] for k in g], (backs[g[0]], backs[g[-1]]), distance) for g in groups]
        rows = [row for found, _ in ways for row in found]
        notes += [note for _, said in ways for note in said]
    rows, said = with_arrivals(problem, rows)
    found = program_of_stops(problem, what, rows, asked)
    return replace(found, notes=(*notes, *said, *found.notes), line_speed=line_speed)


def posture_program(problem: ProblemData, what: str, Q: ArrayLike, labels: Sequence[str], asked: MotionRequest,
                    sides: Array | None = None) -> RobotProgram:  # fmt: skip
    """The program through postures (N, n) [rad or m] that do the task of a problem, approached along the tool axis.

    Args:
        sides: (N, n) as of `Stop`; default: those of the task.
    """
    Q = np.atleast_2d(np.asarray(Q, dtype=float))
    task, given = problem.task, np.tile(task_sides(problem), (len(Q), 1)) if sides is None else sides
    stops = [Stop(q, label, Move(), side) for q, label, side in zip(Q, labels, given, strict=True)]
    axis = np.array([0.0, 0.0, 1.0] if task is None else task.tool_axis)
    backs = [-(np.asarray(problem.arm.pose(q), dtype=float)[:3, :3] @ axis) for q in Q]
    speed = REDUCED_SPEED * asked.speed / 100
    return _program(problem, what, stops=stops, backs=backs, asked=asked, line_speed=speed, together=False)


def program_through(
    problem: ProblemData, what: str, q: ArrayLike, labels: Sequence[str], *, speed: float = 10.0, wait: float = 0.0
) -> RobotProgram:
    """The program that drives through postures (N, n) [rad or m] joint by joint."""
    rows = np.asarray(q, dtype=float)
    stops = [Stop(row, label, Move(), np.zeros(len(row))) for row, label in zip(rows, labels, strict=True)]
    return program_of_stops(problem, what, stops, MotionRequest(speed, wait))


def program_of_stops(problem: ProblemData, what: str, stops: Sequence[Stop], asked: MotionRequest) -> RobotProgram:
    """The program through stops, as they are."""
    rows = np.array([stop.q for stop in stops]).reshape(len(stops), problem.robot.n)
    digits, scene = joint_digits(problem, rows), problem.scene
    mounting = [note] if len(rows) and (note := scene.mounting_note(rows)) else []
    why = "as cell: none says" if scene.switched_off else "as no shape is known"
    bare = [f"Not checked for collisions, {why}: {listed(scene.unchecked)}."] if scene.unchecked else []
    blocked = blocked_legs(problem, stops) if scene.active else []
    which = "to the first stop" if scene.active else "from stop to stop"
    slowly = f"The way {which} is not checked for collisions: drive it slowly the first time."
    way = [slowly] if len(rows) > 1 else []
    way += [f"A straight move of the joints does not keep clear from {listed(blocked)}: add stops on the way."
            for _ in blocked[:1]]  # fmt: skip
    at = joints_at_limits(problem.robot, rows) if len(rows) else []
    limits = [f"At a limit, where controllers seldom let a joint go: {listed(at)}."] if at else []
    carried, moves = float(problem.arm.inputs.payload), tuple(stop.move for stop in stops)
    no_load = "No payload is stated: set the load of tool and part in the controller."
    load = [] if carried or not any(move.line for move in moves) else [no_load]
    return RobotProgram(
        problem.name, what, problem.robot, rows, tuple(stop.label for stop in stops), digits, asked.speed, asked.wait,
        (*mounting, *bare, *limits, *way, *load), moves, REDUCED_SPEED * asked.speed / 100, payload=carried,
    )  # fmt: skip


def _stops(answer: Answer) -> tuple[str, list[Answer], list[str]]:
    if answer.followed is not None:
        labels = np.where(answer.followed.listed, answer.names, "").tolist()
        return "along the path", list(answer.points), labels
    if not answer.points:
        return "the best posture", [answer], [""]
    order = answer.order.order
    names = [answer.names[k] for k in order]
    return "the features, in the order of the least travel", [answer.points[k] for k in order], names


def _way_back(station: Answer) -> Array:
    """(3,) the way back from a stop, world: out of what the tool goes into, or off a path along the tool axis."""
    task = station.problem.task
    if not isinstance(task, PathTask):
        return -station.target.direction
    R = np.asarray(station.problem.arm.pose(station.q), dtype=float)[:3, :3]
    return np.asarray(-(R @ np.array(task.tool_axis)))


def plain(text: str) -> str:
    """A line of printable ASCII: what controllers read as a comment."""
    swapped = text.translate(str.maketrans("–—σ°µ·×", "--sduxx"))
    return "".join(c if " " <= c <= "~" else " " if c.isspace() else "?" for c in swapped)


def compensated_program(
    found: Compensation, speed: float = 10.0, wait: float = 0.0, approach: float | None = None
) -> RobotProgram:
    """The program through compensated targets, in their order, each arrived at from the side that it was found for."""
    problem, labels = found.problem, [f"line {line}" for line in found.targets.line]
    asked = MotionRequest(speed, wait, approach)
    sides = np.where(runs(problem) > 0, found.side, 0.0)
    program = posture_program(problem, "compensated targets", found.q, labels, asked, sides)
    order = "Keep the order of the stops: from another side the joints arrive elsewhere."
    return replace(program, notes=(*((order,) if problem.arm.effects else ()), *program.notes))


def measuring_program(plan: MeasurementPlan, speed: float = 10.0, wait: float = 2.0) -> RobotProgram:
    """The program that visits the postures to measure and waits at each, round by round."""
    labels = [f"posture {k}" for k in range(1, len(plan.q) + 1)]
    if plan.repeats > 1:
        labels = [f"{label}, round {n}" for n in range(1, plan.repeats + 1) for label in labels]
    q = np.tile(plan.q, (plan.repeats, 1))
    return program_through(plan.problem, "postures to measure", q, labels, speed=speed, wait=wait)
