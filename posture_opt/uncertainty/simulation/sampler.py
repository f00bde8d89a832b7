"""Random tool poses: errors drawn from their covariance and sent through the full forward model."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from posture_opt.model.arm import Arm
from posture_opt.model.chain import ZERO, Vector, Walk
from posture_opt.numerics import Array
from posture_opt.uncertainty.moments.pose_covariance import covariance_root
from posture_opt.uncertainty.regions.regions import Ellipsoid
from posture_opt.uncertainty.simulation.relative_poses import relative_poses
from posture_opt.uncertainty.spread.spread import Spread

PAIRS = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
"""The entries of a symmetric (3, 3) matrix: xx, xy, xz, yy, yz, zz."""

Poses = tuple[Array, Array]
"""Shifts of the tool point (N, 3) [m] and rotation vectors (N, 3) [rad] from the nominal pose, world axes."""


@dataclass(frozen=True, eq=False)
class Sampler:
    """Draws tool poses: shift of the tool point (N, 3) [m] and rotation vector (N, 3) [rad] from the nominal pose.

    With errors of the workpiece among the sources they are those relative to it, see `relative_poses`.

    Args:
        q: (n,) posture [rad or m].
        names: (k,) of the sources, ``root`` (k, k) of their covariance, see `covariance_root`.
        nominal: the walk without errors.
        lever: (3,) from the workpiece's origin to the tool point [m], world.
    """

    arm: Arm
    q: tuple[float, ...]
    names: tuple[str, ...]
    root: Array
    nominal: Walk
    lever: Vector = ZERO

    @classmethod
    def of(cls, spread: Spread) -> Sampler:
        """The sampler of robot, posture and sources of a closed-form spread."""
        tool_point = spread.tool_point
        names, covariance = tool_point.names, tool_point.covariance
        if tool_point.linear is not None:
            linear = tool_point.linear
            names = (*names, *linear.names)
            covariance = np.block([[covariance, linear.cross], [linear.cross.T, linear.covariance]])
        kept = np.flatnonzero(np.diag(covariance) > 0)
        root = covariance_root(covariance[np.ix_(kept, kept)])
        nominal = tool_point.walk(spread.q)[0]
        return cls(tool_point.arm, spread.q, tuple(names[k] for k in kept), root, nominal, tool_point.lever)

    def __call__(self, rng: np.random.Generator, n: int) -> Poses:
        """n draws: shifts (n, 3) [m] and rotation vectors (n, 3) [rad], world axes."""
        return self.both(rng, n)[1]

    def both(self, rng: np.random.Generator, n: int) -> tuple[Poses, Poses]:
        """n draws in the world, and the same ones relative to the workpiece that is drawn with them."""
        p = rng.standard_normal((n, len(self.names))) @ self.root.T
        named = dict(zip(self.names, p.T, strict=True))
        for side in self.arm.unknown_sides:
            named[side] = np.where(named[side] < 0, -1.0, 1.0)  # increasing or decreasing, each as likely
        reached = self.arm.reach(self.q, named).walk
        position = np.stack([np.broadcast_to(entry, n) for entry in reached.position], axis=-1)
        shift = position - np.array(self.nominal.position, dtype=float)
        poses = shift, rotation_vector(reached, self.nominal, n)
        return poses, relative_poses(*poses, named, self.lever)


def rotation_vector(reached: Walk, nominal: Walk, n: int) -> Array:
    """(n, 3) logarithm of ``R_reached R_nominalᵀ`` in world axes [rad]."""
    R = np.array([[np.broadcast_to(entry, n) for entry in column] for column in reached.columns])
    R0 = np.array(nominal.columns, dtype=float)
    turned = np.einsum("kan,kb->nab", R, R0)
    axial = np.stack([turned[:, 2, 1] - turned[:, 1, 2], turned[:, 0, 2] - turned[:, 2, 0],
                      turned[:, 1, 0] - turned[:, 0, 1]], axis=-1) / 2  # fmt: skip
    sine = np.linalg.norm(axial, axis=1)
    angle = np.arctan2(sine, (np.trace(turned, axis1=1, axis2=2) - 1) / 2)
    vector: Array = axial * np.divide(angle, sine, out=np.ones_like(sine), where=sine > 0)[:, None]
    return vector


class PowerSums:
    """Sums of powers of sampled deviations from the closed-form mean, where nothing cancels."""

    def __init__(self, spread: Spread) -> None:
        self.spread = spread
        self.first: Array = np.zeros(6)
        self.second: Array = np.zeros((6, 6))
        self.fourth: Array = np.zeros((6, 6))
        self.inside: int = 0
        self.hits: int = 0
        # In coordinates about the nominal point: a micrometre on a metre would lose ten digits.
        self._region = Ellipsoid(spread.bias, spread.covariance).project(spread.basis)

    def add(self, shift: Array, rotation: Array) -> None:
        """Take in a block of shifts (N, 3) [m] and rotation vectors (N, 3) [rad] from the nominal pose."""
        spread = self.spread
        centred = shift - spread.bias
        pose = np.hstack([centred, rotation])
        products = np.stack([centred[:, i] * centred[:, j] for i, j in PAIRS], axis=-1)
        self.first += pose.sum(axis=0)
        self.second += pose.T @ pose
        self.fourth += products.T @ products
        if spread.for_task is not None:
            self.hits += spread.for_task.hits(shift, rotation)
        self.inside += int(np.count_nonzero(self._region.contains(shift @ spread.basis.T, 0.95)))

    def moments(self, n: int) -> tuple[Array, Array]:
        """(6,) sample mean less the closed-form one, and (6, 6) sample covariance, of shift and rotation vector."""
        offset = self.first / n
        covariance: Array = (self.second - n * np.outer(offset, offset)) / (n - 1)
        return offset, covariance

    def covariance_of_covariance(self, n: int) -> Array:
        """(6, 6) of the `PAIRS` of the sample covariance, leaving out terms of relative order 1 / n."""
        entries = np.array([self.second[i, j] for i, j in PAIRS]) / n
        result: Array = (self.fourth / n - np.outer(entries, entries)) / (n - 1)
        return result
