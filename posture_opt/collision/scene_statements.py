"""What is checked for collisions, and what is not: nothing is passed over in silence."""

from __future__ import annotations

import math

from posture_opt.collision.scene import Scene
from posture_opt.numerics import Array
from posture_opt.robot.shape import TOOL
from posture_opt.statements import Quantity, Statement, state

_HINT_DISTANCE_M = 5e-3  # m: nearer than this, people will want to know how to keep a distance


def scene_statements(scene: Scene, Q: Array) -> tuple[Statement, ...]:
    """What is checked at the postures Q (N, n) [rad or m], with which shapes, and what to know before driving there."""
    if scene.switched_off:
        return (state("collision.switched-off"),)
    if not scene.active:
        return scene.statements(Q)
    return (
        *scene.statements(Q), _checked(scene),
        *([] if scene.stated_obstacles else [state("collision.no-obstacles")]),
        *_shapes(scene), *_tool(scene), *_pairs(scene), *_near(scene, Q),
    )  # fmt: skip


def _checked(scene: Scene) -> Statement:
    """Against what, and at which distance."""
    itself = ["itself"] if scene.own or not scene.obstacles else []
    bodies = (*(obstacle.name for obstacle in scene.obstacles), *itself)
    if not scene.margin:
        return state("collision.checked", bodies=bodies)
    return state("collision.checked-with-margin", bodies=bodies, margin=Quantity(scene.margin, "stated length"))


def _shapes(scene: Scene) -> list[Statement]:
    """Links of which no shape is known, and what stands for them."""
    if scene.assumed:
        radius = Quantity(float(scene.placed.radii[0]))
        return [state("collision.shape-assumed", radius=radius, links=scene.robot.unshaped or ("its links",))]
    return [state("collision.links-unchecked", links=scene.unchecked)] if scene.unchecked else []


def _tool(scene: Scene) -> list[Statement]:
    """How the tool is checked, where a capsule stands for it."""
    tools = [capsule for capsule in scene.placed.capsules if capsule.joint == TOOL]
    if any(capsule.joint == TOOL for capsule in scene.robot.shape) or not tools:
        return []
    name = "assumed" if scene.robot.tool_radius is None else "stated"
    free = Quantity(math.dist(tools[0].end, (0.0, 0.0, 0.0)), "stated length")
    return [state(f"collision.tool-{name}", radius=Quantity(tools[0].radius, "stated length"), free=free)]


def _pairs(scene: Scene) -> list[Statement]:
    """Pairs that are not checked, and those that keep less than the distance that is asked for."""
    said = []
    if scene.left_out:
        said.append(state("collision.pairs-left-out", pairs=tuple(f"{a} with {b}" for a, b in scene.left_out)))
    least: dict[tuple[str, str], float] = {}
    for names, distance in scene.held:
        least[names] = min(distance, least.get(names, distance))
    if least:
        pairs = tuple(f"{a} with {b} {Quantity(away, 'stated length')}" for (a, b), away in least.items())
        said.append(state("collision.pairs-closer", pairs=pairs, margin=Quantity(scene.margin, "stated length")))
    return said


def _near(scene: Scene, Q: Array) -> list[Statement]:
    """How to keep a distance, where none is asked for and the arm comes near."""
    clearance = scene.clearance(Q)
    near = scene.margin == 0 and clearance is not None and clearance.distance < _HINT_DISTANCE_M
    return [state("collision.very-near")] if near else []
