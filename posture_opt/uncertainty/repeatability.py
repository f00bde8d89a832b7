"""ISO 9283 accuracy AP and repeatability RP: of samples, of a covariance, and joint errors that have a stated RP.

``RP = mean(l) + 3 S_l`` with ``l_j`` the distance of attained position j from the mean of them. RP is a single number
and sees neither direction nor shape: shrinking the lesser axis of an ellipse a hundredfold lowers it by a fifth.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from posture_opt.errors import InputError, InsufficientDataError, Issue, one_of
from posture_opt.model.chain import factor_values, position_column, stack, walk
from posture_opt.numerics import TURN, Array
from posture_opt.robot.robot import Joint, Robot
from posture_opt.uncertainty.regions import hotelling_factor
from posture_opt.uncertainty.sources import Sources
from posture_opt.units import shown

Interval = tuple[float, float]


@dataclass(frozen=True)
class PositionPerformance:
    """AP and RP of one commanded position, each with the interval in which sampling leaves the true value."""

    n: int  # number of cycles (30 in the standard)
    accuracy: float  # AP, distance of the mean attained position from the commanded one [m]
    accuracy_interval: Interval  # see `position_accuracy` [m]
    repeatability: float  # RP = mean(l) + 3 S_l [m]
    repeatability_interval: Interval  # for Gaussian scatter of the sample's shape, by simulating the test itself [m]


@dataclass(frozen=True)
class OrientationPerformance:
    """AP and RP of one angle: ``AP = mean(a) - a_c`` and the half width ``RP = 3 S_a`` [rad], from n cycles."""

    n: int
    accuracy: float
    repeatability: float


@dataclass(frozen=True)
class RepeatabilitySampling:
    """How RP of n cycles scatters about the RP of infinitely many, as ratios of the two."""

    bias: float  # mean of the ratio, minus one; below zero, as the mean position is fitted to the same cycles
    sd: float  # standard deviation of the ratio
    interval: Interval  # quantiles (1 - p) / 2 and (1 + p) / 2 of the ratio


def position_performance(
    attained: ArrayLike, commanded: ArrayLike, p: float = 0.95, seed: int | None = None
) -> PositionPerformance:
    """AP and RP of positions attained (n, d) [m], d = 1, 2 or 3, for one commanded position (d,) [m].

    ``AP = |mean(x) - x_c|``, ``l_j = |x_j - mean(x)|``, ``RP = mean(l) + 3 S_l``, ``S_l`` with n - 1. The intervals
    have the probability p. Source: ISO 9283:1998, 7.2.1 and 7.2.2.
    """
    accuracy, interval = position_accuracy(attained, commanded, p)
    x = _checked_cycles(attained)
    n, distance = len(x), np.linalg.norm(x - x.mean(axis=0), axis=1)
    repeatability = float(distance.mean() + 3 * distance.std(ddof=1))
    covariance = np.atleast_2d(np.cov(x, rowvar=False))
    low, high = repeatability_sampling(covariance, n, p, seed=seed).interval if repeatability else (1.0, 1.0)
    return PositionPerformance(n, accuracy, interval, repeatability, (repeatability / high, repeatability / low))


def position_accuracy(attained: ArrayLike, commanded: ArrayLike, p: float = 0.95) -> tuple[float, Interval]:
    """AP and its interval ``AP ∓ t_((1+p)/2)(n - 1) s / sqrt(n)``, s the deviation along the error [m].

    The interval starts at zero where Hotelling's test of size 1 - p does not reject a mean at the commanded position:
    the length of a mean is never zero, even where the true one is.
    """
    from scipy.special import stdtrit

    x, goal = _checked_cycles(attained), np.atleast_1d(np.asarray(commanded, dtype=float))
    if x.shape[1] != len(goal) or not np.isfinite(goal).all():
        raise InputError(f"a commanded position of {len(goal)} numbers does not fit attained ones of {x.shape[1]}")
    error = x.mean(axis=0) - goal
    size, n, d = float(np.linalg.norm(error)), len(x), len(error)
    C = np.atleast_2d(np.cov(x, rowvar=False))
    # Without an error there is no direction to look along: take the worst one.
    variance = error @ C @ error / size**2 if size > 0 else np.linalg.eigvalsh(C)[-1]
    half = float(stdtrit(n - 1, (1 + p) / 2)) * math.sqrt(variance / n)
    tested = n > d and np.linalg.matrix_rank(C, hermitian=True) == d
    mere_scatter = tested and n * error @ np.linalg.solve(C, error) <= hotelling_factor(p, d, n - 1) ** 2
    return size, (0.0 if mere_scatter else max(size - half, 0.0), size + half)


def orientation_performance(attained: ArrayLike, commanded: float) -> OrientationPerformance:
    """AP and RP of one angle (roll, pitch or yaw) attained n times [rad]; ISO 9283:1998, 7.2.1 and 7.2.2."""
    angles = _checked_cycles(np.asarray(attained, dtype=float).reshape(-1, 1))[:, 0]
    # Angles on both sides of pi are near to each other: count them from the commanded one.
    offset = np.mod(angles - commanded + math.pi, TURN) - math.pi
    return OrientationPerformance(len(offset), float(offset.mean()), 3 * float(offset.std(ddof=1)))


def repeatability_sampling(
    covariance: ArrayLike, n: int = 30, p: float = 0.95, trials: int = 4000, seed: int | None = None
) -> RepeatabilitySampling:
    """How far RP of n Gaussian cycles may lie from the RP of infinitely many, by simulating the test.

    Of the covariance (d, d) the shape alone matters. The ends of the interval are good to some ``2 / sqrt(trials)`` of
    its width.
    """
    C = _checked_covariance(covariance)
    if n < 3 or not np.trace(C) > 0:
        raise InputError("repeatability needs three cycles or more, and some scatter")
    values, axes = np.linalg.eigh(C)
    root = axes * np.sqrt(np.clip(values, 0, None))
    x = np.random.default_rng(seed or 0).standard_normal((trials, n, len(C))) @ root.T
    distance = np.linalg.norm(x - x.mean(axis=1, keepdims=True), axis=2)
    found = distance.mean(axis=1) + 3 * distance.std(axis=1, ddof=1)
    ratio = found / repeatability_from_covariance(C)
    low, high = np.quantile(ratio, [(1 - p) / 2, (1 + p) / 2])
    return RepeatabilitySampling(float(ratio.mean() - 1), float(ratio.std(ddof=1)), (float(low), float(high)))


def repeatability_from_covariance(covariance: ArrayLike) -> float:
    """RP of a Gaussian point of covariance (d, d) [m²], ``E[l] + 3 sd[l]`` with ``l = |x - E x|`` [m].

    Source: ISO 9283:1998, 7.2.2, for infinitely many cycles.
    """
    return float(repeatabilities(_checked_covariance(covariance)[None])[0])


def repeatabilities(covariances: ArrayLike) -> Array:
    """(N,) RP [m] of N Gaussian points with covariances (N, d, d) [m²]."""
    mean, sd = distance_moments(covariances)
    return mean + 3 * sd


def distance_moments(covariances: ArrayLike) -> tuple[Array, Array]:
    """Mean and σ, (N,) each, of the length of zero-mean Gaussian vectors [m], covariances (N, d, d) [m²], d ≤ 3.

    ``E l = 1 / (2 sqrt(pi)) Int_0^inf (1 - prod_i (1 + 2 t lambda_i)^(-1/2)) t^(-3/2) dt`` with the eigenvalues of C;
    equally ``2 sqrt(2/pi) R_G(lambda)``, Carlson's elliptic integral. ``sd^2 = tr C - (E l)^2``. Source: A. M. Mathai
    and S. B. Provost, Quadratic Forms in Random Variables (1992), 3.2b.
    """
    C = np.asarray(covariances, dtype=float)
    if C.ndim != 3 or C.shape[1] != C.shape[2] or not 1 <= C.shape[1] <= 3 or not np.isfinite(C).all():
        raise InputError(f"finite covariances (N, d, d) with d = 1, 2 or 3 are wanted, not {C.shape}")
    values = np.clip(np.linalg.eigvalsh((C + C.transpose(0, 2, 1)) / 2), 0, None)
    trace = values.sum(axis=1)
    shape = np.zeros((len(values), 3))
    shape[:, : values.shape[1]] = values / np.where(trace > 0, trace, 1.0)[:, None]
    a, b, c = shape.T
    mean = np.sqrt(trace) * _mean_length(a * b + b * c + c * a, a * b * c)
    return mean, np.sqrt(np.clip(trace - mean**2, 0, None))


def _mean_length(e2: Array, e3: Array) -> Array:
    """E l for eigenvalues of sum one, given the sum of their products by two and their product."""
    # On a line the integral is sqrt(2 / pi). What other shapes add to it decays on both sides of t = 1, and in s = ln t
    # the trapezoid rule of step 1/2 is exact to 1e-17: the integrand has no pole nearer to the real axis than i pi.
    s = np.arange(-30.0, 40.0, 0.5)
    t = np.exp(s)
    line = np.sqrt(1 + 2 * t)
    more = np.multiply.outer(e2, 4 * t**2) + np.multiply.outer(e3, 8 * t**3)
    shape = np.sqrt(1 + 2 * t + more)
    terms = more / (line * shape * (line + shape))  # 1 / line - 1 / shape, without cancellation
    result: Array = math.sqrt(2 / math.pi) + terms @ (0.5 * np.exp(-s / 2)) / (2 * math.sqrt(math.pi))
    return result


def _checked_cycles(attained: ArrayLike) -> Array:
    """(n, d) attained positions as floats, three cycles at least."""
    x = np.asarray(attained, dtype=float)
    if x.ndim != 2 or not 1 <= x.shape[1] <= 3 or not np.isfinite(x).all():
        raise InputError(f"finite attained positions (n, 3) are wanted, not {x.shape}")
    if len(x) < 3:
        raise InsufficientDataError(f"repeatability needs three cycles or more, 30 by ISO 9283; there are {len(x)}")
    return x


def _checked_covariance(covariance: ArrayLike) -> Array:
    """(d, d) a covariance as floats; a number is one on a line."""
    C = np.atleast_2d(np.asarray(covariance, dtype=float))
    if C.ndim != 2 or C.shape[0] != C.shape[1]:
        raise InputError(f"a square covariance is wanted, not {C.shape}")
    return C


def joint_sigmas(robot: Robot, repeatability: float, weights: Mapping[str, float] | None = None) -> Sources:
    """Independent joint errors that scatter the tool point as much as the data sheet's RP [m] says.

    Every joint j gets ``σ_j = s w_j ℓ_j``: ``w_j ≥ 0`` its weight, 1 unless given, no source of 0; ``ℓ_j`` 1 for
    revolute joints and, for prismatic ones, the lever [m/rad] by which a revolute joint moves the tool point in the
    root mean square: at equal weights a slide scatters the tool point as a turn does. The scale s makes the median of
    ``RP = E l + 3 sd l``, l the length of ``N(0, J Σ Jᵀ)``, over stated postures the repeatability: to first order RP
    is proportional to s. ISO 9283:1998, 7.2.2, measures five poses in a cube in the middle of the working space, which
    differ with every robot and its user; :func:`matching_postures` take their place.
    """
    weights = dict(weights or {})
    _check_arguments(robot, repeatability, weights)
    postures = matching_postures(robot)
    reached = walk(robot.factors, factor_values(robot.factors, list(postures.T)))
    shifts = [stack(position_column(reached, i)) for i in robot.driven]
    columns = np.array([np.broadcast_to(shift, (len(postures), 3)) for shift in shifts])  # (n, N, 3) [m/rad or m/m]
    turning = [k for k, joint in enumerate(robot.joints) if joint.type == "revolute"]
    mean_square = float(np.mean(np.sum(columns[turning] ** 2, axis=-1))) if turning else 1.0
    lever = math.sqrt(mean_square) or 1.0
    unit = np.array([weights.get(j.name, 1.0) * (1.0 if j.type == "revolute" else lever) for j in robot.joints])
    scaled = columns * unit[:, None, None]
    typical = float(np.median(repeatabilities(np.einsum("jni,jnk->nik", scaled, scaled))))
    if not typical > 1e-9 * float(np.abs(columns).max(initial=0.0)):
        hint = "give a weight to a joint whose axis does not pass through the tool point"
        raise InputError(Issue("the joints with a weight do not move the tool point", ("weights",), hint=hint))
    sigma = repeatability / typical * unit
    parameters = [robot.factors[i].parameter for i in robot.driven]
    named = {name: float(s) for name, s in zip(parameters, sigma, strict=True) if s > 0}
    note = _matching_note(robot, sigma, repeatability, len(postures), bool(weights))
    return replace(Sources.scattering(named, (note,)), details=(note,))


def matching_postures(robot: Robot) -> Array:
    """(200, n) postures [rad or m]: of 400 spread evenly over the joint ranges the middle half by reach.

    Their median RP is that of 40 000 to 1 % (UR10, Panda, SCARA); reach is the distance of the tool point from joint 1.
    The additive recurrence is the same on every machine. Source: M. Roberts, The unreasonable effectiveness of
    quasirandom sequences (2018).
    """
    drawn, ratio = 400, 2.0
    for _ in range(60):  # the root of x^(n+1) = x + 1, the number whose powers are worst to approximate
        ratio = (1 + ratio) ** (1 / (robot.n + 1))
    fraction = (0.5 + np.outer(np.arange(1, drawn + 1), ratio ** -np.arange(1, robot.n + 1))) % 1.0
    lower, upper = np.array([_joint_range(joint) for joint in robot.joints]).T
    postures: Array = lower + fraction * (upper - lower)
    reached = walk(robot.factors, factor_values(robot.factors, list(postures.T)))
    first = next(screw for screw, factor in zip(reached.screws, robot.factors, strict=True) if factor.joint is not None)
    reach = np.linalg.norm(np.broadcast_to(stack(reached.position) - stack(first.origin), (drawn, 3)), axis=1)
    order = np.argsort(reach, kind="stable")
    return postures[np.sort(order[drawn // 4 : 3 * drawn // 4])]


def _joint_range(joint: Joint) -> tuple[float, float]:
    """(lower, upper) [rad or m]: the limits, at most a turn; where they are open a turn, or 2 m of a slide."""
    half = math.pi if joint.type == "revolute" else 1.0
    if math.isfinite(joint.lower) and math.isfinite(joint.upper):
        if joint.type == "revolute" and joint.upper - joint.lower > 2 * half:
            return -half, half  # more than a turn repeats the same places
        return joint.lower, joint.upper
    if math.isfinite(joint.lower):
        return joint.lower, joint.lower + 2 * half
    return (joint.upper - 2 * half, joint.upper) if math.isfinite(joint.upper) else (-half, half)


def _matching_note(robot: Robot, sigma: Array, repeatability: float, count: int, weighted: bool) -> str:
    """One sentence on the sigmas (n,) [rad or m] and where they come from."""
    both = len({joint.type for joint in robot.joints}) > 1
    parts = []
    for kind, dimension in (("revolute", "angle"), ("prismatic", "length")):
        sizes = [float(s) for s, joint in zip(sigma, robot.joints, strict=True) if joint.type == kind]
        values = dict.fromkeys(shown(size, dimension) for size in sizes)
        if values:
            each = " each" if len(sizes) > 1 and len(values) == 1 else ""
            parts.append(f"{', '.join(values)}{each}{f' ({kind})' if both else ''}")
    given = " with the given weights" if weighted else ""
    return (
        f"joint sigma {', '.join(parts)}{given}, from the data-sheet repeatability RP = {repeatability * 1e3:g} mm "
        f"(ISO 9283: mean + 3 s), matched as the median over {count} postures spread over the "
        "joint ranges, the middle half by reach"
    )


def _check_arguments(robot: Robot, repeatability: float, weights: Mapping[str, float]) -> None:
    issues = []
    if not (math.isfinite(repeatability) and repeatability > 0):
        hint = "a data sheet gives for example 0.05 mm"
        issues.append(Issue(f"the repeatability is {repeatability:g} m", ("repeatability",), repeatability, hint))
    for name, weight in weights.items():
        if name not in robot.joint_names:
            hint = one_of(name, robot.joint_names, "joints")
            issues.append(Issue("the robot has no such joint", ("weights", name), weight, hint))
        elif not (math.isfinite(weight) and weight >= 0):
            issues.append(Issue(f"the weight is {weight:g}", ("weights", name), weight, "give 0 or more"))
    if issues:
        raise InputError(issues)
