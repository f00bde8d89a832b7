"""Random tool poses: errors drawn from their covariance and sent through the full forward model; sampling errors.

Blocks of trials are drawn until the mean, the standard uncertainties, the correlations and the coverage factor have all
settled in the number of digits asked for.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from posture_opt.errors import InputError
from posture_opt.model.arm import Arm
from posture_opt.model.chain import ZERO, Vector, Walk
from posture_opt.numerics import Array
from posture_opt.uncertainty.pose_covariance import (
    angle_and_axis,
    covariance_root,
    rotation_of_quaternion,
    turn_of,
)
from posture_opt.uncertainty.regions import NORMAL95, Ellipsoid
from posture_opt.uncertainty.sources import ANGLE, COORDINATES, FEATURE, POSITION, of_workpiece
from posture_opt.uncertainty.spread import Spread

_PAIRS = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))  # of a symmetric (3, 3) matrix: xx, xy, xz, yy, yz, zz

# Shifts of the tool point (N, 3) [m] and rotation vectors (N, 3) [rad] from the nominal pose, world axes.
Poses = tuple[Array, Array]
Interval = tuple[float, float]


@dataclass(frozen=True, eq=False)
class Sampler:
    """Draws tool poses, also relative to a workpiece whose errors are among the sources."""

    arm: Arm
    q: tuple[float, ...]  # (n,) posture [rad or m]
    names: tuple[str, ...]  # (k,) of the sources
    root: Array  # (k, k) of their covariance, see `covariance_root`
    nominal: Walk  # without errors
    lever: Vector = ZERO  # (3,) from the workpiece's origin to the tool point [m], world

    @classmethod
    def of(cls, spread: Spread) -> Sampler:
        """The sampler of robot, posture and sources of a closed-form spread."""
        tool_point = spread.tool_point
        names, covariance = tool_point.every_source
        kept = np.flatnonzero(np.diag(covariance) > 0)
        root, nominal = covariance_root(covariance[np.ix_(kept, kept)]), tool_point.walk(spread.q)[0]
        return cls(tool_point.arm, spread.q, tuple(names[k] for k in kept), root, nominal, tool_point.lever)

    def __call__(self, rng: np.random.Generator, n: int) -> Poses:
        """n draws, relative to the workpiece if it is drawn with them."""
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
        poses = shift, _rotation_vector(reached, self.nominal, n)
        return poses, _relative_poses(*poses, named, self.lever)


def _rotation_vector(reached: Walk, nominal: Walk, n: int) -> Array:
    """(n, 3) logarithm of ``R_reached R_nominalᵀ`` in world axes [rad]."""
    R = np.array([[np.broadcast_to(entry, n) for entry in column] for column in reached.columns])
    turned = np.einsum("kan,kb->nab", R, np.array(nominal.columns, dtype=float))
    i, j = [2, 0, 1], [1, 2, 0]
    axial = (turned[:, i, j] - turned[:, j, i]) / 2
    sine = np.linalg.norm(axial, axis=1)
    angle = np.arctan2(sine, (np.trace(turned, axis1=1, axis2=2) - 1) / 2)
    vector: Array = axial * np.divide(angle, sine, out=np.ones_like(sine), where=sine > 0)[:, None]
    return vector


def _relative_poses(shift: Array, rotation: Array, named: Mapping[str, Array], lever: Vector) -> Poses:
    """Poses relative to a feature, in its nominal axes, by the errors (N,) of workpiece and feature among ``named``.

    The workpiece with the shift t and the turn R(φ) about its origin brings its feature at the lever l (3,) [m], world,
    itself off by f, to ``t + R (l + f)``. In its frame the tool with the error e is off by ``Rᵀ (e − t − (R − 1) l) −
    f``, turned by ``Rᵀ R_tool``: the whole motion, not its first order.
    """
    if not any(map(of_workpiece, named)):
        return shift, rotation
    zero = np.zeros(len(shift))
    t, phi, f = (
        np.stack([named.get(f"{stated}.{c}", zero) for c in COORDINATES], axis=-1)
        for stated in (POSITION, ANGLE, FEATURE)
    )
    off = shift - t - turn_of(phi, np.broadcast_to(np.asarray(lever, dtype=float), shift.shape))
    # R(−φ) R(rotation) as a product of quaternions.
    (angle_a, a), (angle_b, b) = angle_and_axis(-phi), angle_and_axis(rotation)
    wa, va, wb, vb = np.cos(angle_a / 2), a * np.sin(angle_a / 2), np.cos(angle_b / 2), b * np.sin(angle_b / 2)
    w, v = wa * wb - np.sum(va * vb, axis=1, keepdims=True), wa * vb + wb * va + np.cross(va, vb)
    return off + turn_of(-phi, off) - f, rotation_of_quaternion(w[:, 0], v.T).T


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
        products = np.stack([centred[:, i] * centred[:, j] for i, j in _PAIRS], axis=-1)
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
        """(6, 6) of the entries xx, xy, xz, yy, yz, zz, leaving out terms of relative order 1 / n."""
        entries = np.array([self.second[i, j] for i, j in _PAIRS]) / n
        result: Array = (self.fourth / n - np.outer(entries, entries)) / (n - 1)
        return result


def variance_intervals(axes: Array, values: Array, covariance_of_covariance: Array) -> Array:
    """(m, 2) 95 % sampling intervals of variances (m,) [m²] along unit vectors (m, 3), one a row, from (6, 6) [m⁴].

    To first order a variance moves by ``vᵀ dC v``; the interval is symmetric in the logarithm, which keeps it positive.
    """
    weights = np.array([[(2 - (i == j)) * v[i] * v[j] for i, j in _PAIRS] for v in axes])
    variance = np.einsum("ma,ab,mb->m", weights, covariance_of_covariance, weights)
    relative = np.sqrt(np.clip(variance, 0, None)) / np.where(values > 0, values, 1.0)
    return np.stack([values * np.exp(-NORMAL95 * relative), values * np.exp(NORMAL95 * relative)], axis=-1)


def wilson_interval(inside: int, n: int) -> Interval:
    """The 95 % score interval of ``inside`` of n trials (E. B. Wilson, J. Am. Stat. Assoc. 22 (1927) 209)."""
    p, z2 = inside / n, NORMAL95**2 / n
    centre, half = p + z2 / 2, math.sqrt(z2 * (p * (1 - p) + z2 / 4))
    return max(0.0, (centre - half) / (1 + z2)), min(1.0, (centre + half) / (1 + z2))


def symmetric_matrix(entries: Array) -> Array:
    """(3, 3) symmetric matrix of its entries (6,) xx, xy, xz, yy, yz, zz."""
    full = np.zeros((3, 3))
    for value, (i, j) in zip(entries, _PAIRS, strict=True):
        full[i, j] = full[j, i] = value
    return full


Draw = Callable[[int, np.random.Generator], Array]  # (M, generator) -> (M, m) trials of the output


@dataclass(frozen=True, eq=False)
class Digits:
    """One number for each quantity watched: the tolerances, or twice the standard errors reached."""

    mean: Array  # (m,) of the means
    uncertainty: Array  # (m,) of the standard uncertainties
    correlation: float  # of the largest eigenvalue of the correlation matrix
    coverage_factor: float  # of kp

    def within(self, tolerances: Digits) -> bool:
        """Whether each number is at most its tolerance."""
        return all(bool(np.all(value <= getattr(tolerances, name))) for name, value in vars(self).items())


@dataclass(frozen=True, eq=False)
class AdaptiveResult:
    """What the adaptive procedure found; ``stable`` is False where the most blocks came first."""

    mean: Array  # (m,)
    covariance: Array  # (m, m), n - 1 in the denominator
    n: int  # trials
    blocks: int
    kp: float  # of the ellipsoid (y - mean)' C^-1 (y - mean) <= kp^2 that holds p of the trials
    kq: float  # of the box |y_j - mean_j| <= kq u_j that holds p of the trials
    stable: bool
    tolerances: Digits
    reached: Digits
    digits: int  # significant ones that were asked for

    @property
    def uncertainty(self) -> Array:
        """(m,) standard uncertainties, the roots of the diagonal of the covariance."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @property
    def correlation(self) -> Array:
        return correlation_matrix(self.covariance)


