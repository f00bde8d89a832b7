"""The ``uncertainty`` section of the problem file."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from io import StringIO
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from posture_opt.errors import BadValueError, InputError, Issue, KeyPath, nearest, one_of
from posture_opt.files import content, located, naming
from posture_opt.model.arm import Arm
from posture_opt.numerics import Array
from posture_opt.robot.corrections import name_issues
from posture_opt.robot.robot import Robot
from posture_opt.spec import Spec
from posture_opt.texts import csv_line, number_or_nan, unguarded
from posture_opt.uncertainty.repeatability import joint_sigmas
from posture_opt.uncertainty.sources import (
    FeatureErrors,
    Sources,
    WorkpieceErrors,
    covariance_issues,
    workpiece_sources,
)
from posture_opt.units import NEGLIGIBLE, Angle, Length, Pixels, Quantity, parse_quantity

# Two parameters and the coefficient of correlation of their errors
Correlation = Annotated[tuple[str, str, float], Field(examples=[["joint1.a", "joint2.a", 0.8]])]


class MeasurementSpec(Spec):
    """Standard deviations of the measuring instrument, used with data."""

    position: Length = Field(0.0, ge=0, description="of each coordinate of the measured point")
    orientation: Angle | None = Field(None, ge=0, description="of each component of the measured rotation")
    plane: Length | None = Field(None, ge=0, description="of each touch of a plane, its flatness left out")
    distance: Length | None = Field(None, ge=0, description="of each measured distance")
    pixel: Pixels | None = Field(None, ge=0, description="of each image coordinate of a marker")
    level: Angle | None = Field(None, ge=0, description="of each angle of a level on the tool")
    pair: Length | None = Field(None, ge=0, description="of each coordinate of a touch of two arms")
    degrees_of_freedom: int | None = Field(
        None, ge=1, description="of an estimate of it (GUM, G.3), as from repeats; left out where it is known"
    )


class UncertaintySpec(Spec):
    """Where the scatter of the tool point comes from: standard deviations, a covariance file, or a data sheet.

    ``sigma``, or ``covariance``, says how well the parameters of this arm are known: errors that stay. ``scatter`` and
    ``repeatability`` say how they change from repeat to repeat, independently of what is known of them: where both
    speak of a parameter their variances add up. Only ``sigma`` with ``repeatability`` is refused for a joint's value:
    there, one of the two is nearly always the other one written once more. ``workpiece`` and ``feature`` are errors of
    what the tool works on: tasks count them, the arm itself does not.
    """

    sigma: dict[str, Quantity] = Field({}, description="JOINT.PARAMETER: standard deviation")
    correlation: tuple[Correlation, ...] = Field((), description="[parameter, parameter, coefficient]")
    covariance: str | None = Field(None, min_length=1, description="CSV file with named rows and columns")
    scatter: dict[str, Quantity] = Field(
        {}, description="JOINT.PARAMETER: standard deviation from repeat to repeat, added to what else is said of it"
    )
    repeatability: Length | None = Field(None, gt=0, description="data sheet's RP of ISO 9283")
    weights: dict[str, Annotated[float, Field(ge=0)]] = Field({}, description="JOINT: share in the repeatability")
    measurement: MeasurementSpec | None = Field(None, description="the instrument that measures the arm")
    workpiece: WorkpieceErrors | None = Field(None, description="where the workpiece stands: one draw for all features")
    feature: FeatureErrors | None = Field(None, description="where a feature is in it: a new draw for each")

    @property
    def of_workpiece(self) -> Sources:
        """The errors of workpiece and features, which are no part of the arm's."""
        return workpiece_sources(self.workpiece, self.feature)

    def build(self, arm: Arm, folder: Path, attached: Mapping[str, str] | None = None) -> Sources:
        """The sources of an arm."""
        robot = arm.robot
        dimensions = {n: "angle" if f.kind == "rotate" else "length" for n, f in robot.parameters.items()}
        dimensions |= arm.dimensions
        named, scatter = self._read(dimensions, folder, attached or {}, self._weight_issues(robot))
        return self.completed(named, robot, scatter)

    def _read(
        self, dimensions: dict[str, str] | None, folder: Path, attached: Mapping[str, str], issues: list[Issue]
    ) -> tuple[Sources, dict[str, float]]:
        """What is stated of parameters, and the scatter [rad or m]; without dimensions no file is read."""
        issues = [*self._contradictions(), *issues]
        named = Sources()
        try:
            if dimensions is not None and self.covariance and not self.sigma:  # both are a contradiction already
                named = self._from_file(dimensions, folder, attached)
            else:
                named = self._from_sigma(dimensions)
        except InputError as error:
            issues += error.issues
        scatter = {name: _read_sigma(name, text, dimensions, issues, "scatter") for name, text in self.scatter.items()}
        if issues:
            raise InputError(issues)
        return named, scatter

    def completed(self, named: Sources, robot: Robot, scatter: Mapping[str, float]) -> Sources:
        """The sources ``named`` with a repeatability, stated or of the data sheet, and with the ``scatter`` [rad or
        m]."""
        both = scatter and self.covariance
        note = ("repeatability is added to the parameter uncertainty",) if both else ()
        return self._with_repeatability(named, robot).plus(Sources.scattering(scatter, note))

    def check(self) -> None:
        """All of ``build`` that needs neither robot nor files: the end of a name decides between angles and lengths."""
        self._read(None, Path(), {}, [])

    def _contradictions(self) -> list[Issue]:
        issues = []
        if self.covariance and (self.sigma or self.correlation):
            hint = "the file holds variances and correlations alike; leave out sigma and correlation"
            issues.append(Issue("covariance and sigma are both given", ("covariance",), self.covariance, hint))
        if self.weights and self.repeatability is None:
            hint = "add repeatability, or leave out weights"
            issues.append(Issue("weights share out a repeatability, and none is given", ("weights",), hint=hint))
        return issues

    def _weight_issues(self, robot: Robot) -> list[Issue]:
        names = robot.joint_names
        issues = [
            Issue("the robot has no such joint", ("weights", name), name, one_of(name, names, "joints"))
            for name in self.weights
            if name not in names
        ]
        if self.weights and not any(self.weights.get(name, 1.0) for name in names):
            issues.append(Issue("all weights are zero", ("weights",), hint="give one joint a weight above 0"))
        return issues

    def _from_file(self, dimensions: dict[str, str], folder: Path, attached: Mapping[str, str]) -> Sources:
        """The sources of the covariance file."""
        assert self.covariance is not None
        text = attached.get(self.covariance)
        try:
            names, covariance = read_covariance(located(folder, self.covariance), dimensions, text)
        except InputError as error:
            raise InputError([issue if issue.file else issue.at("covariance") for issue in error.issues]) from None
        covariance = (covariance + covariance.T) / 2
        issues = covariance_issues(names, covariance)
        if issues:
            raise InputError([replace(issue, key=("covariance",), value=self.covariance) for issue in issues])
        return Sources(names, covariance, (f"covariance from {self.covariance}",))

    def _from_sigma(self, dimensions: dict[str, str] | None) -> Sources:
        """The sources of ``sigma`` and ``correlation``; without dimensions those that a name has in any robot."""
        issues: list[Issue] = []
        sigma = {name: _read_sigma(name, text, dimensions, issues) for name, text in self.sigma.items()}
        names = tuple(sigma)
        pairs = self._correlation_pairs(names, issues)
        if issues:
            raise InputError(issues)
        values = np.array(list(sigma.values()))
        correlation = np.eye(len(names))
        for (a, b), rho in pairs.items():
            i, j = names.index(a), names.index(b)
            correlation[i, j] = correlation[j, i] = rho
        covariance = correlation * np.outer(values, values)
        issues = covariance_issues(names, covariance)
        if issues:
            raise InputError([issue.at("correlation") for issue in issues])
        return Sources(names, covariance)

    def _correlation_pairs(self, names: tuple[str, ...], issues: list[Issue]) -> dict[tuple[str, str], float]:
        """Pair of names, sorted -> coefficient; what is wrong with it joins ``issues``."""
        pairs: dict[tuple[str, str], float] = {}
        for index, (a, b, rho) in enumerate(self.correlation):
            key = ("correlation", index)
            pair = (min(a, b), max(a, b))
            for name in dict.fromkeys((a, b)):
                if name not in names:
                    hint = f"add it under sigma, or correlate one of: {', '.join(names) or 'none stated'}"
                    issues.append(Issue(f"'{name}' has no sigma", key, name, hint))
            if not -1 <= rho <= 1:
                issues.append(Issue(f"the correlation {rho:g} lies outside [-1, 1]", key, rho, "write for example 0.8"))
            if a == b:
                issues.append(Issue(f"'{a}' is correlated with itself", key, a, "name two different parameters"))
            elif pair in pairs:
                issues.append(Issue(f"the correlation of {a} and {b} is stated twice", key, rho, "keep one"))
            pairs[pair] = rho
        return pairs

    def _with_repeatability(self, named: Sources, robot: Robot) -> Sources:
        """The sources with joint errors from a repeatability: the stated one, or the data sheet's where nothing is
        stated."""
        if self.repeatability is None:
            if robot.repeatability is None or self.sigma or self.covariance or self.scatter:
                return named
            value, source = robot.repeatability.value, robot.repeatability.source
            joints = joint_sigmas(robot, value, {})
            note = f"no uncertainty stated: data-sheet repeatability {value * 1e3:g} mm taken ({source})"
            return replace(joints, notes=(note, *joints.notes), assumed=True)
        joints = joint_sigmas(robot, self.repeatability, self.weights)
        if self.covariance:
            return named.plus(joints)
        try:
            return named.joined(joints)
        except InputError as error:
            hint = "the repeatability holds the scatter of all joints: leave these out of sigma, or leave it out"
            raise InputError([replace(i, key=("repeatability",), hint=hint) for i in error.issues]) from None


