"""``Targets``: where the tool is to come, row by row, and which posture to stay near."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from posture_opt.limits import MOST_COMPENSATED
from posture_opt.measurements.columns import AXES, Cells, Column, check_inputs, read_cells
from posture_opt.measurements.data_section import DataSpec
from posture_opt.measurements.header import column_kinds, known_columns
from posture_opt.measurements.measurements import nominal_poses, still_axes
from posture_opt.measurements.orientation_columns import incomplete_orientation, is_oriented, orientation_of
from posture_opt.measurements.rotations import rotation_matrices
from posture_opt.measurements.table import Faults, TableLike, open_table
from posture_opt.numerics import Array, Codes
from posture_opt.robot.robot import Robot


@dataclass(frozen=True, eq=False)
class Targets:
    """N targets in the order of the file."""

    headers: tuple[str, ...]  # of all columns, as given
    cells: tuple[tuple[str, ...], ...]  # (N rows) their texts
    columns: Mapping[str, Column]  # what each known column is, by name
    position: Array | None  # (N, 3) wanted tool point, world [m]; None where the file has joint values alone
    rotation: Array | None  # (N, 3, 3) wanted orientation of the tool in the world, or None: any
    near: Array | None  # (N, n) the postures to stay near [rad or m], or None
    side: Array  # (N, n) the stated side from which a joint arrives, -1 or +1; 0 where the row before says it
    payload: Array | None  # (N,) [kg]; None without the column
    temperature: Array | None  # (N,) [degC]
    time: Array | None  # (N,) [s]
    line: Codes  # (N,) of each row in file
    file: str
    separator: str = ","  # of its cells
    decimal: str = "."  # mark in its numbers

    def __len__(self) -> int:
        return len(self.line)


def read_targets(source: TableLike, robot: Robot) -> Targets:
    """Targets of a table with columns of measurements, joints or the tool point left out; InputError for all faults."""
    table = open_table(source, column_kinds(robot))
    faults = table.faults
    columns, meant = known_columns(table.titles, robot, table.line, faults)
    _check_missing(columns, meant, robot, table.line, faults)
    blocks = list(table.blocks)
    cells = read_cells(blocks, columns.values(), faults)
    if not len(cells.line) and not faults.count:
        faults.stop("there is no row behind the header", "add one row for each target", table.line)
    MOST_COMPENSATED.check_at(len(cells.line), (faults.file,))
    faults.refuse()
    check_inputs(cells, robot, faults)
    near = _near_postures(cells, columns, robot, faults)
    position = _wanted_positions(cells, columns, robot)
    turned = orientation_of(cells, columns, robot, DataSpec(), faults)
    faults.refuse()
    texts = [[_cell_text(cell) for cell in row] for block in blocks for row in zip(*block.cells, strict=True)]
    return Targets(
        table.titles, tuple(map(tuple, texts)), columns, position,
        None if turned is None else rotation_matrices(turned.quaternions()), near, _stated_sides(cells, robot),
        cells.number("payload"), cells.number("temperature"), cells.number("time"), cells.line, faults.file,
        table.separator, cells.marks.decimal,
    )  # fmt: skip


def _check_missing(columns: dict[str, Column], meant: set[str], robot: Robot, line: int, faults: Faults) -> None:
    there = {*columns, *meant}
    for name in ("target", "robot", "point"):  # columns of measurements alone
        if name in columns:
            faults.add("targets have no such column", name, hint="leave it out: it belongs to measurements", line=line)
    joints = [joint for joint in robot.joints if joint.name in there]
    axes = [axis for axis in AXES if axis in there]
    for joint in robot.joints if joints else ():
        if joint.name not in there:
            unit = "deg" if joint.type == "revolute" else "mm"
            hint = f"add {joint.name} [{unit}], or leave out all joints"
            faults.add("the column of this joint is missing", joint.name, hint=hint, line=line)
    for axis, fixed in zip(AXES, still_axes(robot), strict=True):
        if axes and axis not in there and not fixed:
            faults.add(f"the column {axis} is missing", axis, hint=f"add {axis} [mm]", line=line)
    if not axes and not joints:
        hint = "add x [mm], y [mm], z [mm], or a column for every joint"
        faults.add("nothing says where to go", hint=hint, line=line)
    incomplete_orientation(there, robot, line, faults)
    if is_oriented(columns, robot) and not axes:
        faults.add("an orientation without a place", hint="add x [mm], y [mm], z [mm]", line=line)


def _near_postures(cells: Cells, columns: Mapping[str, Column], robot: Robot, faults: Faults) -> Array | None:
    """Postures (N, n) [rad or m] of the joint columns, ``None`` without; values beyond the limits are faults."""
    if robot.joint_names[0] not in columns:
        return None
    found = [cells.number(name) for name in robot.joint_names]
    q = np.column_stack([values for values in found if values is not None])
    for values, joint in zip(q.T, robot.joints, strict=True):
        column = columns[joint.name]
        # Limits are written with six digits.
        for row in np.flatnonzero((values > joint.upper + 1e-6) | (values < joint.lower - 1e-6)):
            bounds = ", ".join(f"{bound / column.factor:.6g}" for bound in (joint.lower, joint.upper))
            message = f"{values[row] / column.factor:.6g} {column.unit} lies beyond its limits [{bounds}]"
            hint = "correct the value, its unit, or the limits of the joint"
            faults.add(message, joint.name, values[row], hint, int(cells.line[row]))
    return np.clip(q, robot.lower, robot.upper)


def _wanted_positions(cells: Cells, columns: Mapping[str, Column], robot: Robot) -> Array | None:
    """Wanted points (N, 3) [m], world, or ``None``; a coordinate that the arm cannot change may be missing."""
    if not any(axis in columns for axis in AXES):
        return None
    fixed, found = nominal_poses(robot, np.array([robot.lower]))[0][0], [cells.number(axis) for axis in AXES]
    return np.column_stack([np.full(len(cells.line), fixed[k]) if v is None else v for k, v in enumerate(found)])


def _stated_sides(cells: Cells, robot: Robot) -> Array:
    """Sides (N, n) of the columns ``JOINT.approach``, −1 or +1; 0 where none is stated."""
    side = np.zeros((len(cells.line), robot.n))
    for j, name in enumerate(robot.joint_names):
        values = cells.number(f"{name}.approach")
        if values is not None:
            side[:, j] = np.nan_to_num(values, nan=0.0)
    return side


def _cell_text(cell: object) -> str:
    return cell.strip() if isinstance(cell, str) else repr(float(cell)) if isinstance(cell, float) else str(cell)
