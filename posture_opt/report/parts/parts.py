"""Facts that several reports share: robot, sources, joints, tool point, ellipse, clearances.

A fact is (label, text); functions compute nothing that a result does not hold. An empty list leaves the line out.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from posture_opt.errors import listed
from posture_opt.model.arm import Arm
from posture_opt.numerics import Array
from posture_opt.report.text.blocks import Table
from posture_opt.report.text.words import METHODS, REGIONS, Vector, line_words, roll_pitch_yaw
from posture_opt.robot.robot import Joint, Robot
from posture_opt.selection.answer.solution_statements import free_frames
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
    stated_length,
)
from posture_opt.uncertainty.joint_digits import readable_digits, readable_posture
from posture_opt.uncertainty.sources import ANGLE, conditions, source_size, source_words, stated_name
from posture_opt.uncertainty.spread import HasSources
from posture_opt.units import fixed

if TYPE_CHECKING:
    from posture_opt.collision.pairs import Clearance
    from posture_opt.collision.scene import Scene
    from posture_opt.selection.problem_data import ProblemData
    from posture_opt.uncertainty.spread import Spread

joint_values = readable_posture
_NEGLIGIBLE_SHARE = 1e-3  # of the largest standard deviation of its kind


def robot_facts(problem: ProblemData) -> list[tuple[str, str]]:
    """Name and size of the robot, and where its numbers come from."""
    robot: Robot = problem.robot
    size = f"{robot.n} joints"
    name = f"{robot.name}, {size}" if robot.name and robot.name != f"{robot.n}-joint arm" else robot.name or size
    source = [("Robot data", f"{group}: {source}") for group, source in robot.sources if group == "geometry"]
    shape = [("Robot shape", "; ".join(robot.shape_notes))] if robot.shape_notes else []
    return [("Robot", name), *source, *shape, *effect_facts(problem)]


def effect_facts(problem: ProblemData) -> list[tuple[str, str]]:
    """The effects that the arm is computed with; nothing for a plain arm."""
    return [("Effects", _first([effect.stated_words for effect in problem.effects], 6))] if problem.effects else []


def _first(texts: Sequence[str], most: int) -> str:
    """The first of some texts, and how many more there are."""
    return ", ".join([*texts[:most], *([f"and {len(texts) - most} more"] if len(texts) > most else [])])


def input_facts(problem: ProblemData) -> list[tuple[str, str]]:
    """What the task says, or leaves open, of the inputs that the effects depend on."""
    texts = conditions(problem.arm)
    return [("Conditions", ", ".join(texts))] if texts else []


def source_facts(problem: ProblemData) -> list[tuple[str, str]]:
    """The standard deviations of the sources; equal ones of one kind together, negligible ones last."""
    arm, sources = problem.arm, problem.sources
    kinds = [name.rpartition(".")[2] for name in sources.names]
    largest = {kind: max(s for k, s in zip(kinds, sources.sigma, strict=True) if k == kind) for kind in kinds}
    each = zip(sources.names, kinds, map(float, sources.sigma), strict=True)
    groups: dict[tuple[str, str], list[str]] = {}
    for name, kind, sigma in sorted(each, key=lambda s: s[2] < _NEGLIGIBLE_SHARE * largest[s[1]]):
        groups.setdefault((kind, source_size(name, sigma, arm)), []).append(name)
    texts = _first([f"{_group_words(names, arm)} {size}" for (_, size), names in groups.items()], 8)
    correlated = ", some of them correlated" if sources.correlated else ""
    return [("Uncertainty", f"{texts} (standard deviations{correlated})")]


def workpiece_facts(problem: ProblemData) -> list[tuple[str, str]]:
    """The standard deviations of workpiece and features, and the point that the angle is about; below the sources."""
    errors, task, arm = problem.workpiece_sources, problem.task, problem.arm
    if errors.empty or task is None:
        return []
    sigma = dict(zip(map(stated_name, errors.names), map(float, errors.sigma), strict=True))
    sizes = ", ".join(f"{source_words(name, arm)} {source_size(name, s, arm)}" for name, s in sigma.items())
    about = "the origin of the workpiece" if task.workpiece is not None else "the target"
    if task.workpiece is None and task.places:
        middle = f"the middle of the {'features' if task.features else 'path'}, {place(task.origin)}"
        about = f"{middle}; task: {{workpiece: ...}} states the origin"
    return [("", f"{sizes}{f' (angle about {about})' if ANGLE in sigma else ''}")]


def _group_words(names: Sequence[str], arm: Arm) -> str:
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
    """Every joint with its value, to the digits that rounding asks for, its limits and the margin to the nearer one;
    ``q`` (n,) [rad or m]."""
    digits, rows = readable_digits(problem, q), []
    for joint, value in zip(robot.joints, q, strict=True):
        unit, factor = joint_unit(joint.type)
        limits = " to ".join(f"{v * factor:.6g}" if math.isfinite(v) else "none" for v in (joint.lower, joint.upper))
        shown = f"{digits.text(joint, value, 1 / factor)} {unit}"
        rows.append((joint.name, shown, f"{limits} {unit}", _margin(joint, value)))
    return Table(("joint", "value", "limits", "margin"), tuple(rows))


def nearest_limit(robot: Robot, q: Vector) -> list[tuple[str, str]]:
    """The joint with the smallest margin to a limit, relative to its range; nothing without limits. ``min(q − lower,
    upper − q) / (upper − lower)`` over the joints with finite limits."""
    shares = [
        (min(value - joint.lower, joint.upper - value) / size, joint, value)
        for joint, value in zip(robot.joints, q, strict=True)
        if math.isfinite(size := joint.upper - joint.lower) and size > 0
    ]
    if not shares:
        return []
    _, joint, value = min(shares, key=lambda share: share[0])
    margin = _margin(joint, value)
    return [("Nearest limit", f"{joint.name}, {margin}{'' if margin.startswith(('at', 'exceeded')) else ' away'}")]


def _margin(joint: Joint, value: float) -> str:
    margin = min(value - joint.lower, joint.upper - value)
    if not math.isfinite(margin):
        return "no limit"
    if abs(margin) < 1e-6:
        return "at the limit"
    return f"{'exceeded by ' if margin < 0 else ''}{joint_value(abs(margin), joint.type)}"


def tool_facts(spread: Spread) -> list[tuple[str, str]]:
    """Nominal place [mm] and orientation (roll, pitch, yaw [deg]) of the tool, world frame."""
    angles = ", ".join(fixed(math.degrees(a)) for a in roll_pitch_yaw(spread.quaternion_wxyz))
    point = f"{place(spread.position)} in the world frame"
    return [("Tool point", point), ("Orientation", f"roll, pitch, yaw = {angles} deg")]


def lean(spread: Spread, tool_axis: Vector, direction: Vector) -> float:
    """The angle [rad] between the tool's axis (3,), tool frame, and a unit direction (3,), world frame. ``atan2(|a ×
    d|, a · d)`` with the axis turned by the quaternion, ``a + 2 v × (v × a + w a)``."""
    w, v = spread.quaternion_wxyz[0], np.asarray(spread.quaternion_wxyz[1:], dtype=float)
    a, d = np.asarray(tool_axis, dtype=float), np.asarray(direction, dtype=float)
    turned = a + 2 * np.cross(v, np.cross(v, a) + w * a)
    return math.atan2(float(np.linalg.norm(np.cross(turned, d))), float(turned @ d))


def ellipse_facts(spread: Spread, among: Sequence[float] = ()) -> list[tuple[str, str]]:
    """The 95 % region of the tool point, with the factor that it is drawn with."""
    ellipse, rank = spread.ellipse, spread.ellipse.rank
    if not rank:
        return [(REGIONS[0], "a point: there is no uncertainty here")]
    along = ", ".join(line_words(a) for a in spread.axes[::-1][:rank])
    half = lengths([float(s) for s in spread.region(0.95)[::-1][:rank]], among=among)
    word = "half length" if rank == 1 else "semi-axes"
    return [(REGIONS[rank], f"{word} {half} along {along} ({ellipse.factor(0.95):.3f} σ)")]


def first_order_fact(exact: float, linear: float, among: Sequence[float] = ()) -> tuple[str, str]:
    """The first-order figure next to the exact one; ``exact`` [m]."""
    if exact <= 0:
        return "First order", "none"
    change, to_be = linear / exact - 1, length(linear, among=among)
    if abs(change) < 5e-4:
        return "First order", f"{to_be}, equal to the exact value within 0.05 %"
    return "First order", f"{to_be}, {percent(abs(change))} {'above' if change > 0 else 'below'} the exact value"


def mean_fact(spread: Spread, among: Sequence[float] = ()) -> tuple[str, str]:
    """How far the mean tool point is off the nominal one: the bias, of second order in the errors. "negligible"
    below 0.1 µm and below a thousandth of the lengths it is listed with; else its length and its vector in the
    world frame."""
    off = math.sqrt(float(spread.bias @ spread.bias))
    if off < max(1e-7, _NEGLIGIBLE_SHARE * largest_of(among)):
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


def distance_facts(scene: Scene, clearance: Clearance | None) -> list[tuple[str, str]]:
    """How near the arm comes to the cell and to itself, and where; nothing where it is not checked."""
    if clearance is None:
        return []
    facts = []
    for name, nearest in (("Clearance to the cell", clearance.cell), ("Clearance to itself", clearance.own)):
        if nearest is not None:
            apart = length(nearest.distance) if nearest.distance > 0 else "none"
            facts.append((name, f"{apart} between {' and '.join(nearest.between)}"))
    return facts


def clear_words(scene: Scene) -> str:
    """What postures that an arm is sent to keep clear of."""
    if not scene.active:
        return "nothing is checked for collisions" if scene.switched_off else "the arm has no links that could collide"
    parts = ["the arm clear of itself"] if scene.own else []
    parts += ["of " + listed(obstacle.name for obstacle in scene.obstacles)] if scene.obstacles else []
    radius = (
        f", with capsules of radius {length(float(scene.placed.radii[0]), 2)} along its links" if scene.assumed else ""
    )
    kept = f" by {stated_length(scene.margin)}" if scene.margin else ""
    return f"{' and '.join(parts)}{kept}{radius}"


def joint_heads(robot: Robot) -> list[str]:
    """Heads of columns of joint values, with deg or mm."""
    return [f"{joint.name} [{joint_unit(joint.type)[0]}]" for joint in robot.joints]


def joint_cells(robot: Robot, q: Vector, decimals: int = 1) -> list[str]:
    """Joint values (n,) [rad or m] in the units of their heads."""
    return [fixed(float(v) * joint_unit(joint.type)[1], decimals) for v, joint in zip(q, robot.joints, strict=True)]


def joint_columns(robot: Robot, Q: Array) -> dict[str, Array]:
    """Postures (N, n) [rad or m] as columns in deg or mm."""
    factors = [joint_unit(joint.type)[1] for joint in robot.joints]
    columns = np.reshape(Q, (-1, robot.n)).T
    return {head: factors[k] * columns[k] for k, head in enumerate(joint_heads(robot))}


def point_columns(points: Array) -> dict[str, Array]:
    """Points (N, 3) [m] as columns in mm."""
    return {f"{axis} [mm]": 1e3 * column for axis, column in zip("xyz", np.reshape(points, (-1, 3)).T, strict=True)}