def _read_sigma(
    name: str, text: object, dimensions: dict[str, str] | None, issues: list[Issue],
    word: Literal["sigma", "scatter"] = "sigma",
) -> float:  # fmt: skip
    """A standard deviation [rad or m, SI of an effect]; 0 with an issue where it is none."""
    key = (word, name)
    known = dimensions
    if known is None:  # the parameters that a joint of some robot has
        joint = name.rpartition(".")[0] or name
        known = {f"{joint}.{word}": "angle" for word in ("theta", "alpha", "beta", "roll", "pitch", "yaw")}
        known |= {f"{joint}.{word}": "length" for word in ("d", "a", "x", "y", "z")}
    unknown = name_issues(name, known)
    if unknown:
        issues.extend(issue.at(word) for issue in unknown)
        return 0.0
    try:
        value = parse_quantity(text, known[name])
    except BadValueError as error:
        issues.append(error.issue(key, text))
        return 0.0
    if value < 0:
        hint = f"write {str(text).strip().lstrip('-').strip()}"
        issues.append(Issue(f"the standard deviation {text} is negative", key, text, hint))
    if known[name] == "angle" and value > np.pi:
        message = f"a standard deviation of {text} is more than half a turn: nothing would be known of this angle"
        issues.append(Issue(message, key, text, "is the unit right? typical are 0.01 deg to 1 deg"))
    return value


