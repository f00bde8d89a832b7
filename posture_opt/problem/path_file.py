"""The points of a path from their CSV file: ``x [mm], y [mm], z [mm]``, and ``dx, dy, dz`` for the tool axis.

Points are in the world frame. ``z`` may be left out (zero), as may ``dz`` with directions in a plane; directions need
not have unit length.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from posture_opt.errors import BadValueError, InputError, Issue, nearest
from posture_opt.files import located
from posture_opt.limits import MOST_PATH_POINTS
from posture_opt.measurements.affine_fit import reach
from posture_opt.measurements.faults import Faults
from posture_opt.measurements.number_text import NumberText
from posture_opt.measurements.table import RawTable, open_table
from posture_opt.numerics import Array
from posture_opt.robot.robot import Robot
from posture_opt.selection.tasks import Task
from posture_opt.selection.tasks.path_task import PathTask, repeated
from posture_opt.units import LARGEST, parse_quantity

Vectors = tuple[tuple[float, float, float], ...]
"""Points [m] or directions, one a row."""
_COLUMN_HEADER = re.compile(r"^\s*(?P<name>[^\[\]]*?)\s*(?:\[(?P<unit>[^\[\]]*)\])?\s*$")
_POINT, _AXIS = ("x", "y", "z"), ("dx", "dy", "dz")
_FAR_REACHES = 50.0  # of the arm: points beyond were written in another unit
_MIN_AXIS_LENGTH = 1e-12  # of dx, dy, dz


def with_path(task: Task | None, folder: Path) -> Task | None:
    """The task with the points of the file that it names, if it names one.

    Args:
        folder: where relative names start.

    Raises:
        InputError: no such file, or everything wrong with its header and rows, each with its line.
    """
    if not isinstance(task, PathTask) or task.path is None:
        return task
    try:
        return task.with_points(*_read(open_table(located(folder, task.path), (*_POINT, *_AXIS))))
    except InputError as error:
        raise InputError([issue if issue.file else issue.at("task", "path") for issue in error.issues]) from None
    except BadValueError as error:
        raise InputError(error.issue(("task", "path"), task.path)) from None


def far_points(task: Task | None, robot: Robot) -> list[Issue]:
    """A path whose points only another unit of length brings within reach; without one, a search says how far it is."""
    if not isinstance(task, PathTask) or task.path is None:
        return []
    base = [next((f.nominal for f in robot.factors if f.parameter == f"base.{axis}"), 0.0) for axis in _POINT]
    far, long = float(np.abs(np.array(task.points) - base).max()), max(reach(robot), 1e-3)
    if far < _FAR_REACHES * long or far * 1e-3 > long:
        return []
    message = f"its points are up to {far:.4g} m from the base, and the arm reaches {long:.3g} m"
    hint = "the numbers look like mm: write x [mm], y [mm], z [mm]"
    return [Issue(message, ("task", "path"), task.path, hint)]


def _read(
    raw: RawTable,
) -> tuple[Vectors, Vectors | None]:
    """Points [m] and axes of the rows, world frame; None for the axes where the file has none."""
    columns = _columns(raw)
    lines: list[int] = []
    rows: list[list[float]] = []
    marks = None
    for block in raw.blocks:
        marks = marks or NumberText.of((cell for cells in block.cells for cell in cells), None, None)
        if len(rows) + len(block.lines) > MOST_PATH_POINTS.most:
            raw.faults.stop(MOST_PATH_POINTS.beyond, MOST_PATH_POINTS.hint)
        for r, line in enumerate(block.lines):
            lines.append(line)
            texts = {name: marks.to_plain(block.cells[i][r]) for name, (i, _) in columns.items()}
            rows.append([_number(texts[name], name, line, raw.faults, f) for name, (_, f) in columns.items()])
    table = np.array(rows, dtype=float).reshape(len(rows), len(columns))
    by_name = dict(zip(columns, table.T, strict=True))
    points = _together(by_name, _POINT, len(rows))
    axes = _together(by_name, _AXIS, len(rows)) if "dx" in columns else None
    _check(points, axes, lines, raw)
    return _tuples(points), None if axes is None else _tuples(axes)


def _columns(raw: RawTable) -> dict[str, tuple[int, float]]:
    """Name -> index and factor to SI of the known columns.

    Raises:
        InputError: unknown, repeated or missing columns, or units that are none of a length.
    """
    found: dict[str, tuple[int, float]] = {}
    for index, head in enumerate(raw.titles):
        match = _COLUMN_HEADER.match(head)
        name, unit = (match["name"], (match["unit"] or "").strip()) if match else (head.strip(), "")
        if name not in (*_POINT, *_AXIS):
            near = nearest(name, (*_POINT, *_AXIS))
            hint = f"did you mean '{near}'?" if near else "a path has x [mm], y [mm], z [mm] and optionally dx, dy, dz"
            raw.faults.add("unknown column", name if near else f"column {index + 1}", name, hint, raw.line)
        elif name in found:
            raw.faults.add("two columns have this name", name, hint="keep one", line=raw.line)
        else:
            found[name] = index, _factor(name, unit, raw)
    _missing(found, raw)
    raw.faults.refuse()
    return found


def _factor(name: str, unit: str, raw: RawTable) -> float:
    """The factor from a column's unit to SI; 1 for directions, and where the unit cannot be used, which is reported."""
    if name in _AXIS:
        if unit not in ("", "-", "1"):
            raw.faults.add(f"a direction has no unit, '{unit}' is given", name, unit, f"write {name}", raw.line)
        return 1.0
    if not unit:
        raw.faults.add("the column has no unit", name, None, f"write {name} [mm]", raw.line)
        return 1.0
    try:
        return parse_quantity(f"1 {unit}", "length")
    except BadValueError as error:
        raw.faults.add(error.message, name, unit, f"write {name} [mm]", raw.line)
        return 1.0


