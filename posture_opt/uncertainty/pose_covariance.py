"""Covariances beyond first order of the whole tool pose, and of two points of one tool.

The chart of a pose is ``(x − x₀, log(R R₀ᵀ))``: shift from the nominal tool point, and the vector along the axis of the
rotation from the nominal orientation and as long as its angle, both in world axes. Its logarithm has no closed form in
the moments, so poses are taken at nodes for all sources; the shift x is known better, by `ToolPoint.moments`, and
replaces that of the nodes: with the regression ``φ = B x + ρ`` of the nodes the answer is ``[[C, C Bᵀ], [B C, B C Bᵀ +
Cov ρ]]``, positive semidefinite and with one covariance of the position. What effects add is to first order.

Differences from the nominal pose are formed without cancellation: rotations multiply as quaternions, of which only the
vector part is small.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from posture_opt.encoding import Encoded
from posture_opt.model.chain import Scalar, Walk, position_column, rotation_column
from posture_opt.numerics import Array
from posture_opt.statements import Quantity, Statement, state
from posture_opt.uncertainty.exact_moments import Segment, deviations
from posture_opt.uncertainty.integration import Integration, SharedSpan, converged
from posture_opt.uncertainty.regions import RANK_TOLERANCE
from posture_opt.uncertainty.tool_point import ToolPoint

# Chart and frame of a covariance of the pose, as documents state it.
POSE_FRAME = "shift and rotation vector log(R R_nominal^T), (v, w), from the nominal pose; world axes at the tool point"


@dataclass(frozen=True, eq=False)
class PoseCovariance:
    """Covariance of shift [m] and rotation vector [rad] from the nominal pose, world axes at the tool point."""

    covariance: Array  # (6, 6), (v, ω)
    integration: Integration | None  # None where nothing scatters

    @property
    def within_half_turn(self) -> bool:
        """Whether three standard deviations of the rotation stay below π, beyond which rotation vectors are cut."""
        return bool(9 * np.linalg.eigvalsh(self.covariance[3:, 3:])[-1] < np.pi**2)


def pose_covariance(tool_point: ToolPoint, q: Sequence[float], position: Array) -> PoseCovariance:
    """The covariance of the pose at q (n,) whose block of the position is ``position`` (3, 3) [m²], world."""
    whole = tool_point.arm.reach(q)

    def poses(segment: Segment) -> list[Scalar]:
        errors = {index: loading @ segment.centre.points.T for index, loading in segment.loadings.items()}
        return [*deviations(tool_point.robot.factors, whole.values, segment), *turns(whole.walk, errors)]

    linear = np.asarray(tool_point.linear_of_pose(q, tool_point.walk(q)[0]), dtype=float)
    return PoseCovariance(*_by_regression(tool_point, position, linear, poses))


def joint_covariance(tip: ToolPoint, top: ToolPoint, q: Sequence[float], of_tip: Array) -> Array:
    """(6, 6) of the shifts of two points of one tool [m²], world; ``of_tip`` (3, 3) of the first one stays as it is."""

    def shifts(segment: Segment) -> list[Scalar]:
        found: list[Scalar] = []
        for point in (tip, top):
            factors = point.robot.factors
            whole = replace(segment, last=len(factors) - 1)
            found += deviations(factors, point.arm.reach(q).values, whole)
        return found

    linear: Array = np.zeros((6, 6))
    if tip.linear is not None:
        both = [(point, point.walk(q)[0]) for point in (tip, top)]
        E = np.vstack([np.asarray(point.linear_columns(q, walk), dtype=float) for point, walk in both])
        T = np.vstack([np.asarray(point.jacobian(walk), dtype=float) for point, walk in both])
        cross = T @ tip.linear.cross @ E.T
        linear = E @ tip.linear.covariance @ E.T + cross + cross.T
    return _by_regression(tip, of_tip, linear, shifts)[0]


def _by_regression(
    tool_point: ToolPoint, position: Array, linear: Array, coordinates: Callable[[Segment], Sequence[Scalar]]
) -> tuple[Array, Integration | None]:
    """(6, 6) of six coordinates at nodes for all sources, the first three the tool point's; ``linear`` is added."""

    def moments(segments: Sequence[Segment]) -> tuple[Array, Array]:
        weights = segments[0].centre.weights
        values = np.array([np.broadcast_to(x, weights.shape) for x in coordinates(segments[0])])
        mean = values @ weights
        centred = values - mean[:, None]
        return mean, (centred * weights) @ centred.T

    found, integration, span = np.zeros((6, 6)), None, every_source(tool_point)
    if span.count:
        mixed = converged(moments, [span], 1e-4, 20_000)
        found, integration = _regressed_on(mixed.covariance, position - linear[:3, :3]), mixed.integration
    found = found + linear
    found[:3, :3] = position
    return (found + found.T) / 2, integration


def every_source(tool_point: ToolPoint) -> SharedSpan:
    """All sources of the chain as independent standard normal factors."""
    root = covariance_root(tool_point.covariance)
    root = root[:, (root != 0).any(axis=0)]
    factors = tool_point.robot.factors
    turning = [k for k, index in enumerate(tool_point.indices) if factors[index].kind == "rotate"]
    places = dict(zip(tool_point.indices, root, strict=True))
    turn = np.abs(root[turning]).sum(axis=0)
    return SharedSpan(0, len(factors) - 1, places, turn, tuple(range(root.shape[1])))


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
    return rotation_of_quaternion(w, v)


def rotation_of_quaternion(w: Scalar, v: Array) -> Array:
    """(3, N) rotation vectors [rad] of unit quaternions with real parts w (N,) and vectors v (3, N)."""
    sine = np.linalg.norm(v, axis=0)
    # q and -q are one rotation: the half of it with w >= 0 is the short way.
    angle = 2 * np.arctan2(sine, np.abs(w)) * np.where(np.asarray(w) < 0, -1.0, 1.0)
    vector: Array = v * np.divide(angle, sine, out=np.full_like(sine, 2.0), where=sine > 0)
    return vector