def adaptive(
    draw: Draw, p: float = 0.95, digits: int = 2, seed: int | None = None, max_blocks: int = 200
) -> AdaptiveResult:
    """Draw blocks of trials until the results are stable in ``digits`` significant decimal digits.

    Blocks of ``M = max(ceil(100 / (1 - p)), 10^4)`` trials, at least ten. Stable is what has twice the standard error
    of the mean over blocks, ``2 s / sqrt(h)``, of every mean, every u, lambda_max(R) and kp, at or below the numerical
    tolerance of that u (for the means too), of lambda_max and of kp; each further digit takes a hundred times the
    trials. Source: JCGM 102:2011, 7.8; for one quantity JCGM 101:2008, 7.9.
    """
    least = 10
    if not 0 < p < 1 or digits < 1 or max_blocks < least:
        raise InputError(f"0 < p < 1, one digit and {least} blocks at least: not {p:g}, {digits}, {max_blocks}")
    size = max(math.ceil(100 / (1 - p)), 10_000)
    rng = np.random.default_rng(seed or 0)
    trials: list[Array] = []
    summaries: list[Array] = []
    while True:
        block = np.asarray(draw(size, rng), dtype=float)
        if block.ndim != 2 or len(block) != size or not np.isfinite(block).all():
            raise InputError(f"{size} finite trials (M, m) were asked for; {block.shape} came")
        trials.append(block)
        summaries.append(_block_summary(block, p))
        if len(trials) >= least:
            reached, tolerances = _reached_digits(np.array(summaries), digits)
            stable = reached.within(tolerances)
            if stable or len(trials) == max_blocks:
                break
    y = np.concatenate(trials)
    mean, covariance = y.mean(axis=0), np.atleast_2d(np.cov(y, rowvar=False))
    return AdaptiveResult(
        mean, covariance, len(y), len(trials), *coverage_factors(y, p), stable, tolerances, reached, digits
    )


