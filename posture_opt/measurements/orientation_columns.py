"""Measured orientations: unit quaternions, fixed-axis angles, or rotation vectors."""

from __future__ import annotations

from collections.abc import Container

import numpy as np

from posture_opt.measurements.columns import Cells, Column
from posture_opt.measurements.faults import Faults
from posture_opt.measurements.kinds.pose_columns import ANGLES, QUATERNION, VECTOR
from posture_opt.numerics import TURN, Array, Codes
from posture_opt.robot.robot import Robot

DEGREES = ("deg", "°", "º", "Grad", "Grd")
"""How files write degrees."""
_GROUP_WORDS = {QUATERNION: "the quaternion", ANGLES: "the orientation", VECTOR: "the rotation vector"}
NO_ORIENTATION_NOTE = "orientations are left out: measurement.orientation states no σ for them"
_NORM_TOLERANCE = 5e-3
"""How far the norm of a quaternion written with three decimals may be off one."""
_UNIT_TOLERANCE = 1e-15
"""How far the norm of a quaternion that was normalised before is off one; it is not normalised again."""


def angle_columns(robot: Robot) -> tuple[str, ...]:
    """The columns of angles that may hold an orientation: a joint of such a name takes its group away."""
    groups = (group for group in (ANGLES, VECTOR) if not {*group} & {*robot.joint_names})
    return tuple(name for group in groups for name in group)


def is_oriented(there: Container[str], robot: Robot) -> bool:
    """Whether some columns of an orientation are there."""
    return any(name in there for name in (QUATERNION[0], *angle_columns(robot)))


def incomplete_orientation(there: Container[str], robot: Robot, line: int, faults: Faults) -> None:
    """Faults where only some of the columns of an orientation are there, or those of two."""
    known = {*QUATERNION, *angle_columns(robot)}
    given = [group for group in _GROUP_WORDS if any(name in known and name in there for name in group)]
    for group in given:
        lacking = ", ".join(name for name in group if name not in there)
        if lacking:
            first = next(name for name in group if name in there)
            hint = f"give all of {', '.join(group)} or none"
            faults.add(f"{_GROUP_WORDS[group]} lacks {lacking}", first, hint=hint, line=line)
    if len(given) > 1:
        both = " and ".join(", ".join(group) for group in given)
        faults.add(f"the orientation is stated twice, by {both}", given[1][0], hint="keep one", line=line)


def rotation_of(cells: Cells, columns: dict[str, Column], robot: Robot, faults: Faults) -> Array | None:
    """(N, 4) unit quaternions (w, x, y, z) with w >= 0, NaN where cells are empty; ``None`` without such columns."""
    if QUATERNION[0] in columns:
        return unit_quaternions(cells, cells.line, faults)
    known = angle_columns(robot)
    if ANGLES[0] in columns and ANGLES[0] in known:
        return _of_angles(_stacked_columns(cells, ANGLES), columns, cells.line, faults)
    if VECTOR[0] in columns and VECTOR[0] in known:
        return _of_vectors(_stacked_columns(cells, VECTOR), columns, cells.line, faults)
    return None


def unit_quaternions(cells: Cells, line: Codes, faults: Faults) -> Array:
    """(N, 4) unit quaternions with w >= 0 of the columns ``qw, qx, qy, qz``; a norm that is far from one is a fault."""
    rotation = _stacked_columns(cells, QUATERNION)
    norm = np.linalg.norm(rotation, axis=1)
    for row in np.flatnonzero(np.abs(norm - 1) > _NORM_TOLERANCE):
        hint = "a rotation has norm 1; are the columns in the order of their names?"
        faults.add(f"the quaternion has norm {norm[row]:.4g}", "qw", norm[row], hint, int(line[row]))
    divisor = np.where((norm > 0) & (np.abs(norm - 1) > _UNIT_TOLERANCE), norm, 1.0)
    return _upper_half(rotation / divisor[:, None])


def _of_angles(angles: Array, columns: dict[str, Column], line: Codes, faults: Faults) -> Array:
    """(N, 4) quaternions of (N, 3) roll, pitch, yaw [rad]: ``R = Rz(yaw) Ry(pitch) Rx(roll)``, the convention of
    URDF.
    """
    for k, name in enumerate(ANGLES):
        _check_turns(angles[:, k], columns[name], line, faults)
    (cr, cp, cy), (sr, sp, sy) = np.cos(angles.T / 2), np.sin(angles.T / 2)
    parts = [
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    ]
    return _upper_half(np.column_stack(parts))


def _of_vectors(vectors: Array, columns: dict[str, Column], line: Codes, faults: Faults) -> Array:
    """(N, 4) quaternions of rotation vectors (N, 3) [rad]: axis times angle, as Universal Robots writes poses."""
    in_degrees = [name for name in VECTOR if columns[name].unit in DEGREES]
    if in_degrees:
        message = f"{', '.join(in_degrees)} in degrees: a rotation vector is in rad"
        hint = (
            'are they angles about fixed axes? data: {columns: {roll: "rx [deg]", pitch: "ry [deg]", yaw: "rz [deg]"}}'
        )
        faults.add(message, in_degrees[0], hint=hint)
    angle = np.linalg.norm(vectors, axis=1)
    for row in np.flatnonzero(angle > TURN * 1.01) if not in_degrees else ():
        message = f"the rotation vector has a length of {angle[row]:.4g} rad, more than a turn"
        faults.add(message, "rx", angle[row], "is it in rad, and axis times angle?", int(line[row]))
    half = angle / 2
    factor = np.where(angle > 0, np.sin(half) / np.where(angle > 0, angle, 1.0), 0.5)
    return _upper_half(np.column_stack([np.cos(half), vectors * factor[:, None]]))


def _check_turns(values: Array, column: Column, line: Codes, faults: Faults) -> None:
    """A fault for each angle (N,) [rad] of more than a turn: its unit is another one."""
    for row in np.flatnonzero(np.abs(values) > TURN * 1.01):
        message = f"{values[row] / column.factor:.6g} {column.unit} is more than a turn"
        faults.add(message, column.name, values[row], "is its unit right?", int(line[row]))


def _stacked_columns(cells: Cells, names: tuple[str, ...]) -> Array:
    """(N, k) the columns of these names."""
    found = [cells.number(name) for name in names]
    return np.column_stack([values for values in found if values is not None])


def _upper_half(rotation: Array) -> Array:
    """(N, 4) the same rotations with w >= 0."""
    return np.asarray(np.where(rotation[:, :1] < 0, -rotation, rotation))