def angle_and_axis(phi: Array) -> tuple[Array, Array]:
    """Angles (N, 1) [rad] and unit vectors (N, 3) of rotation vectors; zeros for no rotation."""
    angle = np.linalg.norm(phi, axis=1, keepdims=True)
    return angle, np.divide(phi, angle, out=np.zeros_like(phi), where=angle > 0)


def turn_of(phi: Array, v: Array) -> Array:
    """(N, 3) ``R(φ) v − v``, by Rodrigues' formula without cancellation."""
    angle, unit = angle_and_axis(phi)
    first = np.cross(unit, v)
    return np.asarray(np.sin(angle) * first + 2 * np.sin(angle / 2) ** 2 * np.cross(unit, first))


def _regressed_on(nodes: Array, position: Array) -> Array:
    """The covariance (6, 6) of the nodes with another of the first three coordinates (3, 3), see the module."""
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


class SecondOrder(NamedTuple):
    """The parts of the expansion, world frame."""

    first: Array  # (3, 3) J Σ Jᵀ [m²]
    curvature: Array  # (3, 3) ½ tr(H_a Σ H_b Σ) [m²]
    bias: Array  # (3,) ½ tr(Σ H) [m]


def second_order(walk: Walk, indices: Sequence[int], covariance: Array) -> SecondOrder:
    """The expansion at the pose of a walk in numbers; ``indices`` (k,) the factors of the sources, ascending."""
    k = len(indices)
    J = np.array([position_column(walk, i) for i in indices], dtype=float).reshape(k, 3)
    a = np.array([rotation_column(walk, i) for i in indices], dtype=float).reshape(k, 3)
    i, j = np.indices((k, k))
    H = np.cross(a[np.minimum(i, j)], J[np.maximum(i, j)])
    HS = np.einsum("ijc,jl->cil", H, covariance)
    curvature = np.einsum("cil,dli->cd", HS, HS) / 2
    return SecondOrder(J.T @ covariance @ J, curvature, np.einsum("ij,ijc->c", covariance, H) / 2)


Verdict = Literal["good", "doubtful", "wrong"]  # good: use either covariance; doubtful and wrong: use the exact one
_MAX_GOOD_INDEX = 0.2  # up to here the nominal 95 % ellipse of planar arms held 94.5 % or more; up to 0.5 92 %
# Share of the second-order scatter from which a direction that the first order leaves at rest moves in truth; below it
# is the rounding of the direction itself.
_MOTION_SHARE = 1e-9


@dataclass(frozen=True)
class Validity(Encoded):
    """How far curvature bends the first-order picture, in units of its own standard deviations.

    ``curvature = sqrt(lambda_max(C1^+ C2))``, ``bias_mahalanobis = |C1^(-1/2) b|``, zero or more. Both are infinite
    where C1 has an axis of no width along which C2 or b is not zero: there the linear number is false however small the
    errors are. The relative error of C1 itself is dominated by the wide axis, where nothing is wrong.
    """

    curvature: float
    bias_mahalanobis: float

    @classmethod
    def of(cls, first_order: ArrayLike, second_order: ArrayLike, bias: ArrayLike) -> Validity:
        """The indices by C1 (m, m) [m²], C2 (m, m) [m²] and b (m,) [m]."""
        C1, C2 = np.asarray(first_order, dtype=float), np.asarray(second_order, dtype=float)
        b = np.asarray(bias, dtype=float).reshape(-1)
        variances, axes = np.linalg.eigh((C1 + C1.T) / 2)
        wide = variances > RANK_TOLERANCE * max(variances[-1], 0.0)
        span, null = axes[:, wide] / np.sqrt(variances[wide]), axes[:, ~wide]
        curvature = math.sqrt(_largest_eigenvalue(span.T @ C2 @ span))
        shift = float(np.linalg.norm(span.T @ b))
        if _largest_eigenvalue(null.T @ C2 @ null) > _MOTION_SHARE * np.trace(C2):
            curvature = math.inf
        if np.linalg.norm(null.T @ b) > math.sqrt(_MOTION_SHARE) * np.linalg.norm(b):
            shift = math.inf
        return cls(curvature, shift)

    @property
    def index(self) -> float:
        return max(self.curvature, self.bias_mahalanobis)

    @property
    def verdict(self) -> Verdict:
        return "good" if self.index < _MAX_GOOD_INDEX else "doubtful" if self.index < 0.5 else "wrong"

    @property
    def statement(self) -> Statement:
        """Whether the first-order ellipse may be used here."""
        if math.isinf(self.index):
            return state("uncertainty.first-order-singular")
        values = (Quantity(value, "number") for value in (self.curvature, self.bias_mahalanobis, _MAX_GOOD_INDEX))
        curvature, shift, limit = values
        return state(f"uncertainty.first-order-{self.verdict}", curvature=curvature, shift=shift, limit=limit)

    @property
    def text(self) -> str:
        return self.statement.text

    def fields_json(self) -> dict[str, object]:
        return {
            "curvature": self.curvature,
            "curvature_infinite": math.isinf(self.curvature),
            "bias_mahalanobis": self.bias_mahalanobis,
            "bias_infinite": math.isinf(self.bias_mahalanobis),
            "verdict": self.verdict,
            "text": self.text,
        }


def _largest_eigenvalue(matrix: Array) -> float:
    """Zero at least; of nothing, zero."""
    return max(float(np.linalg.eigvalsh((matrix + matrix.T) / 2)[-1]), 0.0) if matrix.size else 0.0
