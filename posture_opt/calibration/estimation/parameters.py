"""Which parameters of an arm a calibration fits: geometry, base, tools, touched points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from posture_opt.measurements.measurements import Measurements
from posture_opt.model.fitted_geometry import is_fitted
from posture_opt.numerics import Array
from posture_opt.robot.robot import Robot
from posture_opt.selection.problem_data import ProblemData
from posture_opt.units import DIMENSIONS

if TYPE_CHECKING:
    from posture_opt.model.effects import Effect

_AXES = ("x", "y", "z")
_ANGLES = ("roll", "pitch", "yaw")


@dataclass(frozen=True)
class Parameter:
    """One unknown: a parameter of the arm, of one target or of all rows, or of a place: a touched point, a plane, ….

    Args:
        name: ``JOINT.PARAMETER``, ``base.x``, ``tool.x`` (``tool[TARGET].x`` with several targets), ``point[NAME].x``,
            ``plane[NAME].offset``.
        group: ``geometry``, ``base``, ``tool``, ``effect``, ``place``, or ``second_arm``: the geometry of another one.
        nominal: the value in the file [rad or m]; the unknown is the deviation from it.
        source: the parameter of the arm that it deviates; empty for places.
        code: target of a tool offset, or place; -1 where the parameter acts in all rows.
        axis: which of the unknowns of a place.
        sigma: what is known of an unknown of a place beforehand, as of the focal length of a camera; 0: nothing.
    """

    name: str
    group: str
    unit: str
    nominal: float
    source: str = ""
    code: int = -1
    axis: int = 0
    sigma: float = 0.0

    @property
    def made(self) -> bool:
        """Whether it is of the geometry of an arm, which was made to a drawing."""
        return self.group in ("geometry", "second_arm")


def tool_unknown(robot: Robot, data: Measurements) -> bool:
    """Whether the tool is found from the data: it is free, or carries several targets, each at an offset of its own."""
    return robot.tool_free or len(data.target_names) > 1


def candidate_parameters(robot: Robot, data: Measurements) -> tuple[Parameter, ...]:
    """Every parameter that measurements of this kind could say something about, from base to tool.

    Touched points, planes and anchors are in the frame of the base, which is then no unknown, nor is what moves arm and
    places together: all before the first joint, and its own offset. ``beta`` is a candidate only between
    nearly parallel axes (Hayati, Mirmirani 1985); a joint with an origin of six has no offset of its own. Orientations
    show a tool's rotation too.
    """
    at = {factor.parameter: i for i, factor in enumerate(robot.factors) if factor.parameter}
    found = []
    for name, index in at.items():
        prefix, _, last = name.rpartition(".")
        group = prefix if prefix in ("base", "tool") else "geometry"
        if group == "geometry" and not is_fitted(robot, name):
            continue
        if data.kind.fixed_to_base and (group == "base" or index <= robot.driven[0]):
            continue
        if group == "tool":
            if data.kind.oriented or last in _AXES:
                found += _tool_parameters(robot, data, name, index)
            continue
        found.append(_of_factor(robot, name, group, index))
    return (*found, *place_parameters(data))


def effect_parameters(effect: Effect) -> list[Parameter]:
    """The unknowns of an effect: its linear parameters, and its shape where it depends on that smoothly."""
    rows = zip(effect.parameter_names, effect.dimensions, strict=True)
    found = [Parameter(n, "effect", "1" if d == "ratio" else DIMENSIONS[d][0], 0.0, n) for n, (_, d) in rows]
    if effect.smooth_shape:
        name = f"{effect.name}.{effect.smooth_shape}"
        found.append(Parameter(name, "effect", "1", 0.0, name))
    return found


def _of_factor(robot: Robot, name: str, group: str, index: int, code: int = -1) -> Parameter:
    """The unknown that deviates one factor of the chain, in all rows or in those of the target ``code``."""
    factor = robot.factors[index]
    return Parameter(name, group, "rad" if factor.kind == "rotate" else "m", factor.nominal, factor.parameter, code)


def _tool_parameters(robot: Robot, data: Measurements, name: str, index: int) -> list[Parameter]:
    """The unknown of the tool, or one for each target where there are several."""
    if len(data.target_names) < 2:
        return [_of_factor(robot, name, "tool", index)]
    last = name.rpartition(".")[2]
    names = [f"tool[{target}].{last}" for target in data.target_names]
    return [_of_factor(robot, name, "tool", index, code) for code, name in enumerate(names)]


def place_parameters(data: Measurements) -> tuple[Parameter, ...]:
    """The unknowns of all places: touched points, planes, anchors; none where positions were measured."""
    kind = data.kind
    return tuple(
        Parameter(
            kind.parameter(place, name),
            kind.group(place, name),
            unit,
            kind.nominal(place, name),
            "",
            k,
            i,
            kind.prior_sigma(place, name),
        )
        for k, place in enumerate(data.place_names)
        for i, (name, unit) in zip(kind.slots(place), kind.unknowns(place), strict=True)
    )


def prior_covariance(problem: ProblemData, parameters: Sequence[Parameter]) -> tuple[list[int], Array]:
    """Indices of the parameters with a stated σ and their prior covariance [rad², m², rad m].

    What a data sheet's repeatability, or ``scatter``, adds to the sources changes from repeat to repeat and is no
    prior; a frame that is free has none either.

    Returns:
        Indices among ``parameters``, and the covariance (p, p) of those.
    """
    known = problem.sources.constant
    free = {"base": problem.robot.base_free, "tool": problem.robot.tool_free}
    place = {name: i for i, name in enumerate(problem.sources.names)}
    rows = [
        i
        for i, p in enumerate(parameters)
        if p.name in place and known[place[p.name], place[p.name]] > 0 and not free.get(p.group, False)
    ]
    columns = [place[parameters[i].name] for i in rows]
    own = [i for i, p in enumerate(parameters) if p.sigma]
    found = np.diag([*np.zeros(len(rows)), *(parameters[i].sigma ** 2 for i in own)])
    found[: len(rows), : len(rows)] = known[np.ix_(columns, columns)]
    return [*rows, *own], found
