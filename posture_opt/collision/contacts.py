"""``Contacts``: what an arm keeps apart, as numbers for a search in C that asks where it comes near to what.

A capsule is near a solid at an end of its segment, or where the inside is nearest; two capsules at an end of one of
them, or where both insides are. Each is a row of its own, ``distance ≥ least``, with a slope that does not jump where
links are parallel to a face or to each other.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import casadi as ca
import numpy as np

from posture_opt.collision.obstacles import Obstacle
from posture_opt.collision.placed_capsules import PlacedCapsules
from posture_opt.collision.product_solid import SIZE
from posture_opt.numerics import Array

POINTS = 5
"""Candidates of one pair: the ends of its capsule, the inside, and of two capsules the ends of the other one."""
BISECTIONS = 40  # halvings of a segment: to 1e-12 of its length
DIFFERENCE = 1e-5  # rad or m: step of the differences of slopes
PARALLEL = 1e-9  # sine squared of an angle below which two segments count as parallel
MOST_NEAR = 48
"""Candidates of one posture that are rows at the same time: the nearest. More than joints are never active."""


class Apart(NamedTuple):
    """One pair that is kept apart.

    Args:
        first: index of a capsule; second: of another one, −1 for an obstacle.
        solid: index of the obstacle, −1 for none.
        least: distance to keep [m].
    """

    first: int
    second: int
    solid: int
    least: float


@dataclass(frozen=True)
class Contacts:
    """The pairs that an arm keeps apart.

    Args:
        placed: its capsules.
        obstacles: the convex solids around it.
        pairs: (P,) what is kept apart; `POINTS` rows each.
        reach: distance [m] beyond the least one up to which a candidate is a row.
    """

    placed: PlacedCapsules
    obstacles: tuple[Obstacle, ...]
    pairs: tuple[Apart, ...]
    reach: float

    @cached_property
    def frames(self) -> ca.Function:
        """``q -> axes (3 n,), origins (3 n,) of the joints, starts (3 c,), ends (3 c,) of the capsules``, world."""
        n = self.placed.robot.n
        q = ca.SX.sym("q", n)
        acting = {
            factor.joint: screw
            for factors, walked in self.placed.chain(q)
            for factor, screw in zip(factors, walked.screws, strict=True)
            if factor.joint is not None
        }
        placed = self.placed.symbols(q)
        outputs = [
            ca.vertcat(*(ca.SX(x) for j in range(n) for x in acting[j].axis)),
            ca.vertcat(*(ca.SX(x) for j in range(n) for x in acting[j].origin)),
            ca.vertcat(*(start for start, _ in placed)),
            ca.vertcat(*(start + along for start, along in placed)),
        ]
        return ca.Function("frames", [q], ca.cse([ca.densify(ca.SX(output)) for output in outputs]))

    @cached_property
    def numbers(self) -> tuple[Array, Array, Array, Array, Array]:
        """What turns (n,), how many joints move each capsule (c,), radii (c,), pairs (P, 4) and obstacles (S, 20)."""
        turns = np.array([float(joint.type == "revolute") for joint in self.placed.robot.joints])
        pairs = np.array(self.pairs, dtype=float).reshape(-1, 4)
        solids = np.array([obstacle.product.numbers for obstacle in self.obstacles], dtype=float).reshape(-1, SIZE)
        return turns, np.array(self.placed.bodies, dtype=float), np.array(self.placed.radii), pairs, solids

    @property
    def arguments(self) -> tuple[int | float | Array, ...]:
        """What loops in C receive: how many capsules and pairs there are, `numbers`, and the reach."""
        return (len(self.placed.capsules), len(self.pairs), *self.numbers, self.reach)

    @cached_property
    def moving(self) -> frozenset[int]:
        """Joints that move a capsule."""
        q = ca.SX.sym("q", self.placed.robot.n)
        ends = ca.vertcat(*self.frames(q)[2:])
        return frozenset(np.flatnonzero(ca.which_depends(ends, q, 1, False)).tolist())

    @property
    def rows(self) -> int:
        """Candidates of all pairs."""
        return POINTS * len(self.pairs)
