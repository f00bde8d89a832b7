"""``Gap``: where an arm comes nearest to an obstacle, as the segment between the two surfaces."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from posture_opt.collision.scene import Scene
from posture_opt.numerics import Array

_PIECES, _ROUNDS = 32, 8
"""A capsule's segment is cut in so many pieces, and the two about the nearest point again: (2 / 32)^8 of it is left."""
_STEP_M = 1e-6
"""Of the central differences of a distance [m]."""

Distance = Callable[[Array], Array]
"""Points (..., 3) -> distance (...) to a convex solid [m]."""


@dataclass(frozen=True)
class Gap:
    """The narrowest gap at a posture.

    Args:
        distance: [m]; zero or less where the bodies overlap, but not how deep.
        between: a joint and an obstacle.
        start, end: (3,) the two points that are so near, of the arm and of the obstacle [m], world.
    """

    distance: float
    between: tuple[str, str]
    start: Array
    end: Array


def narrowest(scene: Scene, q: Array) -> Gap | None:
    """The narrowest gap at a posture (n,) to a stated obstacle; None where there is none.

    Of the pairs that are to keep the whole clearance: the shoulder above the table that it stands on is held at what it
    can have, and would be the narrowest at every posture.
    """
    stated = {obstacle.name for obstacle in scene.stated_obstacles}
    counts = [len(scene.own) <= k and other in stated for k, (_, other) in enumerate(scene.pairs)]
    kept = np.array(counts, dtype=bool) & (np.array(scene.required) >= scene.margin)
    if not kept.any():
        return None
    distances = np.where(kept, scene.distances(q)[0], np.inf)
    k = int(np.argmin(distances))
    start, end = (ends[0] for ends in scene.placed.segments(np.atleast_2d(q)))
    others = [(i, obstacle) for obstacle, chosen in zip(scene.obstacles, scene.against, strict=True) for i in chosen]
    capsule, solid = others[k - len(scene.own)]

    def away(points: Array) -> Array:
        return solid.distance(points, points)

    on_axis = _nearest_on(start[capsule], end[capsule], away)
    outward = _gradient(away, on_axis)
    surface = on_axis - scene.placed.radii[capsule] * outward
    return Gap(float(distances[k]), scene.pairs[k], surface, on_axis - float(away(on_axis)) * outward)


def _nearest_on(start: Array, end: Array, away: Distance) -> Array:
    """(3,) the point of a segment that is nearest to a convex solid: the distance is convex along it."""
    for _ in range(_ROUNDS):
        points = np.linspace(start, end, _PIECES + 1)
        k = int(np.argmin(away(points)))
        start, end = points[max(k - 1, 0)], points[min(k + 1, _PIECES)]
    return np.asarray((start + end) / 2)


def _gradient(away: Distance, point: Array) -> Array:
    """(3,) the unit vector out of a solid at a point outside of it; zero inside."""
    steps = _STEP_M * np.eye(3)
    slope = (away(point + steps) - away(point - steps)) / (2 * _STEP_M)
    return np.asarray(slope / max(float(np.linalg.norm(slope)), 1e-12))
