"""Corrections and speeds that a section states, and the parameters that data can tell apart."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Literal

from posture_opt.errors import BadValueError, InputError, Issue, did_you_mean, listed, nearest
from posture_opt.robot.axes import NEARLY_PARALLEL, beside_bodies, moved_factors
from posture_opt.robot.robot import Factor, Robot
from posture_opt.units import parse_quantity


def corrected(robot: Robot, corrections: Mapping[str, object]) -> Robot:
    """The arm off its nominal values by texts such as ``"0.12 deg"``: ``value = nominal + correction``. Limits stay
    those of commanded joints: an offset moves the arm, not what its controller allows."""
    if not corrections:
        return robot
    known = robot.parameters
    issues = [issue.at("corrections") for name in corrections for issue in name_issues(name, known)]
    values = {
        name: _read_correction(name, given, known[name], issues) for name, given in corrections.items() if name in known
    }
    if issues:
        raise InputError(issues)
    try:
        return deviated(robot, beside_bodies(robot, values))
    except BadValueError as error:
        raise InputError(error.issue(("corrections",))) from None


def deviated(robot: Robot, values: Mapping[str, float], former: Mapping[str, float] | None = None) -> Robot:
    """The arm off its values in ``robot`` by ``values`` [rad or m]; with ``former`` corrections, only the sum of both
    leans and shifts its axes, so that a correction taken back leaves no ``skew`` or ``lift``."""
    base, *links, tool = (moved_factors(part, values) for part in (robot.base, *robot.links, robot.tool))
    former = former or {}
    total = {name: former.get(name, 0.0) + values.get(name, 0.0) for name in {**former, **values}}
    skew = robot.skew + _axis_displacement(robot, total, "rotate") - _axis_displacement(robot, former, "rotate")
    lift = robot.lift + _axis_displacement(robot, total, "translate") - _axis_displacement(robot, former, "translate")
    return replace(robot, base=base, links=tuple(links), tool=tool, skew=skew, lift=lift)


def _axis_displacement(robot: Robot, values: Mapping[str, float], kind: Literal["rotate", "translate"]) -> float:
    """How far [rad or m] the axes can lie from the nominal ones: the sum of all corrections but the joints' own."""
    inside = (factor for link in robot.links for factor in link)
    return math.fsum(abs(values.get(f.parameter, 0.0)) for f in inside if f.kind == kind and f.joint is None)


def _read_correction(name: str, given: object, factor: Factor, issues: list[Issue]) -> float:
    """[rad or m]; 0 with an issue."""
    try:
        return parse_quantity(given, "angle" if factor.kind == "rotate" else "length")
    except BadValueError as error:
        issues.append(error.issue(("corrections", name), given))
        return 0.0


def name_issues(name: str, known: Iterable[str]) -> list[Issue]:
    """The issue about an unknown parameter, with the nearest of the same joint."""
    every = list(known)
    if name in every:
        return []
    joint, _, part = name.rpartition(".") if "." in name else (name, "", "")
    own = [parameter.rpartition(".")[2] for parameter in every if parameter.rpartition(".")[0] == joint]
    if own:
        other = {"theta": "d", "d": "theta"}.get(part, "")  # the variable of a slide, of a joint that turns
        begun = next((word for word in own if part and word.startswith(part)), "")
        near = other if other in own else begun or nearest(part, own)
        hint = (f"did you mean '{joint}.{near}'? " if near else "") + f"{joint} has {', '.join(own)}"
    else:
        near = nearest(name, every)
        owners = dict.fromkeys(parameter.rpartition(".")[0] for parameter in every)
        hint = (f"did you mean '{near}'? " if near else "") + f"parameters have: {listed(owners, 12)}"
    return [Issue("the robot has no such parameter", (name,), name, hint)]


def corrections_of(nominal: Robot, robot: Robot) -> dict[str, float]:
    """Deviation of every parameter of a robot from its nominal value [rad or m]."""
    stated = nominal.parameters
    return {name: factor.nominal - stated[name].nominal for name, factor in robot.parameters.items()}


def with_velocities(robot: Robot, given: Mapping[str, object]) -> Robot:
    """The robot with largest speeds of some joints: joint name -> ``"120 deg/s"`` or, of a slide, ``"0.5 m/s"``."""
    if not given:
        return robot
    names = robot.joint_names
    issues = [
        Issue("the robot has no such joint", ("velocity", name), name, did_you_mean(name, names))
        for name in given
        if name not in names
    ]
    speeds: dict[str, float] = {}
    for joint in (joint for joint in robot.joints if joint.name in given):
        try:
            speed = parse_quantity(given[joint.name], "angular velocity" if joint.type == "revolute" else "velocity")
            if not speed > 0:
                raise BadValueError("the largest speed of a joint is above zero", "leave it out where it is unknown")
            speeds[joint.name] = speed
        except BadValueError as error:
            issues.append(error.issue(("velocity", joint.name), given[joint.name]))
    if issues:
        raise InputError(issues)
    return replace(robot, joints=tuple(replace(j, velocity=speeds.get(j.name, j.velocity)) for j in robot.joints))


def is_fitted(robot: Robot, name: str) -> bool:
    """Whether no other parameter acts like ``JOINT.LAST``: ``beta`` is one only between nearly parallel axes (Hayati,
    Mirmirani 1985), and a joint with an origin of six has no offset of its own."""
    joint, _, last = name.rpartition(".")
    parameters = robot.parameters
    index = robot.joint_names.index(joint) if joint in robot.joint_names else -1
    if last == "beta":
        alpha = parameters[f"{joint}.alpha"].nominal
        return index < robot.n - 1 and abs(math.sin(alpha)) < NEARLY_PARALLEL
    # The joint value of a URDF joint moves the tool as its origin does.
    return not (last in ("theta", "d") and f"{joint}.roll" in parameters)


def geometry_behind_first_joint(robot: Robot) -> tuple[str, ...]:
    """Fitted parameters behind the value of the first joint: the base moves the arm like those before it."""
    behind = [factor.parameter for factor in robot.factors[robot.driven[0] + 1 :] if factor.parameter]
    return tuple(name for name in behind if name.rpartition(".")[0] != "tool" and is_fitted(robot, name))
