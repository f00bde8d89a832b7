"""Parameters of an arm that a calibration fits (geometry, base, tools, places), and what is known of them before."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from posture_opt.measurements.measurements import Measurements
from posture_opt.numerics import Array
from posture_opt.robot.corrections import is_fitted
from posture_opt.robot.robot import Robot
from posture_opt.selection.problem_data import ProblemData
from posture_opt.units import DIMENSIONS

if TYPE_CHECKING:
    from posture_opt.model.effects import Effect


@dataclass(frozen=True)
class Parameter:
    """One unknown: a parameter of the arm, of one target or of all rows, or of a place: a touched point, a plane, …."""

    # ``JOINT.PARAMETER``, ``base.x``, ``tool.x`` (``tool[TARGET].x`` with several targets), ``point[NAME].x``,
    # ``plane[NAME].offset``
    name: str
    # ``geometry``, ``base``, ``tool``, ``effect``, ``place``, or ``second_arm``: the geometry of another one
    group: str
    unit: str
    nominal: float  # the value in the file [rad or m]; the unknown is the deviation from it
    source: str = ""  # the parameter of the arm that it deviates; empty for places
    code: int = -1  # target of a tool offset, or place; -1 where the parameter acts in all rows
    axis: int = 0  # which of the unknowns of a place
    # what is known of an unknown of a place beforehand, as of the focal length of a camera; 0: nothing
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
    places together: all before the first joint, and its own offset. ``beta`` is a candidate only between nearly
    parallel axes (Hayati, Mirmirani 1985); a joint with an origin of six has no offset of its own. Orientations show a
    tool's rotation too.
    """
    found, tools = [], data.target_names if len(data.target_names) > 1 else ()
    for index, factor in enumerate(robot.factors):
        name, unit = factor.parameter, "rad" if factor.kind == "rotate" else "m"
        prefix, _, last = name.rpartition(".")
        group = prefix if prefix in ("base", "tool") else "geometry"
        if not name or (group == "geometry" and not is_fitted(robot, name)):
            continue
        if data.kind.fixed_to_base and (group == "base" or index <= robot.driven[0]):
            continue
        if group == "tool" and not (data.kind.oriented or last in ("x", "y", "z")):
            continue
        codes = {f"tool[{target}].{last}": code for code, target in enumerate(tools)} if group == "tool" else {}
        for own, code in (codes or {name: -1}).items():
            found.append(Parameter(own, group, unit, factor.nominal, name, code))
    return (*found, *place_parameters(data))


def effect_parameters(effect: Effect) -> list[Parameter]:
    """The unknowns of an effect: its linear parameters, and its shape where it depends on that smoothly."""
    rows = zip(effect.parameter_names, effect.dimensions, strict=True)
    found = [Parameter(n, "effect", "1" if d == "ratio" else DIMENSIONS[d][0], 0.0, n) for n, (_, d) in rows]
    if effect.smooth_shape:
        name = f"{effect.name}.{effect.smooth_shape}"
        found.append(Parameter(name, "effect", "1", 0.0, name))
    return found


def place_parameters(data: Measurements) -> tuple[Parameter, ...]:
    """The unknowns of all places: touched points, planes, anchors; none where positions were measured."""
    kind, found = data.kind, []
    for k, place in enumerate(data.place_names):
        for i, (name, unit) in zip(kind.slots(place), kind.unknowns(place), strict=True):
            parameter, group = kind.parameter(place, name), kind.group(place, name)
            sigma = kind.prior_sigma(place, name)
            found.append(Parameter(parameter, group, unit, kind.nominal(place, name), "", k, i, sigma))
    return tuple(found)


def prior_covariance(problem: ProblemData, parameters: Sequence[Parameter]) -> tuple[list[int], Array]:
    """Indices of the parameters with a stated σ and their prior covariance [rad², m², rad m].

    Returns Indices among ``parameters``, and the covariance (p, p) of those.
    """
    known, names = problem.sources.constant, problem.sources.names
    free = {"base": problem.robot.base_free, "tool": problem.robot.tool_free}
    place = {name: i for i, name in enumerate(names) if known[i, i] > 0}
    rows = [i for i, p in enumerate(parameters) if p.name in place and not free.get(p.group, False)]
    columns = [place[parameters[i].name] for i in rows]
    own = [i for i, p in enumerate(parameters) if p.sigma]
    found = np.diag([*np.zeros(len(rows)), *(parameters[i].sigma ** 2 for i in own)])
    found[: len(rows), : len(rows)] = known[np.ix_(columns, columns)]
    return [*rows, *own], found


@dataclass(frozen=True, eq=False)
class Prior:
    """Independent knowledge of some deviations: ``W x[rows]`` is a standard normal vector."""

    rows: tuple[int, ...] = ()
    W: Array = field(default_factory=lambda: np.zeros((0, 0)))
    # in place of ``W`` where errors of the estimate are counted, of what weighs more than it is known; None where they
    # are the same
    errors: Array | None = None

    @classmethod
    def of(cls, rows: list[int], covariance: Array) -> Prior:
        """From the covariance of the deviations ``rows``; what has no variance in it, as after a calibration, is held.

        ``W = Λ^(−½) Vᵀ D⁻¹`` with the correlations ``V Λ Vᵀ`` and the standard deviations D.

        rows: indices of the deviations; covariance: (p, p) [rad², m²].
        """
        if not rows:
            return cls()
        # A variance that is rounding would weigh so much that all else drowned in it.
        # 1e-10 rad, m: nothing is known better
        covariance = covariance + np.diag(np.maximum(1e-10**2 - np.diag(covariance), 0.0))
        sigma = np.sqrt(np.diag(covariance))
        values, vectors = np.linalg.eigh(covariance / np.outer(sigma, sigma))
        # 1e-8 of a variance, in correlations: a ten-thousandth of a standard deviation is as good as nothing
        return cls(tuple(rows), (vectors / np.sqrt(np.maximum(values, 1e-8))).T / sigma)

    def counted_as(self, known: Prior) -> Prior:
        """Weigh as before in an estimate, and count errors with another knowledge of these rows."""
        return replace(self, errors=known.W)

    @property
    def of_errors(self) -> Prior:
        """What errors of the estimate are counted with."""
        return self if self.errors is None else Prior(self.rows, self.errors)

    def matrix(self, k: int) -> Array:
        """``W`` in the columns of all k unknowns."""
        wide = np.zeros((len(self.rows), k))
        wide[:, list(self.rows)] = self.W
        return wide


def known_rows(prior: Prior | None, weight: float, directions: Array) -> Array:
    """The prior as further rows (p, r) of the Jacobian by the steps ``directions`` (k, r)."""
    rows = np.zeros((0, directions.shape[1]))
    return rows if prior is None else np.asarray(weight * prior.matrix(len(directions)) @ directions)
