"""``PlacedCapsules``: the capsules of an arm at its postures, in numbers and as symbols."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from posture_opt.model.chain import Walk, add, factor_values, scale, stack, walk
from posture_opt.model.compiled import BatchFunction
from posture_opt.numerics import Array
from posture_opt.robot.robot import BASE, TOOL, Capsule, Factor, Robot

Placed = tuple[ca.SX, ca.SX]
"""(3,) the start of the segment of a capsule, and the vector to its end [m]."""


@dataclass(frozen=True)
class PlacedCapsules:
    """Capsules of a robot, each in one of the frames of its chain: 0 the base, k behind joint k, n + 1 the tool."""

    robot: Robot  # the chain at its nominal values, without effects
    capsules: tuple[Capsule, ...]  # (c,) in the frames of their joints [m]

    @cached_property
    def frames(self) -> tuple[int, ...]:
        """(c,) index of the frame of each capsule."""
        at = {BASE: 0, TOOL: self.robot.n + 1, **{name: k + 1 for k, name in enumerate(self.robot.joint_names)}}
        return tuple(at[capsule.joint] for capsule in self.capsules)

    @cached_property
    def bodies(self) -> tuple[int, ...]:
        """(c,) the body of each capsule: 0 the base, k the link behind joint k; a tool moves with the last one."""
        return tuple(min(frame, self.robot.n) for frame in self.frames)

    @cached_property
    def radii(self) -> Array:
        """(c,) radii [m]."""
        return np.array([capsule.radius for capsule in self.capsules])

    def segments(self, Q: Array) -> tuple[Array, Array]:
        """Starts and ends (N, c, 3), (N, c, 3) of the segments at the postures Q (N, n), world [m]."""
        starts, ends = self._segment_function(Q)
        shape = len(starts), len(self.capsules), 3
        return starts.reshape(shape), ends.reshape(shape)

    @cached_property
    def _segment_function(self) -> BatchFunction:
        """Joint values (n,) -> starts and ends (3 c,), (3 c,) [m], world."""
        q = ca.SX.sym("q", self.robot.n)
        placed = self.symbols(q)
        points = [ca.vertcat(*ends) for ends in zip(*((start, start + along) for start, along in placed), strict=True)]
        return BatchFunction(ca.Function("segments", [q], [ca.densify(ca.SX(p)) for p in points]), compiled=False)

    def origins(self, Q: Array) -> Array:
        """(N, n + 2, 3) origins of the frames of the chain at the postures Q (N, n), world [m]."""
        q = ca.SX.sym("q", self.robot.n)
        points = ca.vertcat(*(ca.SX(stack([ca.SX(x) for x in reached.position])) for _, reached in self.chain(q)))
        placed = BatchFunction(ca.Function("origins", [q], [ca.densify(points)]), compiled=False)
        return np.reshape(placed(Q), (len(Q), self.robot.n + 2, 3))

    def symbols(self, q: ca.SX, seen_from: int | None = None) -> tuple[Placed, ...]:
        """Capsules at ``q`` (n,) in the world, or in a frame and for what is behind it: joints before it do not
        appear."""
        reached = [walked for _, walked in self.chain(q, seen_from)]
        placed = []
        for capsule, frame in zip(self.capsules, self.frames, strict=True):
            start, end = (_located_point(reached[frame], point) for point in (capsule.start, capsule.end))
            placed.append((start, end - start))
        return tuple(placed)

    def chain(self, q: ca.SX, seen_from: int | None = None) -> list[tuple[tuple[Factor, ...], Walk]]:
        """(n + 2) the factors of base, links and tool, and the walk along them from where the one before ends."""
        groups: Sequence[tuple[Factor, ...]] = (self.robot.base, *self.robot.links, self.robot.tool)
        values, reached, found = ca.vertsplit(q), walk((), ()), []
        for frame, factors in enumerate(groups):
            met = () if seen_from is not None and frame <= seen_from else factors
            reached = walk(met, factor_values(met, values), reached)
            found.append((met, reached))
        return found


def _located_point(reached: Walk, local: Sequence[float]) -> ca.SX:
    """(3,) a point of a frame [m], in the frame that the walk began in."""
    moved = reached.position
    for value, column in zip(local, reached.columns, strict=True):
        moved = add(moved, scale(value, column))
    return ca.SX(stack([ca.SX(entry) for entry in moved]))
