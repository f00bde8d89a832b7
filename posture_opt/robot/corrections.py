"""``corrections``: what a calibration found, added to the nominal values of named parameters."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Literal

from posture_opt.errors import BadValueError, InputError, Issue, listed, nearest
from posture_opt.robot.robot import Factor, Robot
from posture_opt.units import parse_quantity


def corrected(robot: Robot, corrections: Mapping[str, object]) -> Robot:
    """The arm whose named parameters lie off their nominal values by quantities such as ``"0.12 deg"``.

    ``value = nominal + correction`` for every named factor. The limits stay those of the joint variables as they are
    commanded: an offset of a joint moves the arm, not what its controller allows.

    Args:
        robot: the nominal arm.
        corrections: parameter name -> text with a unit, as in ``robot.corrections`` of the problem file.

    Raises:
        InputError: parameters that the robot lacks, values without a unit or of the wrong one; keys relative to the
            robot's section.
    """
    if not corrections:
        return robot
    known = robot.parameters
    issues = [issue.at("corrections") for name in corrections for issue in name_issues(name, known)]
    values = {
        name: _read_correction(name, given, known[name], issues) for name, given in corrections.items() if name in known
    }
    if issues:
        raise InputError(issues)
    return deviated(robot, values)


def deviated(robot: Robot, values: Mapping[str, float], former: Mapping[str, float] | None = None) -> Robot:
    """The arm whose named parameters lie off their values in ``robot`` by ``values`` [rad or m].

    Args:
        robot: the arm to start from, with its corrections, if any, in the nominal values already.
        values: parameter name -> what is added to its value [rad or m].
        former: corrections that ``robot`` has already: only the sum of both leans and shifts its axes, so that a
            correction taken back leaves no ``skew`` or ``lift``.
    """

    def moved(factors: tuple[Factor, ...]) -> tuple[Factor, ...]:
        return tuple(replace(f, nominal=f.nominal + values.get(f.parameter, 0.0)) for f in factors)

    links = tuple(moved(link) for link in robot.links)
    former = former or {}
    total = {name: former.get(name, 0.0) + values.get(name, 0.0) for name in {**former, **values}}
    skew = robot.skew + _axis_displacement(robot, total, "rotate") - _axis_displacement(robot, former, "rotate")
    lift = robot.lift + _axis_displacement(robot, total, "translate") - _axis_displacement(robot, former, "translate")
    return replace(robot, base=moved(robot.base), links=links, tool=moved(robot.tool), skew=skew, lift=lift)


def _axis_displacement(robot: Robot, values: Mapping[str, float], kind: Literal["rotate", "translate"]) -> float:
    """How far [rad or m] the axes can lie from the nominal ones: the sum of all corrections but the joints' own.

    The base moves the arm as a whole, and the tool is where it is: neither leans an axis against another.
    """
    inside = (factor for link in robot.links for factor in link)
    return math.fsum(abs(values.get(f.parameter, 0.0)) for f in inside if f.kind == kind and f.joint is None)


def _read_correction(name: str, given: object, factor: Factor, issues: list[Issue]) -> float:
    """The value of one correction [rad or m]; 0 with an issue where it is none."""
    try:
        return parse_quantity(given, "angle" if factor.kind == "rotate" else "length")
    except BadValueError as error:
        issues.append(error.issue(("corrections", name), given))
        return 0.0


def name_issues(name: str, known: Iterable[str]) -> list[Issue]:
    """The issue about a parameter that the robot does not have, with the nearest of the same joint; empty for a known
    name.
    """
    every = list(known)
    if name in every:
        return []
    joint, _, part = name.rpartition(".") if "." in name else (name, "", "")
    own = [parameter.rpartition(".")[2] for parameter in every if parameter.rpartition(".")[0] == joint]
    if own:
        near = _nearest_part(part, own)
        hint = (f"did you mean '{joint}.{near}'? " if near else "") + f"{joint} has {', '.join(own)}"
    else:
        near = nearest(name, every)
        owners = dict.fromkeys(parameter.rpartition(".")[0] for parameter in every)
        hint = (f"did you mean '{near}'? " if near else "") + f"parameters have: {listed(owners, 12)}"
    return [Issue("the robot has no such parameter", (name,), name, hint)]


def _nearest_part(part: str, known: list[str]) -> str:
    """What was probably meant by the part of a name behind the joint, ``theta`` say; empty where nothing is like it."""
    own_variable = {"theta": "d", "d": "theta"}.get(part, "")  # of a slide, of a joint that turns
    begun = next((word for word in known if part and word.startswith(part)), "")
    return own_variable if own_variable in known else begun or nearest(part, known)


def corrections_of(nominal: Robot, robot: Robot) -> dict[str, float]:
    """Deviation of every parameter of a robot from its nominal value [rad or m]."""
    stated = nominal.parameters
    return {name: factor.nominal - stated[name].nominal for name, factor in robot.parameters.items()}
