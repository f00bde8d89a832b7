"""What a report says of collisions: what was checked, and how near the arm comes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

from posture_opt.errors import listed
from posture_opt.robot.shape import TOOL
from posture_opt.selection.tasks.workpiece import WORKPIECE
from posture_opt.statements.notation import length, stated_length

if TYPE_CHECKING:
    from posture_opt.collision.nearest import Clearance
    from posture_opt.collision.scene import Scene
    from posture_opt.numerics import Array
    from posture_opt.selection.answer.solution import Solution

Fact = tuple[str, str]
_HINT_DISTANCE_M = 5e-3  # m: nearer than this, people will want to know how to keep a distance


def distance_facts(scene: Scene, clearance: Clearance | None) -> list[Fact]:
    """How near the arm comes to the cell and to itself, and where; nothing where it is not checked.

    "none" where two bodies overlap. Below 5 mm without a stated minimum a hint says how to keep a distance. Pairs that
    cannot have the minimum are named with what they keep.
    """
    if clearance is None:
        return []
    touching = scene.margin == 0 and clearance.distance < _HINT_DISTANCE_M
    hint = "; to keep them farther apart add cell: {clearance: 10 mm}" if touching else ""
    facts = []
    for name, nearest in (("Clearance to the cell", clearance.cell), ("Clearance to itself", clearance.own)):
        if nearest is None:
            continue
        a, b = nearest.between
        apart, clear = f"{length(nearest.distance)} between {a} and {b}", nearest.distance > 0
        words = apart if clear else f"none: {a} and {b} overlap"
        facts.append((name, words + (hint if nearest is clearance.nearest else "")))
    return [*facts, *held_facts(scene)]


def held_facts(scene: Scene) -> list[Fact]:
    """The pairs that the arm cannot bring as far apart as is asked for, and what they keep instead."""
    least: dict[tuple[str, str], float] = {}
    for names, distance in scene.held:
        least[names] = min(distance, least.get(names, distance))
    if not least:
        return []
    kept = listed(f"{a} and {b} {stated_length(distance)}" for (a, b), distance in least.items())
    return [("Held to less", f"{kept}: most postures bring them nearer than {stated_length(scene.margin)}")]


def mounting_lead(scene: Scene, Q: Array) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """What the lead of a report says of the surface that the arm stands on: before all else, and behind it.

    Args:
        Q: (N, n) the postures of the answer [rad or m].
    """
    note = scene.mounting_note(Q)
    if not note:
        return (), ()
    return ((note,), ()) if scene.mounting is not None and scene.mounting.dropped else ((), (note,))


def pierced_lead(scene: Scene, Q: Array) -> tuple[str, ...]:
    """That the end of the tool, which is not checked, passes through something in front of its point.

    Args:
        Q: (N, n) the postures of the answer [rad or m].
    """
    names = scene.pierced(Q)
    if not names:
        return ()
    return (
        f"The tool passes through {listed(names)} just in front of its point, where it is not checked, as it has to "
        "touch there: see whether it can.",
    )


def workpiece_lead(found: Solution) -> tuple[str, ...]:
    """That the arm meets the workpiece where it was put, or comes nearer than it may; nothing where it does not."""
    problem = found.problem
    if problem.part is None or found.clearance is None or found.clearance.cell is None:
        return ()
    nearest, margin = found.clearance.cell, problem.scene.margin
    if nearest.between[1] != WORKPIECE or nearest.distance > margin:
        return ()
    joint = nearest.between[0]
    how = f"comes within {length(nearest.distance)} of" if nearest.distance > 0 else "hits"
    return (
        f"There {joint} {how} the workpiece: the placement was chosen without looking at its shape. Narrow x, y, z or "
        "yaw, or fix them: of a fixed workpiece the arm keeps clear.",
    )


def mounting_notes(answers: Mapping[str, Solution]) -> tuple[str, ...]:
    """The same of several answers by their names, each sentence once; with the names where they differ."""
    notes = {name: answer.mounting_note for name, answer in answers.items() if answer.mounting_note}
    if len(set(notes.values())) < 2 and len(notes) == len(answers):
        return tuple(dict.fromkeys(notes.values()))
    return tuple(f"With {name}: {note[:1].lower()}{note[1:]}" for name, note in notes.items())


def unchecked_facts(scene: Scene) -> list[Fact]:
    """The links without a shape, where others are checked, and what stands for them."""
    if not scene.active:
        return []
    if scene.assumed:
        what = listed(scene.robot.unshaped) if scene.robot.unshaped else "the links"
        radius = length(float(scene.placed.radii[0]))
        words = f"assumed: capsules of radius {radius} along {what}, checked against the cell (robot: shape)"
        return [("Shape", words)]
    if not scene.unchecked:
        return []
    return [("Not checked", f"{listed(scene.unchecked)}: no shape is known (robot: shape: {{add: [...]}})")]


def collision_facts(scene: Scene) -> list[Fact]:
    """What was checked for collisions, and what was not; a remark says so where the shape is not known.

    Nothing is passed over in silence: checks that are switched off, shapes that are assumed and pairs that are left
    out each have their words.
    """
    if scene.switched_off:
        return [("Collisions", "not checked (cell: none)")]
    if not scene.active:
        return []
    names = listed(obstacle.name for obstacle in scene.obstacles)
    facts = []
    if scene.assumed:
        radius = length(float(scene.placed.radii[0]))
        own = "links of known shape against each other" if scene.own else "not against itself"
        facts.append(f"the arm is checked against {names}, {own}: capsules of radius {radius} along its other links "
                     "are used (robot: shape)")  # fmt: skip
    elif scene.obstacles:
        facts.append(f"the arm is checked against {names}{' and against itself' if scene.own else ''}")
    else:
        facts.append("the arm is checked against itself")
    if not scene.stated_obstacles:
        facts.append("no obstacles are stated (cell: obstacles)")
    if scene.margin:
        facts.append(f"minimum distance {stated_length(scene.margin)}")
    facts += _tool_words(scene)
    if scene.left_out:
        pairs = listed(f"{a} and {b}" for a, b in scene.left_out)
        facts.append(f"not checked, as they overlap in every posture: {pairs}")
    return [("Collisions", "; ".join(facts))]


def _tool_words(scene: Scene) -> list[str]:
    """How the tool is checked, where it is the capsule that stands for one; at most one entry."""
    if any(capsule.joint == TOOL for capsule in scene.robot.shape):
        return []
    tools = [capsule for capsule in scene.placed.capsules if capsule.joint == TOOL]
    if not tools:
        return []
    free, radius = math.dist(tools[0].end, (0.0, 0.0, 0.0)), stated_length(tools[0].radius)
    source = "assumed; robot: tool: {radius: ...}" if scene.robot.tool_radius is None else "as stated"
    end = f", but for the last {stated_length(free)} before the tool point" if free else ""
    return [f"the tool counts as a capsule of radius {radius} ({source}) from the flange on{end}"]


def clear_words(scene: Scene) -> str:
    """What postures that an arm is sent to keep clear of.

    In the middle of a sentence: itself, the obstacles by name, the minimum distance, and an assumed shape.
    """
    if not scene.active:
        return "nothing is checked for collisions" if scene.switched_off else "the arm has no links that could collide"
    parts = ["the arm clear of itself"] if scene.own else []
    parts += ["of " + listed(obstacle.name for obstacle in scene.obstacles)] if scene.obstacles else []
    radius = (
        f", with capsules of radius {length(float(scene.placed.radii[0]), 2)} along its links" if scene.assumed else ""
    )
    kept = f" by {stated_length(scene.margin)}" if scene.margin else ""
    return f"{' and '.join(parts)}{kept}{radius}"
