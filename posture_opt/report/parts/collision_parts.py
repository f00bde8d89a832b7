"""How near the arm comes to anything, and what it keeps clear of."""

from __future__ import annotations

from typing import TYPE_CHECKING

from posture_opt.errors import listed
from posture_opt.statements.notation import length, stated_length

if TYPE_CHECKING:
    from posture_opt.collision.nearest import Clearance
    from posture_opt.collision.scene import Scene

Fact = tuple[str, str]


def distance_facts(scene: Scene, clearance: Clearance | None) -> list[Fact]:
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
