"""``Contacts``: what an arm keeps apart, as numbers for a search in C that asks where it comes near to what."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import casadi as ca
import numpy as np

from posture_opt.collision.obstacles import Obstacle
from posture_opt.collision.obstacles.obstacle import LEAST_LENGTH_M, SIZE
from posture_opt.collision.placed_capsules import PlacedCapsules
from posture_opt.files import packaged
from posture_opt.model.c_source import c_file
from posture_opt.model.compiled import RowLoop
from posture_opt.numerics import Array

POINTS = 5
"""Candidates of one pair: the ends of its capsule, the inside, and of two capsules the ends of the other one."""
BISECTIONS = 40  # halvings of a segment: to 1e-12 of its length
DIFFERENCE = 1e-5  # rad or m: step of the differences of slopes
PARALLEL = 1e-9  # sine squared of an angle below which two segments count as parallel
MOST_NEAR = 48
"""Candidates of one posture that are rows at the same time: the nearest. More than joints are never active."""


class Apart(NamedTuple):
    """One pair that is kept apart."""

    first: int  # index of a capsule; second: of another one, −1 for an obstacle
    second: int
    solid: int  # index of the obstacle, −1 for none
    least: float  # distance to keep [m]


@dataclass(frozen=True)
class Contacts:
    """The pairs that an arm keeps apart."""

    placed: PlacedCapsules  # its capsules
    obstacles: tuple[Obstacle, ...]  # the convex solids around it
    pairs: tuple[Apart, ...]  # (P,) what is kept apart; `POINTS` rows each
    reach: float  # distance [m] beyond the least one up to which a candidate is a row

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


# Pairs that the spheres about them show to be far apart are not looked at. The slope of a distance is that of its two
# points held in their bodies (Danskin 1967); its curvature is taken by differences of the slopes.
_NUMBERS = {
    "SOLID": SIZE, "BISECTIONS": BISECTIONS, "DIFFERENCE": DIFFERENCE, "POINTS": POINTS, "TINY": LEAST_LENGTH_M,
    "PARALLEL": PARALLEL,
}  # fmt: skip
C_TEXT = c_file("posture_opt.collision.obstacles", "signed_distance.c", {"LEAST": LEAST_LENGTH_M})
C_TEXT += c_file("posture_opt.collision", "contacts.c", _NUMBERS)
"""C text of ``po_scene`` and its functions, after `posture_opt.model.compiled`, around a function ``frames``."""


_LOOP = C_TEXT + packaged("posture_opt.collision", "contact_slack.c")


@dataclass(frozen=True)
class ContactSlack:
    """The least of distance less what is to be kept [m], at most the reach of the contacts."""

    contacts: Contacts  # what is kept apart
    compiled: bool | None  # None or True; there is no other way of evaluating it

    @cached_property
    def _loop(self) -> RowLoop:
        return RowLoop({"frames": self.contacts.frames}, _LOOP, self.compiled)

    @property
    def active(self) -> bool:
        """Whether anything is kept apart."""
        return bool(self.contacts.pairs)

    def slack(self, Q: Array) -> Array:
        """(N,) at the postures Q (N, n) [m]."""
        Q, slack = np.ascontiguousarray(Q), np.zeros(len(Q))
        self._loop(len(Q), Q.shape[1], Q, slack, *self.contacts.arguments)
        return slack
