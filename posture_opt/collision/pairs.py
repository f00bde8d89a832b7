"""Which capsules of an arm are checked against each other, and against an obstacle."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from posture_opt.collision.obstacles import Obstacle
from posture_opt.collision.placed_capsules import PlacedCapsules
from posture_opt.collision.segment_distances import to_segment
from posture_opt.numerics import Array, Mask
from posture_opt.robot.joint_ranges import drawn_between

_ALWAYS_SHARE = 0.95
"""Share of random postures from which a pair counts as one that always overlaps.

As MoveIt's setup assistant has it by default (``compute_default_collisions.cpp``, ``min_collision_fraction``).
"""
_POSTURE_COUNT = 1000
"""Random postures; a share of 95 % is then known to 0.7 % (one standard deviation)."""
_FIRST_BODY = 1
"""The body behind the first joint, which turns on what the arm is mounted on."""
_MOUNTED_RANGE_M = 0.05
"""A body whose distance to an obstacle varies by less than this [m] belongs to the mount."""

Pair = tuple[int, int]
"""Indices of two capsules."""


def own_pairs(placed: PlacedCapsules, clearance: float) -> tuple[Pair, ...]:
    """Pairs of capsules more than one joint apart, but for those nearer than the clearance in nearly all postures.

    Args:
        placed: the capsules of the arm.
        clearance: least distance to keep [m].
    """
    bodies = placed.bodies
    count = range(len(bodies))
    apart = [
        (i, j) if bodies[i] < bodies[j] else (j, i) for i in count for j in count[:i] if _not_adjacent(bodies, i, j)
    ]
    if not apart:
        return ()
    near = own_distances(placed, *placed.segments(random_postures(placed, _POSTURE_COUNT)), apart) < clearance
    return tuple(pair for pair, always in zip(apart, _always_near(near), strict=True) if not always)


def own_distances(placed: PlacedCapsules, start: Array, end: Array, pairs: Sequence[Pair]) -> Array:
    """(N, k) distance of the pairs [m]; negative where they overlap.

    Args:
        placed: the capsules, for their radii.
        start, end: (N, c, 3) their segments at N postures [m], world.
        pairs: (k,) which of them.
    """
    first, second = (np.array(side, dtype=int) for side in zip(*pairs, strict=True))
    between = to_segment(start[:, first], end[:, first], start[:, second], end[:, second])
    return np.asarray(between - placed.radii[first] - placed.radii[second])


def exposed(placed: PlacedCapsules, obstacle: Obstacle, clearance: float) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Capsules that are checked against an obstacle, and those moving ones that are not.

    Bodies at rest are not checked. Nor is a body that is nearer than the clearance in nearly all postures and belongs
    to the first link, or keeps its distance within 50 mm: the shoulder above the table that the arm is mounted on.

    Args:
        placed: the capsules of the arm.
        obstacle: in the world.
        clearance: least distance to keep [m].

    Returns:
        Indices of the capsules that are checked, and of the moving ones that are not.
    """
    moving = [k for k, body in enumerate(placed.bodies) if body > 0]
    if not moving:
        return (), ()
    start, end = placed.segments(random_postures(placed, _POSTURE_COUNT))
    away = obstacle_distances(placed, obstacle, start, end, moving)
    still = (np.array([placed.bodies[k] for k in moving]) == _FIRST_BODY) | (np.ptp(away, axis=0) <= _MOUNTED_RANGE_M)
    mounted = [k for k, always in zip(moving, _always_near(away < clearance) & still, strict=True) if always]
    return tuple(k for k in moving if k not in mounted), tuple(mounted)


def obstacle_distances(
    placed: PlacedCapsules, obstacle: Obstacle, start: Array, end: Array, chosen: Sequence[int]
) -> Array:
    """(N, k) distance of some capsules to an obstacle [m]; zero or less where they overlap.

    Args:
        placed: the capsules, for their radii.
        obstacle: in the world.
        start, end: (N, c, 3) all their segments at N postures [m], world.
        chosen: (k,) indices of the capsules.
    """
    columns = list(chosen)
    return obstacle.distance(start[:, columns], end[:, columns]) - placed.radii[columns]


def _not_adjacent(bodies: Sequence[int], i: int, j: int) -> bool:
    """Whether two capsules are of bodies with another body between them."""
    return abs(bodies[i] - bodies[j]) > 1


def _always_near(near: Mask) -> Mask:
    """(k,) which columns of (N, k) are true in nearly all rows."""
    return np.asarray(near.mean(axis=0) >= _ALWAYS_SHARE)


def random_postures(placed: PlacedCapsules, count: int) -> Array:
    """(count, n) postures [rad or m] within the limits, always the same ones."""
    rng = np.random.default_rng(0)
    return rng.uniform(*drawn_between(placed.robot), (count, placed.robot.n))
