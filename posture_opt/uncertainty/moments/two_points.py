"""Two points of one tool: their joint covariance, and the probability that both stay within a clearance."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from posture_opt.model.chain import Vector
from posture_opt.numerics import TURN, Array
from posture_opt.uncertainty.moments.conditional_moments import Segment, deviations
from posture_opt.uncertainty.moments.integration import converged
from posture_opt.uncertainty.moments.pose_covariance import every_source, regressed_on
from posture_opt.uncertainty.moments.tool_point import ToolPoint
from posture_opt.uncertainty.regions.clearance import miss_probability

_VARIANCE_TOLERANCE, _MAX_NODES = 1e-4, 20_000
"""Relative error along any direction, and nodes of a product rule, as of the covariance of the pose."""
_LATTICE_SHIFTS, _LATTICE_NODES = 8, 4096
"""Random shifts, and directions of each, of a lattice in up to four dimensions."""
_LATTICE_STEPS = (
    0.8191725133961645,
    0.6710436067037893,
    0.5497004779019703,
)
"""Powers of the inverse of the root of ``x⁴ = x + 1``."""


@dataclass(frozen=True)
class JointProbability:
    """Probability that both points stay within the clearance.

    Args:
        probability: 0 to 1.
        error: twice its standard error by integration; 0 where the bounds meet.
    """

    probability: float
    error: float


def joint_covariance(tip: ToolPoint, top: ToolPoint, q: Sequence[float], of_tip: Array) -> Array:
    """(6, 6) of the shifts of two points of one tool [m²], world.

    At nodes for all sources, to 1e-4 of the variance in any direction; what effects add to first order.

    Args:
        tip, top: the two points, under the same errors.
        q: (n,) posture [rad or m].
        of_tip: (3, 3) covariance of the first one [m²], which the answer keeps.
    """
    linear = np.asarray(_effect_covariance(tip, top, q))
    chain = of_tip - linear[:3, :3]
    found = np.zeros((6, 6))
    found[:3, :3] = found[:3, 3:] = found[3:, :3] = found[3:, 3:] = chain
    span = every_source(tip)
    if span.count:
        nodes = converged(
            lambda segments: _at_nodes(tip, top, q, segments[0]), [span], _VARIANCE_TOLERANCE, _MAX_NODES
        ).covariance
        found = regressed_on(nodes, chain)
    found = found + linear
    return np.asarray((found + found.T) / 2)


def _at_nodes(tip: ToolPoint, top: ToolPoint, q: Sequence[float], segment: Segment) -> tuple[Array, Array]:
    """Mean (6,) and covariance (6, 6) of both shifts [m] over nodes for the sources of the chain."""
    shifts = [_point_shift(point, q, segment) for point in (tip, top)]
    weights = segment.centre.weights
    points = np.array([np.broadcast_to(x, weights.shape) for shift in shifts for x in shift])
    mean = points @ weights
    centred = points - mean[:, None]
    return mean, (centred * weights) @ centred.T


def _point_shift(point: ToolPoint, q: Sequence[float], segment: Segment) -> Vector:
    """(3,) shift of one point [m] at the nodes (N,) of the tip's segment."""
    factors = point.robot.factors
    return deviations(factors, point.arm.reach(q).values, replace(segment, last=len(factors) - 1))


def _effect_covariance(tip: ToolPoint, top: ToolPoint, q: Sequence[float]) -> Array:
    """(6, 6) what the effects add, to first order."""
    if tip.linear is None:
        return np.zeros((6, 6))
    walks = [point.walk(q)[0] for point in (tip, top)]
    both = list(zip((tip, top), walks, strict=True))
    E = np.vstack([np.asarray(point.linear_columns(q, walk), dtype=float) for point, walk in both])
    T = np.vstack([np.asarray(point.jacobian(walk), dtype=float) for point, walk in both])
    cross = T @ tip.linear.cross @ E.T
    return np.asarray(E @ tip.linear.covariance @ E.T + cross + cross.T)