_HEADER_CELL = re.compile(r"^\s*(?P<name>[^\[\]]*?)\s*(?:\[(?P<unit>[^\[\]]*)\])?\s*$")


def read_covariance(path: Path, dimensions: dict[str, str], text: str | None = None) -> tuple[tuple[str, ...], Array]:
    """Names and covariance (k, k) in SI units of a file such as ::

        name, joint1.theta [deg], joint1.a [mm]
        joint1.theta, 1.0, 0.2
        joint1.a, 0.2, 4.0

    An entry has the product of the units of its two columns; rows may be in any order. ``dimensions`` has ``angle`` or
    ``length`` of every known name, ``text`` the content of a file that is not there yet. Errors repeat names of
    parameters alone, and what is written like one: the problem that names the file may be of somebody else.
    """
    rows = _file_rows(path) if text is None else _filled_rows(csv.reader(StringIO(text)))
    if not rows:
        raise InputError(Issue("the covariance file is empty", file=str(path)))
    line, header = rows[0]
    names, factors, issues = _read_header(header[1:], dimensions)
    matrix, more = _read_body(rows[1:], names, dimensions)
    issues += more
    if issues:
        raise InputError([issue.placed(str(path), line) for issue in issues])
    scale = np.array(factors)
    return tuple(names), _without_rounding(matrix * np.outer(scale, scale))


def _without_rounding(covariance: Array) -> Array:
    """The matrix (k, k) [SI] with zeros for errors whose σ is `NEGLIGIBLE`, rounding below zero among them."""
    variance = np.diag(covariance)
    none = np.abs(variance) <= NEGLIGIBLE**2
    most = NEGLIGIBLE * np.maximum(np.sqrt(np.abs(variance)), NEGLIGIBLE)
    row = none[:, None] & (np.abs(covariance) <= most)
    return np.where(row | row.T, 0.0, covariance)


def covariance_text(names: Sequence[str], covariance: Array, units: Sequence[str]) -> str:
    """The text of a covariance (k, k) [SI] in units (k,): rad, mrad, m, mm or the SI unit of an effect."""
    scale = [1e-3 if unit in ("mrad", "mm") else 1.0 for unit in units]
    rows = covariance / np.outer(scale, scale)
    title = csv_line(["name", *(f"{name} [{unit}]" for name, unit in zip(names, units, strict=True))])
    lines = [csv_line([name, *(f"{value:.15g}" for value in row)]) for name, row in zip(names, rows, strict=True)]
    return "\n".join([title, *lines, ""])


