"""Intrinsics of cameras from files of OpenCV and ROS, and points of boards from their CSV files."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from posture_opt.csv_text import unguarded
from posture_opt.errors import BadValueError, InputError, Issue
from posture_opt.files import content, located, naming
from posture_opt.measurements.data_section import DataSpec
from posture_opt.measurements.layout import BRACKETED_HEADER
from posture_opt.measurements.pinhole import Intrinsics
from posture_opt.measurements.table import open_table
from posture_opt.units import parse_quantity

_MAX_BYTES = 1_000_000
_COEFFICIENTS = 5
"""k1, k2, p1, p2, k3: the plumb-bob model; further ones of OpenCV are used only where they are zero."""
_AXES = ("x", "y", "z")
_MODELS = ("plumb_bob", "")


def with_camera_files(data: DataSpec, folder: Path) -> DataSpec:
    """The section ``data`` with what the files of its cameras and boards say.

    Args:
        folder: where relative names start.

    Raises:
        InputError: no such file, or one that cannot be used, by the key that names it.
    """
    if not data.cameras and not data.markers:
        return data
    cameras, markers, issues = dict(data.cameras), dict(data.markers), list[Issue]()
    for name, camera in data.cameras.items():
        try:
            cameras[name] = camera.with_intrinsics(read_intrinsics(located(folder, camera.intrinsics)))
        except InputError as error:
            issues += [i if i.file else i.at("data", "cameras", name, "intrinsics") for i in error.issues]
    for name, board in data.markers.items():
        if board.points is None:
            continue
        try:
            markers[name] = board.with_points(read_points(located(folder, board.points)))
        except InputError as error:
            issues += [i if i.file else i.at("data", "markers", name, "points") for i in error.issues]
    if issues:
        raise InputError(issues)
    return data.model_copy(update={"cameras": cameras, "markers": markers})


def named_files(data: Mapping[str, Any]) -> Iterator[tuple[str, str, str]]:
    """Section, entry and key of every file that the plain data of a section ``data`` name."""
    for section, key in (("cameras", "intrinsics"), ("markers", "points")):
        for name, entry in (data.get(section) or {}).items():
            if entry.get(key):
                yield section, name, key


def read_intrinsics(path: Path) -> Intrinsics:
    """Camera matrix and distortion of a YAML file that OpenCV or ROS wrote.

    Raises:
        InputError: no such file, no YAML, another model of distortion, or numbers that are no camera's.
    """
    try:
        text = content(path, _MAX_BYTES).decode("utf-8", "replace")
    except InputError as error:
        raise naming(path, error) from None
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
    """The intrinsics of the plain data of a file.

    Raises:
        BadValueError: what is missing, or wrong.
    """
    if not isinstance(found, dict):
        raise BadValueError("this is no YAML of a camera", "OpenCV and ROS write camera_matrix: {data: [...]}")
    K = _numbers(found, "camera_matrix", "K", "k")
    if len(K) != 9:
        raise BadValueError("camera_matrix has not nine numbers", "fx, 0, cx, 0, fy, cy, 0, 0, 1")
    names = ("distortion_coefficients", "distortion_coeffs", "dist_coeffs", "D", "d")
    D = _numbers(found, *names) if any(name in found for name in names) else []
    model = str(found.get("distortion_model", ""))
    further = [value for value in D[_COEFFICIENTS:] if value]
    if (model not in _MODELS and any(D) and (further or "rational" not in model)) or further:
        hint = "calibrate the camera with k1, k2, p1, p2, k3 (plumb_bob), OpenCV's default"
        raise BadValueError(f"the distortion model {model or 'with more than five coefficients'} is not known", hint)
    fx, skew, cx, _, fy, cy = K[:6]
    if not (fx > 0 and fy > 0) or skew:
        raise BadValueError("the focal lengths are not positive, or there is a skew", "fx, 0, cx, 0, fy, cy, 0, 0, 1")
    size = tuple(int(found.get(f"image_{side}", found.get(side, 0)) or 0) for side in ("width", "height"))
    coefficients = [*D[:_COEFFICIENTS], *[0.0] * _COEFFICIENTS][:_COEFFICIENTS]
    return Intrinsics((fx, fy), (cx, cy), tuple(coefficients), (size[0], size[1]))


def _numbers(found: Mapping[str, Any], *names: str) -> list[float]:
    """The numbers of a matrix, a list of numbers or of rows, under the first of the names that there is.

    Raises:
        BadValueError: none is there, or no finite numbers.
    """
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
    """Where the markers of a board are on it [m], from ``marker, x [mm], y [mm], z [mm]``; z may be left out.

    Raises:
        InputError: columns that are missing or unknown, cells that are no numbers, a marker twice; with their lines.
    """
    raw = open_table(path, ("marker", *_AXES))
    columns = {}
    for index, title in enumerate(raw.titles):
        match = BRACKETED_HEADER.match(title)
        columns[(match["name"] if match else title).strip()] = (index, (match["unit"] or "") if match else "")
    if not {"marker", "x", "y"} <= set(columns):
        raw.faults.stop("the header does not fit", "marker, x [mm], y [mm], z [mm]", raw.line)
    factors = {}
    for axis in _AXES:
        if axis in columns:
            try:
                factors[axis] = parse_quantity(f"1 {columns[axis][1]}", "length")
            except BadValueError as error:
                raw.faults.add(error.message, axis, columns[axis][1], f"write {axis} [mm]", raw.line)
    raw.faults.refuse()
    found: dict[str, tuple[float, float, float]] = {}
    for block in raw.blocks:
        for row, line in enumerate(block.lines):
            name = unguarded(str(block.cells[columns["marker"][0]][row]).strip())
            if name in found:
                raw.faults.add("the marker is given twice", "marker", name, "keep one", int(line))
            place = {axis: _cell(block.cells[columns[axis][0]][row], axis, int(line), raw.faults) for axis in factors}
            x, y, z = (place.get(axis, 0.0) * factors.get(axis, 1.0) for axis in _AXES)
            found[name] = (x, y, z)
    raw.faults.refuse()
    return found


def _cell(cell: object, name: str, line: int, faults: Any) -> float:
    """The number in a cell; a fault where there is none."""
    try:
        value = float(str(cell))
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        faults.add("the cell is no number", name, cell, "give a number", line)
        return 0.0
    return value
