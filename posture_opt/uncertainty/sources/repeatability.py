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
from posture_opt.units import shown


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
