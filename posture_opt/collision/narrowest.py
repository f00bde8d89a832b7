"""``Gap``: where an arm comes nearest to its cell or to itself, as the segment between the two surfaces."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from posture_opt.collision.scene import Scene
from posture_opt.collision.segment_distances import to_segment
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
        between: two joints, or a joint and an obstacle.
        start, end: (3,) the two points that are so near, of the first and of the second [m], world.
    """

    distance: float
    between: tuple[str, str]
    start: Array
    end: Array


def narrowest(scene: Scene, q: Array) -> Gap | None:
    """The narrowest gap at a posture (n,) to an obstacle; to the arm itself where there is none.

    Of the pairs that are to keep the whole clearance: links that are near each other by design, and the shoulder above
    its table, are held at what they can have, and would be the narrowest at every posture. None where nothing is left.
    """
    if not scene.active:
        return None
    distances = np.where(np.array(scene.required) < scene.margin, np.inf, scene.distances(q)[0])
    if np.isfinite(distances[len(scene.own) :]).any():
        distances[: len(scene.own)] = np.inf
    k = int(np.argmin(distances))
    if not np.isfinite(distances[k]):
        return None
    start, end = (ends[0] for ends in scene.placed.segments(np.atleast_2d(q)))
    radii = scene.placed.radii
    if k < len(scene.own):
        first, second = scene.own[k]

        def away(points: Array) -> Array:
            return np.asarray(to_segment(points, points, start[second], end[second]) - radii[second])
    else:
        others = [
            (i, obstacle) for obstacle, chosen in zip(scene.obstacles, scene.against, strict=True) for i in chosen
        ]
        first, solid = others[k - len(scene.own)]

        def away(points: Array) -> Array:
            return solid.distance(points, points)

    on_axis = _nearest_on(start[first], end[first], away)
    outward = _gradient(away, on_axis)
    surface = on_axis - radii[first] * outward
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
