"""``RobotProgram``: stops to drive to and wait at, as every controller's language can say it."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from posture_opt import __version__
from posture_opt.errors import listed
from posture_opt.export.fixed_pose import fixed_pose
from posture_opt.export.tool_moves import DEFAULT_APPROACH_M, REDUCED_SPEED, Move, path_moves, with_way
from posture_opt.model.arm import Arm
from posture_opt.numerics import Array
from posture_opt.robot.posture import joints_at_limits
from posture_opt.robot.robot import Robot
from posture_opt.selection.problem_data import ProblemData
from posture_opt.selection.select_posture import Answer, select_posture
from posture_opt.selection.tasks.path_task import PathTask
from posture_opt.uncertainty.spread.joint_digits import JointDigits, joint_digits

CONVENTION = (
    "Joint values are those of the joints of the model: its zeros and directions.",
    "Check that the controller counts the same before the first run.",
)

_UNCHECKED_NOTE = "The way from stop to stop is not checked for collisions: drive it slowly the first time."


@dataclass(frozen=True, eq=False)
class RobotProgram:
    """Stops in their order.

    Args:
        title: of the problem; what: the stops are, in a word.
        robot: whose joints they are of.
        q: (N, n) joint values of the stops [rad or m]; labels: (N,) texts, empty for none.
        digits: what rounding may cost.
        speed: percent of what the language takes for full; wait: at every stop [s].
        notes: sentences for the first lines of the program.
        given_moves: (N,) how each stop is reached; empty: joint by joint, with the wait at each.
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
    given_moves: tuple[Move, ...] = ()
    line_speed: float = REDUCED_SPEED
    payload: float = 0.0

    def __len__(self) -> int:
        return len(self.q)

    @cached_property
    def head(self) -> tuple[str, ...]:
        """The first lines of the program: title, version, convention of the joints, notes."""
        what = f"{self.title}: {self.what}" if self.title else self.what
        return (what, f"Written by posture_opt {__version__}.", *CONVENTION, *self.notes)

    @property
    def moves(self) -> tuple[Move, ...]:
        """(N,) how each stop is reached."""
        return self.given_moves or (Move(),) * len(self)

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


def program_of(
    problem: ProblemData, seed: int | None, workers: int, speed: float, wait: float, approach: float | None = None
) -> RobotProgram:
    """The answer to a problem as a program: its posture, those of its features in order, or the points of its path.

    Raises:
        NoSolutionError, InputError: as of `select_posture`.
    """
    answer = select_posture(problem, seed=seed, workers=workers)
    return answer_program(answer.problem, answer, speed, wait, approach)


def answer_program(
    problem: ProblemData, answer: Answer, speed: float = 10.0, wait: float = 0.0, approach: float | None = None
) -> RobotProgram:
    """The program of an answer that is known: a path on lines, other stops joint by joint.

    Args:
        speed: percent of what the language takes for full; of a path whose task states no speed, of 250 mm/s.
        wait: at every stop [s].
        approach: distance [m] of a point in front of each stop, or of a path, and of one to retract to; None: 50 mm of
            a path, else none.
    """
    what, answers, labels = _stops(answer)
    q = np.array([one.q for one in answers])
    moves, line_speed = [Move()] * len(q), REDUCED_SPEED * speed / 100
    on_path = answer.followed is not None
    if on_path:
        stated = getattr(answer.task, "speed", None)
        line_speed = line_speed if stated is None else answer.law.speed or line_speed
        moves = path_moves(np.array([problem.arm.position(row) for row in q]), answer.law.lengths, line_speed)
    distance = (DEFAULT_APPROACH_M if on_path else 0.0) if approach is None else approach
    ways: list[str] = []
    if distance > 0:
        backs = np.array([_way_back(one) for one in answers])
        q, labels, moves, ways = with_way(problem, q, labels, moves, backs, distance, on_path)
    found = program_through(problem, what, q, labels, speed=speed, wait=wait)
    sides = arrival_notes(problem.arm, problem.robot.joint_names)
    return replace(found, notes=(*ways, *sides, *found.notes), given_moves=tuple(moves), line_speed=line_speed)


def program_through(
    problem: ProblemData, what: str, q: ArrayLike, labels: Sequence[str], *, speed: float = 10.0, wait: float = 0.0
) -> RobotProgram:
    """The program through postures (N, n) [rad or m].

    Values have so many digits that rounding moves the tool point by less than a tenth of its σ. Notes say what the
    reports say of the surface that the arm stands on and, with several stops, that the way between them is not checked.
    """
    rows = np.asarray(q, dtype=float)
    digits = joint_digits(problem, rows)
    scene = problem.scene
    mounting = [note] if len(rows) and (note := scene.mounting_note(rows)) else []
    bare = [f"Not checked for collisions, as no shape is known: {listed(scene.unchecked)}."] if scene.unchecked else []
    way = [_UNCHECKED_NOTE] if len(rows) > 1 else []
    at = joints_at_limits(problem.robot, rows) if len(rows) else []
    limits = [f"At a limit, where controllers seldom let a joint go: {listed(at)}."] if at else []
    notes = (*mounting, *bare, *limits, *way)
    carried = float(problem.arm.inputs.payload)
    return RobotProgram(
        problem.name, what, problem.robot, rows, tuple(labels), digits, speed, wait, notes, payload=carried
    )


def arrival_notes(arm: Arm, joints: Collection[str], where: str = "") -> Iterator[str]:
    """From which sides joints are to arrive, where an effect of theirs depends on it and the task says so.

    Args:
        joints: that it is said of; where: it holds, in words.
    """
    for joint in dict.fromkeys(effect.target for effect in arm.effects if "approach" in effect.needs):
        if joint in arm.inputs.stated and joint in joints:
            upwards = arm.inputs.side(arm.robot.joint_names.index(joint)) > 0
            yield f"{joint} must arrive{where} with {'increasing' if upwards else 'decreasing'} values."


def _stops(answer: Answer) -> tuple[str, list[Answer], list[str]]:
    """What the stops are, the answer at each of them, and their labels."""
    if answer.followed is not None:
        return "along the path", list(answer.points), [f"point {k}" for k in range(1, len(answer.points) + 1)]
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
    """A line of printable ASCII: what controllers read as a comment.

    >>> plain("σ = 0.02°")
    's = 0.02d'
    """
    swapped = text.translate(str.maketrans("–—σ°µ·×", "--sduxx"))
    return "".join(c if " " <= c <= "~" else " " if c.isspace() else "?" for c in swapped)
