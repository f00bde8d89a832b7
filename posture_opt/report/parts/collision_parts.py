"""What a report says of collisions: what was checked, and how near the arm comes."""

from __future__ import annotations

from typing import TYPE_CHECKING

from posture_opt.errors import listed
from posture_opt.report.text.units_text import length, stated_length

if TYPE_CHECKING:
    from posture_opt.collision.scene import Clearance, Scene

Fact = tuple[str, str]
_HINT_DISTANCE_M = 5e-3  # m: nearer than this, people will want to know how to keep a distance


def distance_facts(scene: Scene, clearance: Clearance | None) -> list[Fact]:
    """How near the arm comes to what it is checked against, and where; nothing where it is not checked.

    "none" where two bodies overlap. Below 5 mm without a stated minimum a hint says how to keep a distance.
    """
    if clearance is None:
        return []
    a, b = clearance.between
    if clearance.distance <= 0:
        return [("Clearance", f"none: {a} and {b} overlap")]
    touching = scene.margin == 0 and clearance.distance < _HINT_DISTANCE_M
    hint = "; to keep them farther apart add cell: {clearance: 10 mm}" if touching else ""
    return [("Clearance", f"{length(clearance.distance)} between {a} and {b}{hint}")]


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
        facts.append(f"the arm is checked against {names}, not against itself: its shape is unknown, and capsules of "
                     f"radius {radius} along its links are used (robot: shape)")  # fmt: skip
    elif scene.obstacles:
        facts.append(f"the arm is checked against {names}{' and against itself' if scene.own else ''}")
    else:
        facts.append("the arm is checked against itself; no obstacles are stated (cell: obstacles)")
    if scene.margin:
        facts.append(f"minimum distance {stated_length(scene.margin)}")
    for name in dict.fromkeys(name for _, name in scene.mounted):
        joints = " and ".join(joint for joint, other in scene.mounted if other == name)
        facts.append(f"parts of {joints} that are always near {name} are not checked against it")
    return [("Collisions", "; ".join(facts))]


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