def coverage_factors(samples: ArrayLike, p: float = 0.95) -> tuple[float, float]:
    """kp of the ellipsoid and kq of the box, about the sample mean, that hold the part p of samples (N, m).

    The p-quantiles of ``sqrt((y - mean)' C^-1 (y - mean))`` and of ``max_j |y_j - mean_j| / u_j``: unlike the factors
    of a Gaussian they are right for any distribution. JCGM 102:2011, 7.7.
    """
    y = np.asarray(samples, dtype=float)
    mean, covariance = y.mean(axis=0), np.atleast_2d(np.cov(y, rowvar=False))
    u = np.sqrt(np.diag(covariance))
    outward = np.divide(np.abs(y - mean), u, out=np.zeros_like(y), where=u > 0).max(axis=1)
    # About the mean, so that a micrometre on a metre keeps its digits.
    distance = Ellipsoid(np.zeros_like(mean), covariance).mahalanobis(y - mean)
    return float(np.quantile(distance, p)), float(np.quantile(outward, p))


def numerical_tolerance(value: float, digits: int) -> float:
    """Half a unit of the last of ``digits`` significant decimal digits; zero of zero. JCGM 101:2008, 7.9.2.

    ``10^l / 2`` with ``value = c 10^l``, c a whole number of that many digits.
    """
    if value == 0:
        return 0.0
    # Through the decimal rounding itself: 0.0996 is 0.10 in two digits, whose last one is worth 0.01.
    exponent = int(f"{abs(value):.{digits - 1}e}".partition("e")[2])
    return 10.0 ** (exponent - digits + 1) / 2


def correlation_matrix(covariance: ArrayLike) -> Array:
    """(m, m) correlations of a covariance (m, m); zero for a quantity that does not vary."""
    C = np.asarray(covariance, dtype=float)
    u = np.sqrt(np.diag(C))
    scale = np.outer(u, u)
    R: Array = np.divide(C, scale, out=np.zeros_like(C), where=scale > 0)
    np.fill_diagonal(R, 1.0)
    return R


def _block_summary(y: Array, p: float) -> Array:
    """(2 m + 2,) means, standard uncertainties, largest eigenvalue of the correlations and kp of one block."""
    covariance = np.atleast_2d(np.cov(y, rowvar=False))
    largest = float(np.linalg.eigvalsh(correlation_matrix(covariance))[-1])
    return np.concatenate([y.mean(axis=0), np.sqrt(np.diag(covariance)), [largest, coverage_factors(y, p)[0]]])


def _reached_digits(summaries: Array, digits: int) -> tuple[Digits, Digits]:
    """Twice the standard errors of the means over blocks (h, 2 m + 2), and what they have to reach."""
    m = (summaries.shape[1] - 2) // 2
    average = summaries.mean(axis=0)
    error = 2 * summaries.std(axis=0, ddof=1) / math.sqrt(len(summaries))
    delta = np.array([numerical_tolerance(float(value), digits) for value in average[m:]])
    reached = Digits(error[:m], error[m : 2 * m], float(error[-2]), float(error[-1]))
    return reached, Digits(delta[:m], delta[:m], float(delta[-2]), float(delta[-1]))