def both_within(covariance: Array, clearance: float, bias: Array) -> JointProbability:
    """The probability that two points, each of m coordinates, both lie within a circle (m = 2) or interval (m = 1).

    With ``x = b + ρ A u``, ``A Aᵀ = C`` the ray in the direction u is inside of both from ``ρ₁(u)`` to ``ρ₂(u)``, and
    ``P = E_u[Q(ρ₁²) − Q(ρ₂²)]`` with the tail Q of χ² with 2 m degrees of freedom: ``e^{−x/2}``, times ``1 + x/2`` for
    m = 2. The mean over directions is taken at a shifted lattice; the misses of each point alone are known exactly and
    bound it from both sides (Fréchet).

    Args:
        covariance: (2 m, 2 m) [m²], the first point first.
        clearance: radius [m].
        bias: (2 m,) means [m].
    """
    m = len(bias) // 2
    values, vectors = np.linalg.eigh((covariance + covariance.T) / 2)
    root = vectors * np.sqrt(np.clip(values, 0, None))
    alone = [miss_probability(covariance[k : k + m, k : k + m], clearance, bias[k : k + m]) for k in (0, m)]
    means = np.array([_miss_on_rays(root, bias, clearance, m, u) for u in _direction_sets(2 * m)])
    least, most = max(alone), min(sum(alone), 1.0)
    miss = float(np.clip(means.mean(), least, most))
    error = 2 * float(means.std(ddof=1)) / math.sqrt(len(means))
    return JointProbability(1 - miss, min(error, most - least))


def _miss_on_rays(root: Array, bias: Array, clearance: float, m: int, u: Array) -> float:
    """Mean over directions (N, 2 m) of the probability to lie outside of one of both on that ray."""
    steps = u @ root.T
    near, far = np.zeros(len(u)), np.full(len(u), np.inf)
    for k in (0, m):
        b, d = bias[k : k + m], steps[:, k : k + m]
        power = float((clearance - np.linalg.norm(b)) * (clearance + np.linalg.norm(b)))
        A, B = (d**2).sum(axis=1), d @ b
        inside = B**2 + A * power
        with np.errstate(all="ignore"):
            reach = np.sqrt(np.maximum(inside, 0))
            # Of the two forms of a root take the one that does not subtract.
            last = np.where(B > 0, power / (B + reach), (reach - B) / A)
            first = np.where(B > 0, -(reach + B) / A, power / (B - reach))
        empty = inside < 0 if power < 0 else np.zeros(len(u), dtype=bool)
        still = A == 0
        last = np.where(empty, 0.0, np.where(still, np.inf if power >= 0 else 0.0, last))
        first = np.where(empty | still, 0.0, first)
        near, far = np.maximum(near, first), np.minimum(far, last)
    far = np.maximum(far, near)
    return float(np.mean(_chi2_tail(far**2, m) + 1 - _chi2_tail(near**2, m)))


def _chi2_tail(x: Array, m: int) -> Array:
    """Probability beyond x (N,) of the χ² distribution with 2 m degrees of freedom, m = 1 or 2."""
    with np.errstate(invalid="ignore"):
        tail = np.exp(-x / 2) * (1.0 if m == 1 else 1 + x / 2)
    return np.where(np.isfinite(x), tail, 0.0)


def _direction_sets(size: int) -> list[Array]:
    """`_LATTICE_SHIFTS` sets (N, size) of unit vectors, spread evenly over the circle or the sphere in 4D."""
    rng, steps = np.random.default_rng(0), np.arange(_LATTICE_NODES)[:, None]
    sets = []
    for _ in range(_LATTICE_SHIFTS):
        if size == 2:
            angle = TURN * (steps[:, 0] + rng.uniform()) / _LATTICE_NODES
            sets.append(np.column_stack([np.cos(angle), np.sin(angle)]))
            continue
        s, a, b = np.mod(steps * np.array(_LATTICE_STEPS) + rng.uniform(size=3), 1.0).T
        inner, outer = np.sqrt(s), np.sqrt(1 - s)
        first, second = TURN * a, TURN * b
        sets.append(
            np.column_stack(
                [inner * np.cos(first), inner * np.sin(first), outer * np.cos(second), outer * np.sin(second)]
            )
        )
    return sets