def _file_rows(path: Path) -> list[tuple[int, list[str]]]:
    try:
        text = content(path, 10_000_000).decode("utf-8-sig")
        if ";" not in text.partition("\n")[0]:
            return _filled_rows(csv.reader(StringIO(text, newline="")))
        rows = _filled_rows(csv.reader(StringIO(text, newline=""), delimiter=";"))  # with decimal commas, as exported
        return [(line, [cells[0], *(cell.replace(",", ".") for cell in cells[1:])]) for line, cells in rows]
    except InputError as error:
        raise naming(path, error) from None
    except UnicodeDecodeError:
        raise InputError(Issue("not UTF-8 text", hint="save the file as UTF-8", file=str(path))) from None
    except csv.Error:
        raise InputError(Issue("this is no CSV file", hint="are its quotes closed?", file=str(path))) from None


def _filled_rows(reader: Any) -> list[tuple[int, list[str]]]:
    return [(reader.line_num, row) for row in reader if any(cell.strip() for cell in row)]


def _read_header(cells: Sequence[str], dimensions: dict[str, str]) -> tuple[list[str], list[float], list[Issue]]:
    names: list[str] = []
    factors: list[float] = []
    issues: list[Issue] = []
    for number, cell in enumerate(cells, start=2):
        match = _HEADER_CELL.match(cell)
        name, unit = (unguarded(match["name"]), match["unit"]) if match else (cell.strip(), None)
        place = _place_of(name, f"column {number}", dimensions)
        issues += [replace(issue, key=place) for issue in name_issues(name, dimensions)]
        dimension = dimensions.get(name, "length" if unit == "m" else "angle")
        if name in names:
            issues.append(Issue("two columns have this name", place))
        if unit is None and name in dimensions:
            example = "rad" if dimension == "angle" else "m"
            issues.append(Issue("the column has no unit", place, hint=f"write {name} [{example}]"))
        names.append(name)
        factors.append(_unit_factor(name, unit, dimension, issues if name in dimensions else []))
    if not cells:
        issues.append(Issue("the header names no parameter", hint="write for example: name, joint1.theta [rad]"))
    return names, factors, issues


def _unit_factor(name: str, unit: str | None, dimension: str, issues: list[Issue]) -> float:
    if dimension == "ratio":
        if unit not in (None, "1"):
            issues.append(Issue(f"{name} is a ratio", (name,), unit, f"write {name} [1]"))
        return 1.0
    try:
        return parse_quantity(f"1 {unit}", dimension) if unit is not None else 1.0
    except BadValueError as error:
        issues.append(error.issue((name,), unit))
        return 1.0


def _place_of(name: str, place: str, known: Iterable[str]) -> KeyPath:
    every = set(known)
    return (name if name in every or nearest(name, every) else place,)


def _read_body(
    rows: Sequence[tuple[int, list[str]]], names: Sequence[str], known: Iterable[str]
) -> tuple[Array, list[Issue]]:
    """(k, k) the rows in the order of the columns, in the units of the file."""
    matrix = np.full((len(names), len(names)), math.nan)
    issues: list[Issue] = []
    for line, cells in rows:
        match = _HEADER_CELL.match(cells[0])
        name = unguarded(match["name"]) if match else cells[0].strip()
        place = _place_of(name, "row", known)
        if name not in names:
            issues.append(Issue("the row has no column of the same name", place, line=line))
        elif not np.isnan(matrix[names.index(name)]).all():
            issues.append(Issue("two rows have this name", place, line=line))
        elif len(cells) - 1 != len(names):
            issues.append(Issue(f"{len(cells) - 1} numbers in the row, {len(names)} columns", place, line=line))
        else:
            values = np.array([number_or_nan(text) for text in cells[1:]])
            for k in np.flatnonzero(~np.isfinite(values)) + 2:
                issues.append(Issue(f"column {k} holds no finite number", place, None, "write 1.2e-8", "", line))
            matrix[names.index(name)] = np.where(np.isfinite(values), values, 0.0)
    missing = [name for i, name in enumerate(names) if np.isnan(matrix[i]).all() and name in {*known}]
    if missing and not issues:
        issues.append(Issue(f"no row for {', '.join(missing)}", hint="every column needs the row of the same name"))
    return matrix, issues or (_asymmetry_issues(names, matrix) if {*names} <= {*known} else [])


def _asymmetry_issues(names: Sequence[str], matrix: Array) -> list[Issue]:
    sigma = np.sqrt(np.abs(np.diag(matrix)))
    scale = np.outer(sigma, sigma)
    # 1e-6 of the largest possible entry: a file written with seven digits is symmetric.
    pairs = np.argwhere(np.triu(np.abs(matrix - matrix.T) > 1e-6 * np.maximum(scale, np.abs(matrix)), 1))
    apart = np.abs(matrix - matrix.T) / np.maximum(np.maximum(np.abs(matrix), np.abs(matrix.T)), 1e-300)
    return [
        Issue(f"not symmetric: row {names[i]}, column {names[j]} and the reverse differ by {100 * apart[i, j]:.3g} %")
        for i, j in pairs[:10]
    ]
