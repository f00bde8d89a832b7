"""Files that a problem file names: intrinsics of cameras, points of boards and paths, second arms."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from posture_opt.errors import BadValueError, InputError, Issue, nearest
from posture_opt.files import located, named_content
from posture_opt.limits import MOST_PATH_POINTS
from posture_opt.measurements.camera_section import Intrinsics
from posture_opt.measurements.columns import NumberText
from posture_opt.measurements.data_section import DataSpec
from posture_opt.measurements.kinds import PairSpec
from posture_opt.measurements.layout import name_and_unit
from posture_opt.measurements.measurements import reach
from posture_opt.measurements.table import Faults, RawTable, open_table
from posture_opt.numerics import Array
from posture_opt.problem.yaml_source import ProblemDocument, read_yaml
from posture_opt.robot.robot import Robot
from posture_opt.selection.tasks import Task
from posture_opt.selection.tasks.path_task import PathTask, repeated
from posture_opt.texts import unguarded
from posture_opt.units import LARGEST, parse_quantity

_POINT, _AXIS = ("x", "y", "z"), ("dx", "dy", "dz")
Vectors = tuple[tuple[float, float, float], ...]  # Points [m] or directions, one a row
ReadParts = Callable[[ProblemDocument, Path, Mapping[str, str]], tuple[Any, Any, Any]]


def with_named_files(data: DataSpec, folder: Path, read_parts: ReadParts) -> tuple[DataSpec, list[Issue]]:
    """The section ``data`` with what the files of its cameras, boards and second arms say, and what is wrong with them.

    ``read_parts`` reads the problem file of a second arm.
    """

    def with_arm(pair: PairSpec, path: Path) -> PairSpec:
        _, (_, arm), (sources, _) = read_parts(second_document(path), path.parent, {})
        sigmas = zip(sources.names, map(float, np.sqrt(np.diag(sources.constant))), strict=True)
        return pair.with_arm(arm, dict(sigmas))

    read: dict[tuple[str, str], Callable[[Any, Path], Any]] = {
        ("cameras", "intrinsics"): lambda camera, path: camera.with_intrinsics(read_intrinsics(path)),
        ("markers", "points"): lambda board, path: board.with_points(read_points(path)),
        ("pairs", "problem"): with_arm,
    }
    issues: list[Issue] = []
    for (section, key), with_file in read.items():
        entries = dict(getattr(data, section))
        for name, entry in entries.items():
            try:
                entries[name] = with_file(entry, located(folder, file)) if (file := getattr(entry, key)) else entry
            except InputError as error:
                issues += [i if i.file else i.at("data", section, name, key) for i in error.issues]
        data = data.model_copy(update={section: entries})
    return data, issues


def named_files(data: Mapping[str, Any]) -> Iterator[tuple[str, str, str]]:
    """Section, entry and key of every file that the plain data of a section ``data`` name."""
    for section, key in (("cameras", "intrinsics"), ("markers", "points")):
        for name, entry in (data.get(section) or {}).items():
            if entry.get(key):
                yield section, name, key


def read_intrinsics(path: Path) -> Intrinsics:
    """Camera matrix and distortion of a YAML file that OpenCV or ROS wrote."""
    text = named_content(path, 1_000_000).decode("utf-8", "replace")
    # OpenCV writes %YAML:1.0, which is none, and a tag for matrices
    plain = re.sub(r"^%YAML.*$", "", text, flags=re.MULTILINE).replace("!!opencv-matrix", "")
    try:
        found = yaml.safe_load(plain)
    except yaml.YAMLError:
        found = None
    try:
        return _intrinsics(found)
    except BadValueError as error:
        raise InputError(Issue(error.message, hint=error.hint, file=str(path))) from None


def _intrinsics(found: Any) -> Intrinsics:
    if not isinstance(found, dict):
        raise BadValueError("this is no YAML of a camera", "OpenCV and ROS write camera_matrix: {data: [...]}")
    K = _numbers(found, "camera_matrix", "K", "k")
    if len(K) != 9:
        raise BadValueError("camera_matrix has not nine numbers", "fx, 0, cx, 0, fy, cy, 0, 0, 1")
    names = ("distortion_coefficients", "distortion_coeffs", "dist_coeffs", "D", "d")
    D = _numbers(found, *names) if any(name in found for name in names) else []
    model = str(found.get("distortion_model", ""))
    # Plumb-bob: k1, k2, p1, p2, k3; further ones of OpenCV are used only where they are zero.
    if any(D[5:]) or (model not in ("plumb_bob", "") and any(D) and "rational" not in model):
        hint = "calibrate the camera with k1, k2, p1, p2, k3 (plumb_bob), OpenCV's default"
        raise BadValueError(f"the distortion model {model or 'with more than five coefficients'} is not known", hint)
    fx, skew, cx, _, fy, cy = K[:6]
    if not (fx > 0 and fy > 0) or skew:
        raise BadValueError("the focal lengths are not positive, or there is a skew", "fx, 0, cx, 0, fy, cy, 0, 0, 1")
    size = tuple(int(found.get(f"image_{side}", found.get(side, 0)) or 0) for side in ("width", "height"))
    return Intrinsics((fx, fy), (cx, cy), (*D, *[0.0] * 5)[:5], (size[0], size[1]))


def _numbers(found: Mapping[str, Any], *names: str) -> list[float]:
    given = next((found[name] for name in names if name in found), None)
    given = given.get("data") if isinstance(given, dict) else given
    try:
        values = np.array(given, dtype=float).ravel() if given is not None else np.zeros(0)
    except (TypeError, ValueError):
        values = np.array([np.nan])
    if given is None or not np.isfinite(values).all():
        raise BadValueError(f"{names[0]} is missing, or has no numbers", "OpenCV and ROS write it with data: [...]")
    return [float(v) for v in values]


def read_points(path: Path) -> dict[str, tuple[float, float, float]]:
    """Where the markers of a board are on it [m], from ``marker, x [mm], y [mm], z [mm]``; z may be left out."""
    raw = open_table(path, ("marker", *_POINT))
    columns = {name: (index, unit) for index, (name, unit) in enumerate(map(name_and_unit, raw.titles))}
    if not {"marker", "x", "y"} <= set(columns):
        raw.faults.stop("the header does not fit", "marker, x [mm], y [mm], z [mm]", raw.line)
    factors = {axis: _factor(axis, columns[axis][1], raw) for axis in _POINT if axis in columns}
    raw.faults.refuse()
    found: dict[str, tuple[float, float, float]] = {}
    for block in raw.blocks:
        for row, line in enumerate(block.lines):
            name = unguarded(str(block.cells[columns["marker"][0]][row]).strip())
            if name in found:
                raw.faults.add("the marker is given twice", "marker", name, "keep one", int(line))
            place = {
                axis: _number(str(block.cells[columns[axis][0]][row]), axis, int(line), raw.faults, factor)
                for axis, factor in factors.items()
            }
            x, y, z = (place.get(axis, 0.0) for axis in _POINT)
            found[name] = (x, y, z)
    raw.faults.refuse()
    return found


def with_path(task: Task | None, folder: Path) -> Task | None:
    """The task with the points of the file that it names, if it names one."""
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
    if far < 50 * long or far * 1e-3 > long:
        return []
    message = f"its points are up to {far:.4g} m from the base, and the arm reaches {long:.3g} m"
    hint = "the numbers look like mm: write x [mm], y [mm], z [mm]"
    return [Issue(message, ("task", "path"), task.path, hint)]


def _read(raw: RawTable) -> tuple[Vectors, Vectors | None]:
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
    by_name = dict(zip(columns, np.array(rows, dtype=float).reshape(len(rows), len(columns)).T, strict=True))
    # A coordinate that is left out is zero.
    points, axes = (
        np.column_stack([by_name.get(name, np.zeros(len(rows))) for name in names]) for names in (_POINT, _AXIS)
    )
    faults, path = raw.faults, _tuples(points)
    faults.refuse()
    if len(path) < 2:
        faults.stop(f"a path has at least two points, {len(path)} given", "add rows", raw.line + len(path))
    for k in repeated(path):
        faults.add(f"the point of line {lines[k]} again", hint="leave out one of the two rows", line=lines[k + 1])
    if "dx" not in columns:
        faults.refuse()
        return path, None
    for k in map(int, np.flatnonzero(np.linalg.norm(axes, axis=1) < 1e-12)):
        faults.add("dx, dy, dz of length zero point nowhere", "dx", hint="write for example 0, 0, -1", line=lines[k])
    faults.refuse()
    return path, _tuples(axes)


def _columns(raw: RawTable) -> dict[str, tuple[int, float]]:
    found: dict[str, tuple[int, float]] = {}
    for index, (name, unit) in enumerate(map(name_and_unit, raw.titles)):
        if name not in (*_POINT, *_AXIS):
            near = nearest(name, (*_POINT, *_AXIS))
            hint = f"did you mean '{near}'?" if near else "a path has x [mm], y [mm], z [mm] and optionally dx, dy, dz"
            raw.faults.add("unknown column", name if near else f"column {index + 1}", name, hint, raw.line)
        elif name in found:
            raw.faults.add("two columns have this name", name, hint="keep one", line=raw.line)
        else:
            found[name] = index, _factor(name, unit, raw)
    for name in ("x", "y"):
        if name not in found:
            raw.faults.add("the column is missing", name, hint=f"add {name} [mm]", line=raw.line)
    axis = [name for name in _AXIS if name in found]
    if axis and axis[:2] != ["dx", "dy"]:
        raw.faults.add(f"{', '.join(axis)} alone make no direction", axis[0], hint="add dx, dy, dz", line=raw.line)
    raw.faults.refuse()
    return found


def _factor(name: str, unit: str, raw: RawTable) -> float:
    if name in _AXIS:
        if unit not in ("", "-", "1"):
            raw.faults.add(f"a direction has no unit, '{unit}' is given", name, unit, f"write {name}", raw.line)
        return 1.0
    try:
        return parse_quantity(f"1 {unit}", "length")
    except BadValueError as error:
        message = error.message if unit else "the column has no unit"
        raw.faults.add(message, name, unit or None, f"write {name} [mm]", raw.line)
        return 1.0


def _number(cell: str, name: str, line: int, faults: Faults, factor: float) -> float:
    try:
        value = float(cell) * factor
    except ValueError:
        value = np.nan
    if np.isfinite(value) and abs(value) <= LARGEST["length"]:
        return value
    fault = "this is not plausible" if np.isfinite(value) else "this is not a finite number"
    faults.add(fault, name, cell, "write a number like 12.5", line)
    return np.nan


def _tuples(rows: Array) -> Vectors:
    """Rows (N, 3) as tuples of floats."""
    return tuple((float(x), float(y), float(z)) for x, y, z in rows)


def second_document(path: Path) -> ProblemDocument:
    """What a problem file says of its arm."""
    document = read_yaml(path)
    of_arm = ("name", "robot", "uncertainty", "effects")  # its data may name the first arm as the second of its own
    return replace(document, data={key: value for key, value in document.data.items() if key in of_arm})
