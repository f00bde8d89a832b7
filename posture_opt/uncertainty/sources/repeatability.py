"""Joint standard deviations from a data sheet's repeatability: what to do when nothing better is known."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from posture_opt.errors import InputError, Issue, one_of
from posture_opt.model.chain import factor_values, position_column, stack, walk
from posture_opt.numerics import Array
from posture_opt.robot.robot import Joint, Robot
from posture_opt.uncertainty.sources.iso9283 import repeatabilities
from posture_opt.uncertainty.sources.sources import Sources
from posture_opt.units import ERROR_UNITS, number

_MICROMETRES_BELOW_M = 1e-5

_DRAWN_POSTURES = 400
"""Postures, of which half are kept: their median RP is that of 40 000 to 1 % (UR10, Panda, SCARA)."""
_HALF_RANGE_RAD = math.pi
"""Half range of a revolute joint without limits."""
_HALF_RANGE_M = 1.0
"""The same of a prismatic joint."""


def joint_sigmas(robot: Robot, repeatability: float, weights: Mapping[str, float] | None = None) -> Sources:
    """Independent joint errors that scatter the tool point as much as the data sheet says.

    Every joint j gets ``σ_j = s w_j ℓ_j``: ``w_j`` its weight, 1 unless given; ``ℓ_j`` 1 for revolute joints and,
    for prismatic ones, the lever [m/rad] by which a revolute joint moves the tool point in the root mean square,
    so that at equal weights a slide scatters the tool point as a turn does. The scale s makes the median of
    ``RP = E l + 3 sd l``, l the length of ``N(0, J Σ Jᵀ)``, over stated postures the repeatability. To first order
    RP is proportional to s, so one division finds it.

    ISO 9283 measures five poses in a cube in the middle of the working space. They differ with every robot and
    its user; :func:`matching_postures` take their place.

    Args:
        repeatability: RP [m] > 0.
        weights: joint name -> weight ≥ 0; a joint of weight 0 is no source.

    Raises:
        InputError: a repeatability that is no positive number, unknown joints or negative weights, or weighted
            joints that do not move the tool point.

    Source: ISO 9283:1998, 7.2.2.
    """
    weights = dict(weights or {})
    _check_arguments(robot, repeatability, weights)
    postures = matching_postures(robot)
    columns = _joint_columns(robot, postures)
    lever = _typical_lever(robot, columns)
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

    The additive recurrence fills the box of the joints evenly and is the same on every machine; reach is the
    distance of the tool point from the first joint. Source: M. Roberts, The unreasonable effectiveness of
    quasirandom sequences (2018).
    """
    ratio = _plastic_number(robot.n)
    fraction = (0.5 + np.outer(np.arange(1, _DRAWN_POSTURES + 1), ratio ** -np.arange(1, robot.n + 1))) % 1.0
    lower, upper = np.array([_joint_range(joint) for joint in robot.joints]).T
    postures: Array = lower + fraction * (upper - lower)
    reached = walk(robot.factors, factor_values(robot.factors, list(postures.T)))
    first = next(screw for screw, factor in zip(reached.screws, robot.factors, strict=True) if factor.joint is not None)
    reach = np.linalg.norm(np.broadcast_to(stack(reached.position) - stack(first.origin), (_DRAWN_POSTURES, 3)), axis=1)
    order = np.argsort(reach, kind="stable")
    return postures[np.sort(order[_DRAWN_POSTURES // 4 : 3 * _DRAWN_POSTURES // 4])]


def _plastic_number(n: int) -> float:
    """The root of ``x^(n+1) = x + 1``, the number whose powers are worst to approximate."""
    x = 2.0
    for _ in range(60):
        x = (1 + x) ** (1 / (n + 1))
    return x


def _joint_range(joint: Joint) -> tuple[float, float]:
    """(lower, upper) [rad or m] that postures are spread over: the limits, at most a turn, or a range where they are
    open.
    """
    half = _HALF_RANGE_RAD if joint.type == "revolute" else _HALF_RANGE_M
    if math.isfinite(joint.lower) and math.isfinite(joint.upper):
        if joint.type == "revolute" and joint.upper - joint.lower > 2 * half:
            return -half, half  # more than a turn repeats the same places
        return joint.lower, joint.upper
    if math.isfinite(joint.lower):
        return joint.lower, joint.lower + 2 * half
    return (joint.upper - 2 * half, joint.upper) if math.isfinite(joint.upper) else (-half, half)


def _joint_columns(robot: Robot, postures: Array) -> Array:
    """(n, N, 3) shift of the tool point per unit of each joint's error [m/rad or m/m], world, at N postures."""
    reached = walk(robot.factors, factor_values(robot.factors, list(postures.T)))
    columns = [stack(position_column(reached, i)) for i in robot.driven]
    return np.array([np.broadcast_to(column, (len(postures), 3)) for column in columns])


def _typical_lever(robot: Robot, columns: Array) -> float:
    """Root mean square of the shift of the tool point per radian of a revolute joint [m/rad]; 1 without one.

    ``columns`` (n, N, 3) are those of `_joint_columns`.
    """
    turning = [k for k, joint in enumerate(robot.joints) if joint.type == "revolute"]
    mean_square = float(np.mean(np.sum(columns[turning] ** 2, axis=-1))) if turning else 1.0
    return math.sqrt(mean_square) or 1.0


def _matching_note(robot: Robot, sigma: Array, repeatability: float, count: int, weighted: bool) -> str:
    """One sentence on the sigmas (n,) [rad or m] and where they come from."""
    parts = []
    for kind, written in (("revolute", _small_angle), ("prismatic", _small_length)):
        values = {written(float(s)): None for s, j in zip(sigma, robot.joints, strict=True) if j.type == kind}
        if values:
            each = " each" if sum(j.type == kind for j in robot.joints) > 1 and len(values) == 1 else ""
            parts.append(
                f"{', '.join(values)}{each} ({kind})" if _has_both_types(robot) else f"{', '.join(values)}{each}"
            )
    given = " with the given weights" if weighted else ""
    return (
        f"joint sigma {', '.join(parts)}{given}, from the data-sheet repeatability RP = {repeatability * 1e3:g} mm "
        f"(ISO 9283: mean + 3 s), matched as the median over {count} postures spread over the "
        "joint ranges, the middle half by reach"
    )


def _small_angle(radians: float) -> str:
    """A joint's σ, in the unit that reports use for errors of angles."""
    factor, unit = ERROR_UNITS["rad"]
    return f"{number(radians * factor)} {unit}"


def _small_length(metres: float) -> str:
    """A slide's σ, in µm below 0.01 mm, as reports have it."""
    return f"{number(metres * 1e6)} µm" if metres < _MICROMETRES_BELOW_M else f"{number(metres * 1e3)} mm"


def _has_both_types(robot: Robot) -> bool:
    """Whether some joints turn and others slide."""
    return len({joint.type for joint in robot.joints}) > 1


def _check_arguments(robot: Robot, repeatability: float, weights: Mapping[str, float]) -> None:
    """Refuse a repeatability or weights that cannot be used.

    Raises:
        InputError: everything wrong at once.
    """
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
