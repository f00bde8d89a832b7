"""The covariance of the whole tool pose: shift of its point and rotation vector, beyond first order.

The chart is ``(x − x₀, log(R R₀ᵀ))``: shift from the nominal tool point and the vector, along the axis and as long as
the angle, of the rotation from the nominal orientation, both in world axes. Its logarithm has no closed form in the
moments, so poses are taken at nodes for all sources; the shift is known better, by `ToolPoint.moments`, and replaces
that of the nodes: with the regression ``φ = B x + ρ`` of the nodes the answer is ``[[C, C Bᵀ], [B C, B C Bᵀ + Cov
ρ]]``, positive semidefinite and with one covariance of the position.

Differences from the nominal pose are formed without cancellation: rotations multiply as quaternions, of which only the
vector part is small.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from posture_opt.model.chain import Scalar, Walk
from posture_opt.numerics import Array
from posture_opt.uncertainty.moments.conditional_moments import Segment, deviations
from posture_opt.uncertainty.moments.integration import Integration, SharedSpan, converged
from posture_opt.uncertainty.moments.tool_point import ToolPoint
from posture_opt.uncertainty.regions.regions import RANK_TOLERANCE

POSE_FRAME = "shift and rotation vector log(R R_nominal^T), (v, w), from the nominal pose; world axes at the tool point"
"""Chart and frame of a covariance of the pose, as documents state it."""

_VARIANCE_TOLERANCE = 1e-4
"""Relative error along any direction of the six at which no more nodes are tried."""
_MAX_NODES = 20_000
"""Nodes of a product rule."""


@dataclass(frozen=True, eq=False)
class PoseCovariance:
    """Covariance of shift [m] and rotation vector [rad] from the nominal pose, world axes at the tool point.

    Args:
        covariance: (6, 6), ``(v, ω)``.
        integration: how it was found; ``relative_error`` is that of the variance along any direction of the six. None
            where nothing scatters.
    """

    covariance: Array
    integration: Integration | None

    @property
    def within_half_turn(self) -> bool:
        """Whether three standard deviations of the rotation stay below π.

        Beyond, rotation vectors are cut: a turn by more than π is the opposite one by less, and their covariance says
        little of how the tool turns.
        """
        return bool(9 * np.linalg.eigvalsh(self.covariance[3:, 3:])[-1] < np.pi**2)


def pose_covariance(tool_point: ToolPoint, q: Sequence[float], position: Array) -> PoseCovariance:
    """The covariance of the pose whose block of the position is ``position``.

    Effects enter to first order, as they do in the position.

    Args:
        tool_point: arm and sources.
        q: (n,) posture [rad or m].
        position: (3, 3) covariance of the tool point [m²], world.
    """
    linear = np.asarray(tool_point.linear_of_pose(q, tool_point.walk(q)[0]), dtype=float)
    chain, integration = position - linear[:3, :3], None
    found = np.zeros((6, 6))
    found[:3, :3] = chain
    span = every_source(tool_point)
    if span.count:
        mixed = converged(
            lambda segments: _at_nodes(tool_point, q, segments[0]), [span], _VARIANCE_TOLERANCE, _MAX_NODES
        )
        found, integration = regressed_on(mixed.covariance, chain), mixed.integration
    found = found + linear
    found[:3, :3] = position
    return PoseCovariance((found + found.T) / 2, integration)


def every_source(tool_point: ToolPoint) -> SharedSpan:
    """All sources of the chain as independent standard normal factors."""
    root = covariance_root(tool_point.covariance)
    root = root[:, (root != 0).any(axis=0)]
    places = dict(zip(tool_point.indices, root, strict=True))
    turning = [k for k, index in enumerate(tool_point.indices) if tool_point.robot.factors[index].kind == "rotate"]
    last = len(tool_point.robot.factors) - 1
    return SharedSpan(0, last, places, root[turning], tuple(range(root.shape[1])))


def _at_nodes(tool_point: ToolPoint, q: Sequence[float], segment: Segment) -> tuple[Array, Array]:
    """Mean (6,) and covariance (6, 6) of shift and rotation vector over nodes for the sources of the chain."""
    whole = tool_point.arm.reach(q)
    weights = segment.centre.weights
    errors = {index: loading @ segment.centre.points.T for index, loading in segment.loadings.items()}
    shift = deviations(tool_point.robot.factors, whole.values, segment)
    parts = [np.broadcast_to(x, weights.shape) for x in (*shift, *turns(whole.walk, errors))]
    poses = np.array(parts)
    mean = poses @ weights
    centred = poses - mean[:, None]
    return mean, (centred * weights) @ centred.T


def turns(nominal: Walk, errors: dict[int, Array]) -> Array:
    """(3, N) rotation vectors of ``R R₀ᵀ`` in world axes [rad] for errors (N,) of factors of the chain.

    ``R R₀ᵀ = Π_i exp(ε_i a_i)`` with the axes ``a_i`` of the nominal chain, from the base to the tool.
    """
    w: Scalar = 1.0
    v = np.zeros((3, 1))
    for index in sorted(errors):
        screw = nominal.screws[index]
        if screw.rotates:
            axis = np.array(screw.axis, dtype=float)[:, None]
            wi, vi = np.cos(errors[index] / 2), axis * np.sin(errors[index] / 2)
            w, v = w * wi - (v * vi).sum(axis=0), w * vi + wi * v + np.cross(v, vi, axis=0)
    sine = np.linalg.norm(v, axis=0)
    # q and -q are one rotation: the half of it with w >= 0 is the short way.
    angle = 2 * np.arctan2(sine, np.abs(w)) * np.where(np.asarray(w) < 0, -1.0, 1.0)
    vector: Array = v * np.divide(angle, sine, out=np.full_like(sine, 2.0), where=sine > 0)
    return vector


def regressed_on(nodes: Array, position: Array) -> Array:
    """The covariance (6, 6) of the nodes with another one of the position (3, 3), by regression of the rotation on
    it.
    """
    xx, px, pp = nodes[:3, :3], nodes[3:, :3], nodes[3:, 3:]
    variances, axes = np.linalg.eigh(xx)
    wide = variances > RANK_TOLERANCE * max(float(variances[-1]), 0.0)
    B = (px @ axes[:, wide] / variances[wide]) @ axes[:, wide].T
    rest = pp - B @ xx @ B.T
    values, vectors = np.linalg.eigh((rest + rest.T) / 2)
    rest = (vectors * np.maximum(values, 0.0)) @ vectors.T  # what rounding left below zero is zero
    return np.block([[position, position @ B.T], [B @ position, B @ position @ B.T + rest]])


def covariance_root(covariance: Array) -> Array:
    """(k, k) A with ``A Aᵀ = Σ``, for semidefinite Σ (k, k) too; it is taken of the correlations, as units differ."""
    sigma = np.sqrt(np.diag(covariance))
    if not len(sigma):
        return np.zeros((0, 0))
    values, vectors = np.linalg.eigh(covariance / np.outer(sigma, sigma))
    root: Array = sigma[:, None] * vectors * np.sqrt(np.clip(values, 0, None))
    return root
