"""Values and bounds that a term states for named joints.

A file names joints; the program counts them from 0 in the order of the chain.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from posture_opt.errors import BadValueError, did_you_mean
from posture_opt.robot.robot import Robot
from posture_opt.units import JointQuantity


def joints_named(names: Iterable[str], robot: Robot) -> list[int]:
    """The indices of the joints of these names, in the order of the names.

    Raises:
        BadValueError: a name that no joint has; the hint holds the nearest one.
    """
    known = robot.joint_names
    for name in names:
        if name not in known:
            raise BadValueError(f"'{name}' is no joint of this arm", did_you_mean(name, known))
    return [known.index(name) for name in names]


def joint_values(values: Mapping[str, JointQuantity], robot: Robot, *, within_limits: bool = False) -> dict[int, float]:
    """Joint index -> value [rad or m], from quantities with their units.

    Raises:
        BadValueError: a name that no joint has, an angle for a prismatic joint, a length for a revolute one, or a
            value beyond the limits where ``within_limits`` is set.
    """
    found = {}
    for index, (name, given) in zip(joints_named(values, robot), values.items(), strict=True):
        joint = robot.joints[index]
        wanted = "angle" if joint.type == "revolute" else "length"
        if not given.suits(wanted):
            example = "30 deg" if wanted == "angle" else "80 mm"
            raise BadValueError(
                f"{name} is {joint.type} and takes an {wanted}".replace("an l", "a l"), f"write {name}: {example}"
            )
        if within_limits and not joint.lower <= given.value <= joint.upper:
            raise BadValueError(f"{name} cannot stand there: it lies beyond its limits", "choose a value within them")
        found[index] = given.value
    return found
