"""Which capsules of an arm are checked against each other, and against an obstacle."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from posture_opt.collision.obstacles import Obstacle
from posture_opt.collision.placed_capsules import PlacedCapsules
from posture_opt.collision.segment_distances import to_segment
from posture_opt.numerics import Array, Mask
from posture_opt.robot.joint_ranges import drawn_between

_NEARLY_ALL = 0.95
"""Share of random postures from which a pair counts as one that always overlaps.

As MoveIt's setup assistant has it by default (``compute_default_collisions.cpp``, ``min_collision_fraction``).
"""
_POSTURES = 1000  # the share is then known to 0.7 % (one standard deviation)
_FIRST = 1  # the body behind the first joint, which turns on what the arm is mounted on
_STILL = 0.05  # m: what comes and goes by less stays where it was mounted

Pair = tuple[int, int]


def own_pairs(placed: PlacedCapsules, clearance: float) -> tuple[Pair, ...]:
    """Pairs of capsules more than one joint apart, but for those nearer than the clearance in nearly all postures."""
    bodies = placed.bodies
    count = range(len(bodies))
    apart = [(i, j) if bodies[i] < bodies[j] else (j, i) for i in count for j in count[:i] if _far(bodies, i, j)]
    if not apart:
        return ()
    near = own_distances(placed, *placed.segments(random_postures(placed, _POSTURES)), apart) < clearance
    return tuple(pair for pair, always in zip(apart, _always(near), strict=True) if not always)


def own_distances(placed: PlacedCapsules, start: Array, end: Array, pairs: Sequence[Pair]) -> Array:
    """(N, k) distance of the pairs at postures with these segments (N, c, 3) [m]; negative where they overlap."""
    first, second = (np.array(side, dtype=int) for side in zip(*pairs, strict=True))
    between = to_segment(start[:, first], end[:, first], start[:, second], end[:, second])
    return np.asarray(between - placed.radii[first] - placed.radii[second])


def exposed(placed: PlacedCapsules, obstacle: Obstacle, clearance: float) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Capsules that are checked against an obstacle, and those moving ones that are not.

    What stands still is not checked. Nor is what is nearer than the clearance in nearly all postures and belongs to the
    first link, or keeps its distance within 50 mm: the shoulder above the table that the arm is mounted on.
    """
    moving = [k for k, body in enumerate(placed.bodies) if body > 0]
    if not moving:
        return (), ()
    start, end = placed.segments(random_postures(placed, _POSTURES))
    away = obstacle_distances(placed, obstacle, start, end, moving)
    still = (np.array([placed.bodies[k] for k in moving]) == _FIRST) | (np.ptp(away, axis=0) <= _STILL)
    mounted = [k for k, always in zip(moving, _always(away < clearance) & still, strict=True) if always]
    return tuple(k for k in moving if k not in mounted), tuple(mounted)


def obstacle_distances(
    placed: PlacedCapsules, obstacle: Obstacle, start: Array, end: Array, chosen: Sequence[int]
) -> Array:
    """(N, k) distance of some capsules to an obstacle at postures with these segments (N, c, 3) [m]."""
    columns = list(chosen)
    return obstacle.distance(start[:, columns], end[:, columns]) - placed.radii[columns]


def _far(bodies: Sequence[int], i: int, j: int) -> bool:
    return abs(bodies[i] - bodies[j]) > 1


def _always(near: Mask) -> Mask:
    return np.asarray(near.mean(axis=0) >= _NEARLY_ALL)


def random_postures(placed: PlacedCapsules, count: int) -> Array:
    """(count, n) always the same ones, within the limits."""
    rng = np.random.default_rng(0)
    return rng.uniform(*drawn_between(placed.robot), (count, placed.robot.n))
