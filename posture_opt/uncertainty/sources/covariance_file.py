"""A covariance matrix from a CSV file with named rows and columns."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import replace
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np

from posture_opt.errors import BadValueError, InputError, Issue, KeyPath, nearest
from posture_opt.files import content, naming
from posture_opt.numerics import Array
from posture_opt.robot.corrections import name_issues
from posture_opt.texts import csv_line, number_or_nan, unguarded
from posture_opt.units import NEGLIGIBLE, parse_quantity

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