def _missing(found: dict[str, tuple[int, float]], raw: RawTable) -> None:
    """Planar arms may leave out z; dx, dy, dz come together."""
    for name in ("x", "y"):
        if name not in found:
            raw.faults.add("the column is missing", name, hint=f"add {name} [mm]", line=raw.line)
    axis = [name for name in _AXIS if name in found]
    if axis and axis[:2] != ["dx", "dy"]:
        raw.faults.add(f"{', '.join(axis)} alone make no direction", axis[0], hint="add dx, dy, dz", line=raw.line)


def _number(cell: str, name: str, line: int, faults: Faults, factor: float) -> float:
    """A finite number times ``factor``; NaN with a fault reported where the cell has none, or one beyond any cell."""
    try:
        value = float(cell) * factor
    except ValueError:
        value = np.nan
    if np.isfinite(value) and abs(value) <= LARGEST["length"]:
        return value
    fault = "this is not plausible" if np.isfinite(value) else "this is not a finite number"
    faults.add(fault, name, cell, "write a number like 12.5", line)
    return np.nan


def _together(columns: Mapping[str, Array], names: tuple[str, ...], rows: int) -> Array:
    """(N, 3) of columns; one that is left out is zero."""
    return np.column_stack([columns.get(name, np.zeros(rows)) for name in names])


def _check(points: Array, axes: Array | None, lines: list[int], raw: RawTable) -> None:
    """Refuses paths of fewer than two points, points twice in a row, and directions of length zero.

    Args:
        points: (N, 3) [m]; ``axes`` (N, 3) or None; ``lines`` of the file that they are in.
    """
    faults = raw.faults
    faults.refuse()
    if len(points) < 2:
        faults.stop(f"a path has at least two points, {len(points)} given", "add rows", raw.line + len(points))
    for k in repeated(_tuples(points)):
        faults.add(f"the point of line {lines[k]} again", hint="leave out one of the two rows", line=lines[k + 1])
    short = [] if axes is None else np.flatnonzero(np.linalg.norm(axes, axis=1) < _MIN_AXIS_LENGTH).tolist()
    for k in short:
        faults.add("dx, dy, dz of length zero point nowhere", "dx", hint="write for example 0, 0, -1", line=lines[k])
    faults.refuse()


def _tuples(rows: Array) -> Vectors:
    """Rows (N, 3) as tuples of floats."""
    return tuple((float(x), float(y), float(z)) for x, y, z in rows)
