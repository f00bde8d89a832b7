"""Which part of an arm a source of error belongs to: a joint, the base or the tool."""

from __future__ import annotations

from collections.abc import Sequence

from posture_opt.model.arm import Arm
from posture_opt.robot.shape import BASE, TOOL
from posture_opt.uncertainty.spread.budget import Share


def owner_of(parameter: str, arm: Arm) -> str:
    """The joint that a source of error belongs to, ``base`` or ``tool``; empty where it belongs to none.

    Parameters of the geometry belong to the joint of their link, those of effects to the joint that the effect acts
    on, an unknown side of approach to its joint.
    """
    robot = arm.robot
    for owner, factors in ((BASE, robot.base), *zip(robot.joint_names, robot.links, strict=True), (TOOL, robot.tool)):
        if any(factor.parameter == parameter for factor in factors):
            return owner
    if parameter in arm.unknown_sides:
        return parameter.removesuffix(".side")
    for found in arm.measured_ranges:
        if parameter == found.name:
            return found.effect.target
    targets = [effect.target for effect in arm.effects if parameter in effect.parameter_names]
    return next((target for target in targets if target in (*robot.joint_names, BASE, TOOL)), "")


def shares_by_owner(shares: Sequence[Share], arm: Arm) -> tuple[tuple[str, float], ...]:
    """The shares of all sources of one owner together, the largest first.

    Sources without an owner, as of a whole arm, are left out: the shares may add up to less than 1.
    """
    total: dict[str, float] = {}
    for share in shares:
        owner = owner_of(share.parameter, arm)
        total[owner] = total.get(owner, 0.0) + share.share
    return tuple(sorted(((owner, size) for owner, size in total.items() if owner), key=lambda entry: -entry[1]))
