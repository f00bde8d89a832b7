"""Names and sizes of sources of error as reports write them."""

from __future__ import annotations

from posture_opt.model.arm import Arm
from posture_opt.statements.notation import stated_sigma
from posture_opt.uncertainty.sources.workpiece import ANGLE, FEATURE, POSITION
from posture_opt.units import shown

_PARAMETERS = {
    "theta": "angle",
    "d": "offset",
    "a": "link length",
    "alpha": "twist",
    "beta": "tilt",
    "x": "frame, x",
    "y": "frame, y",
    "z": "frame, z",
    "roll": "frame, roll",
    "pitch": "frame, pitch",
    "yaw": "frame, yaw",
}
_OF_WORKPIECE = {
    POSITION: "workpiece position",
    ANGLE: "workpiece angle",
    FEATURE: "feature position",
}


def source_words(name: str, arm: Arm) -> str:
    """A named source of error in words: ``joint1.theta`` is the joint1 angle."""
    if said := _OF_WORKPIECE.get(name) or _source_of_effect(name, arm):
        return said
    owner, _, parameter = name.rpartition(".")
    prismatic = any(joint.name == owner and joint.type == "prismatic" for joint in arm.robot.joints)
    if prismatic and parameter == "d":
        return f"{owner} travel"
    if owner in ("base", "tool"):
        return f"{owner} {parameter}"
    return f"{owner} {_PARAMETERS[parameter]}" if owner and parameter in _PARAMETERS else name


def source_size(name: str, sigma: float, arm: Arm) -> str:
    """The standard deviation of a source with its unit."""
    if said := _spread_of_effect(name, sigma, arm):
        return said
    if name in _OF_WORKPIECE:
        return stated_sigma(sigma, "rad" if name == ANGLE else "m")
    factor = arm.robot.parameters.get(name)
    return stated_sigma(sigma, "m" if factor is not None and factor.kind == "translate" else "rad")


def _source_of_effect(name: str, arm: Arm) -> str:
    """A parameter of an effect, or a side that is not known, as a source of error; empty for other sources."""
    if name in arm.unknown_sides:
        return f"{name.removesuffix('.side')} side of approach"
    for found in arm.measured_ranges:
        if name == found.name:
            return f"{found.effect.target} {found.effect.title} beyond its measured range"
    for effect in arm.effects:
        if name in effect.parameter_names:
            parameter = name.removeprefix(f"{effect.name}.")
            what = effect.title if len(effect.dimensions) == 1 else f"{effect.title}, {parameter}"
            return f"{effect.target} {what}"
    return ""


def _spread_of_effect(name: str, sigma: float, arm: Arm) -> str:
    """The standard deviation of a parameter of an effect with its unit; empty for other sources."""
    if name in arm.unknown_sides:
        return "either side"
    for found in arm.measured_ranges:
        if name == found.name:
            return shown(sigma * found.effect.unmeasured_size, "angle")
    dimension = arm.dimensions.get(name)
    return "" if dimension is None else shown(sigma, dimension)
