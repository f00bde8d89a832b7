"""Blocks and facts that several reports share: effects, sources, joint table, tool point, ellipse, budget, validity.

A fact is (label, text). Functions take results and return texts; they compute nothing that a result does not hold. An
empty list means that the line is left out.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from posture_opt.model.arm import Arm
from posture_opt.report.text.blocks import Table
from posture_opt.report.text.words import (
    METHODS,
    REGIONS,
    Vector,
    line_words,
    roll_pitch_yaw,
    source_size,
    source_words,
)
from posture_opt.robot.robot import Joint, Robot
from posture_opt.selection.answer.arm_statements import free_frames
from posture_opt.statements import Statement
from posture_opt.statements.notation import (
    joint_unit,
    joint_value,
    largest_of,
    length,
    lengths,
    percent,
    place,
    sentence,
    shift,
)
from posture_opt.uncertainty.sources.workpiece import ANGLE, stated_name
from posture_opt.uncertainty.spread.conditions import conditions
from posture_opt.uncertainty.spread.joint_digits import JointDigits, readable_digits, readable_posture
from posture_opt.uncertainty.spread.spread import HasSources
from posture_opt.units import fixed

if TYPE_CHECKING:
    from posture_opt.selection.problem_data import ProblemData
    from posture_opt.uncertainty.spread.spread import Spread

joint_values = readable_posture
_MAX_SOURCES = 8  # sources named one by one
_MAX_EFFECTS = 6  # named one by one
_NEGLIGIBLE_SHARE = 1e-3  # of the largest standard deviation of its kind
_LIMIT_TOLERANCE = 1e-6
_MIN_SHIFT_M = 1e-7  # m


def robot_facts(problem: ProblemData) -> list[tuple[str, str]]:
    """Name and size of the robot, and where its numbers come from.

    Source of the geometry, of the shape for collisions, and effects each have a line where they are known.
    """
    robot: Robot = problem.robot
    size = f"{robot.n} joints"
    name = f"{robot.name}, {size}" if robot.name and robot.name != f"{robot.n}-joint arm" else robot.name or size
    source = [("Robot data", f"{group}: {source}") for group, source in robot.sources if group == "geometry"]
    shape = [("Robot shape", "; ".join(robot.shape_notes))] if robot.shape_notes else []
    return [("Robot", name), *source, *shape, *effect_facts(problem)]


def effect_facts(problem: ProblemData) -> list[tuple[str, str]]:
    """The effects that the arm is computed with; nothing for a plain arm. Beyond six they are counted."""
    effects = problem.effects
    if not effects:
        return []
    shown = [effect.stated_words for effect in effects[:_MAX_EFFECTS]]
    if len(effects) > _MAX_EFFECTS:
        shown.append(f"and {len(effects) - _MAX_EFFECTS} more")
    return [("Effects", ", ".join(shown))]


def input_facts(problem: ProblemData) -> list[tuple[str, str]]:
    """What the task says, or leaves open, of the inputs that the effects depend on.

    Payload [kg], sides of approach, temperature [degC] and time [s], each where an effect of the arm needs it.
    """
    texts = conditions(problem.arm)
    return [("Conditions", ", ".join(texts))] if texts else []


def source_facts(problem: ProblemData) -> list[tuple[str, str]]:
    """The standard deviations of the sources; equal ones of one kind together, negligible ones last.

    Angles in deg, lengths in mm. Negligible is below a thousandth of the largest of its kind; beyond eight groups they
    are counted.
    """
    arm, sources = problem.arm, problem.sources
    sigmas = dict(zip(sources.names, map(float, sources.sigma), strict=True))
    largest: dict[str, float] = {}
    for name, sigma in sigmas.items():
        kind = name.rpartition(".")[2]
        largest[kind] = max(largest.get(kind, 0.0), sigma)
    groups: dict[tuple[str, str], list[str]] = {}
    for name, sigma in sorted(
        sigmas.items(), key=lambda s: s[1] < _NEGLIGIBLE_SHARE * largest[s[0].rpartition(".")[2]]
    ):
        groups.setdefault((name.rpartition(".")[2], source_size(name, sigma, arm)), []).append(name)
    texts = [f"{_group_words(names, arm)} {size}" for (_, size), names in groups.items()]
    if len(texts) > _MAX_SOURCES:
        texts = [*texts[:_MAX_SOURCES], f"and {len(texts) - _MAX_SOURCES} more"]
    correlated = ", some of them correlated" if sources.correlated else ""
    return [("Uncertainty", ", ".join(texts) + f" (standard deviations{correlated})")]


def workpiece_facts(problem: ProblemData) -> list[tuple[str, str]]:
    """The standard deviations of workpiece and features, and the point that the angle is about; below the sources."""
    errors, task = problem.workpiece_sources, problem.task
    if errors.empty or task is None:
        return []
    sigma = dict(zip(map(stated_name, errors.names), map(float, errors.sigma), strict=True))
    sizes = ", ".join(
        f"{source_words(name, problem.arm)} {source_size(name, s, problem.arm)}" for name, s in sigma.items()
    )
    return [("", f"{sizes}{_about(problem) if ANGLE in sigma else ''}")]


def _about(problem: ProblemData) -> str:
    """Which point the workpiece turns about by its error."""
    task = problem.task
    assert task is not None
    if task.workpiece is not None:
        return " (angle about the origin of the workpiece)"
    if not task.places:
        return " (angle about the target)"
    what = "features" if task.features else "path"
    return f" (angle about the middle of the {what}, {place(task.origin)}; task: {{workpiece: ...}} states the origin)"


def _group_words(names: Sequence[str], arm: Arm) -> str:
    """Sources of one size in words: one by one, by their joints, or "of every joint"."""
    if len(names) < 3:
        return " and ".join(source_words(name, arm) for name in names)
    owners = [name.rpartition(".")[0] for name in names]
    what = source_words(names[0], arm).removeprefix(owners[0]).strip()
    kind = [joint.name for joint in arm.robot.joints if joint.type == "revolute"]
    if set(owners) >= set(kind) and set(owners) <= set(arm.robot.joint_names):
        return f"{what} of every joint"
    return f"{what} of {', '.join(owners)}"


def note_facts(notes: Iterable[str | Statement]) -> list[tuple[str, str]]:
    """Notes, one a line."""
    return [("Note" if k == 0 else "", sentence(note)) for k, note in enumerate(dict.fromkeys(map(str, notes)))]


def brief_notes(problem: ProblemData, notes: Iterable[str | Statement]) -> list[tuple[str, str]]:
    """The notes that a report of one screen has, one a line."""
    return note_facts(note for note in notes if note not in problem.sources.details)


def frame_notes(robot: Robot) -> list[str]:
    """What became of a base or tool that the problem file leaves free."""
    return [one.text for one in free_frames(robot)]


def joint_table(problem: HasSources, robot: Robot, q: Vector) -> Table:
    """Every joint with its value, to the digits that rounding asks for, its limits and the margin to the nearer one.

    Values [deg or mm] have so many digits that rounding them moves the tool point by no more than its σ.

    Args:
        q: (n,) posture [rad or m].
    """
    digits = readable_digits(problem, q)
    rows = [
        (joint.name, _value(joint, value, digits), _limits(joint), _margin(joint, value))
        for joint, value in zip(robot.joints, q, strict=True)
    ]
    return Table(("joint", "value", "limits", "margin"), tuple(rows))


def nearest_limit(robot: Robot, q: Vector) -> list[tuple[str, str]]:
    """The joint with the smallest margin to a limit, relative to its range; nothing without limits.

    ``min(q − lower, upper − q) / (upper − lower)`` over the joints with finite limits.
    """
    ranges = [(joint, value, joint.upper - joint.lower) for joint, value in zip(robot.joints, q, strict=True)]
    shares = [
        (min(value - joint.lower, joint.upper - value) / size, joint, value)
        for joint, value, size in ranges
        if math.isfinite(size) and size > 0
    ]
    if not shares:
        return []
    _, joint, value = min(shares, key=lambda share: share[0])
    return [("Nearest limit", f"{joint.name}, {_distance(joint, value)}")]


def _distance(joint: Joint, value: float) -> str:
    """How far a joint is from its nearer limit, in words."""
    margin = _margin(joint, value)
    return margin if margin.startswith(("at", "exceeded")) else f"{margin} away"


def _limits(joint: Joint) -> str:
    """The limits of a joint in the unit of its values."""
    unit, factor = joint_unit(joint.type)
    low, high = (f"{value * factor:.6g}" if math.isfinite(value) else "none" for value in (joint.lower, joint.upper))
    return f"{low} to {high} {unit}"


def _value(joint: Joint, value: float, digits: JointDigits) -> str:
    """A joint value with the digits that the scatter supports."""
    unit, factor = joint_unit(joint.type)
    return f"{digits.text(joint, value, 1 / factor)} {unit}"


def _margin(joint: Joint, value: float) -> str:
    """Distance to the nearer limit, or by how much it is exceeded."""
    margin = min(value - joint.lower, joint.upper - value)
    if not math.isfinite(margin):
        return "no limit"
    if margin < -_LIMIT_TOLERANCE:
        return f"exceeded by {joint_value(-margin, joint.type)}"
    return "at the limit" if margin < _LIMIT_TOLERANCE else joint_value(margin, joint.type)


def tool_facts(spread: Spread) -> list[tuple[str, str]]:
    """Nominal place [mm] and orientation (roll, pitch, yaw [deg]) of the tool, world frame."""
    angles = ", ".join(fixed(math.degrees(a)) for a in roll_pitch_yaw(spread.quaternion_wxyz))
    return [
        ("Tool point", f"{place(spread.position)} in the world frame"),
        ("Orientation", f"roll, pitch, yaw = {angles} deg"),
    ]


def lean(spread: Spread, tool_axis: Vector, direction: Vector) -> float:
    """The angle [rad] between the tool's axis (3,), tool frame, and a unit direction (3,), world frame.

    ``atan2(|a × d|, a · d)`` with the axis turned by the quaternion, ``a + 2 v × (v × a + w a)``.
    """
    w, v = spread.quaternion_wxyz[0], np.asarray(spread.quaternion_wxyz[1:], dtype=float)
    a, d = np.asarray(tool_axis, dtype=float), np.asarray(direction, dtype=float)
    turned = a + 2 * np.cross(v, np.cross(v, a) + w * a)
    return math.atan2(float(np.linalg.norm(np.cross(turned, d))), float(turned @ d))


def ellipse_facts(spread: Spread, among: Sequence[float] = ()) -> list[tuple[str, str]]:
    """The 95 % region of the tool point, with the factor that it is drawn with.

    Semi-axes from the longest to the shortest; ``among`` are the lengths [m] whose unit is to be used. An interval, an
    ellipse or an ellipsoid by the rank of the covariance; a point where there is no uncertainty.
    """
    ellipse = spread.ellipse
    if not ellipse.rank:
        return [(REGIONS[0], "a point: there is no uncertainty here")]
    along = ", ".join(line_words(a) for a in spread.axes[::-1][: ellipse.rank])
    half = lengths([float(s) for s in spread.region(0.95)[::-1][: ellipse.rank]], among=among)
    word = "half length" if ellipse.rank == 1 else "semi-axes"
    factor = f"{ellipse.factor(0.95):.3f} σ"
    return [(REGIONS[ellipse.rank], f"{word} {half} along {along} ({factor})")]


def first_order_fact(exact: float, linear: float, among: Sequence[float] = ()) -> tuple[str, str]:
    """The first-order figure next to the exact one.

    Args:
        exact: standard deviation [m]; ``linear`` that to first order. A difference below 0.05 % is "equal".
    """
    if exact <= 0:
        return "First order", "none"
    change = linear / exact - 1
    if abs(change) < 5e-4:
        return "First order", f"{length(linear, among=among)}, equal to the exact value within 0.05 %"
    word = "above" if change > 0 else "below"
    return "First order", f"{length(linear, among=among)}, {percent(abs(change))} {word} the exact value"


def mean_fact(spread: Spread, among: Sequence[float] = ()) -> tuple[str, str]:
    """How far the mean tool point is off the nominal one: the bias, of second order in the errors.

    "negligible" below 0.1 µm and below a thousandth of the lengths it is listed with; else its length and its vector
    in the world frame.
    """
    off = math.sqrt(float(spread.bias @ spread.bias))
    if off < max(_MIN_SHIFT_M, _NEGLIGIBLE_SHARE * largest_of(among)):
        return "Mean shift", "negligible"
    vector = shift(list(map(float, spread.bias)), among)
    return "Mean shift", f"{length(off, among=among)} from the nominal tool point: {vector}"


def method_fact(spread: Spread) -> tuple[str, str]:
    """How the figures were computed."""
    return "Method", METHODS.get(spread.method, spread.method)


def relative_fact(spread: Spread) -> list[tuple[str, str]]:
    """Whose errors the figures hold where the workpiece errs too."""
    if spread.relative:
        return [("Relative to", "the workpiece and its features, whose errors are included to first order")]
    if spread.seen is spread:
        return []
    return [("Relative to", "the workpiece in what concerns the task; all other figures are of the arm alone")]


def sigma_of(problem: ProblemData) -> dict[str, float]:
    """Standard deviation of every source that the task sees [rad or m], by the names that the file has."""
    sources = problem.task_sources
    return dict(zip(map(stated_name, sources.names), map(float, sources.sigma), strict=True))
