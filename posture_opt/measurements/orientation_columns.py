"""Measured orientations, by the columns and the convention in which a file writes them."""

from __future__ import annotations

from collections.abc import Container, Iterator
from dataclasses import dataclass

import numpy as np

from posture_opt.measurements.columns import Cells, Column
from posture_opt.measurements.data_section import DataSpec
from posture_opt.measurements.kinds.pose import ORIENTATION_GROUPS, QUATERNION
from posture_opt.measurements.rotations import axis_turn, quaternions_of, rotation_matrices
from posture_opt.measurements.table import Faults
from posture_opt.numerics import TURN, Array, Codes
from posture_opt.robot.robot import Robot

NO_ORIENTATION_NOTE = "orientations are left out: measurement.orientation states no σ for them"
DEGREES = ("deg", "°", "º", "Grad", "Grd")  # How files write degrees
# ``data: {orientation: …}`` of three angles -> axes of their turns, the outermost first, and whether the last angle is
# that of the outermost: of turns about fixed axes, ``Rz(v₂) Ry(v₁) Rx(v₀)`` as in URDF
_CONVENTIONS = {
    "rpy": ((2, 1, 0), True),
    "intrinsic_xyz": ((0, 1, 2), False),
    "abc": ((2, 1, 0), False),
    "wpr": ((2, 1, 0), True),
    "zyz": ((2, 1, 2), False),
}
_GROUP_WORDS = {"quaternion": "the quaternion", "vector": "the rotation vector", "matrix": "the matrix"}
# Group of columns -> the convention that its names stand for
_OF_GROUP = {"angles": "rpy", "abc": "abc", "wpr": "wpr", "vector": "rotation_vector"}
_WORDS = {
    "rpy": "roll, pitch, yaw about fixed axes",
    "intrinsic_xyz": "turns about x, y', z''",
    "abc": "KUKA's A, B, C about z, y', x''",
    "wpr": "FANUC's W, P, R about fixed axes",
    "zyz": "turns about z, y', z''",
    "rotation_vector": "a rotation vector",
}


@dataclass(frozen=True, eq=False)
class OrientationColumns:
    """The columns of an orientation as they were read."""

    names: tuple[str, ...]  # (k,) of the columns
    numbers: Array  # (N, k) their values [rad]
    units: tuple[str, ...]  # (k,) as written
    convention: str  # how they are read; that of their names where none is stated

    def quaternions(self) -> Array:
        """(N, 4) unit quaternions (w, x, y, z) with w >= 0."""
        return _in_convention(self.numbers, self.convention)

    def take(self, rows: Codes) -> OrientationColumns:
        """The columns of some rows."""
        return OrientationColumns(self.names, self.numbers[rows], self.units, self.convention)

    def otherwise(self) -> Iterator[tuple[str, str, Array]]:
        """What the columns hold, the line to paste, and (N, 4) the quaternions, by every other convention."""
        if len(self.names) == 3:
            yield from self._of_three()
            return
        inverse = self.quaternions() * [1, -1, -1, -1]
        if self.convention == "matrix":
            mapping = [(i, j) for i in range(3) for j in range(3) if i != j]
            line = ", ".join(f'r{i + 1}{j + 1}: "r{j + 1}{i + 1}"' for i, j in mapping)
            yield "the rotation matrices are transposed", f"data: {{columns: {{{line}}}}}", inverse
            return
        for order in ((3, 0, 1, 2), (1, 2, 3, 0)):
            at = ", ".join(f'{name}: "{QUATERNION[k]}"' for name, k in zip(QUATERNION, order, strict=True))
            said = f"the quaternion is written in the order {', '.join(QUATERNION[i] for i in np.argsort(order))}"
            yield said, f"data: {{columns: {{{at}}}}}", _in_convention(self.numbers[:, order], "quaternion")
        yield "the quaternions are those of the inverse rotations", "reverse the signs of qx, qy, qz", inverse

    def _of_three(self) -> Iterator[tuple[str, str, Array]]:
        now, listed = self.quaternions(), ", ".join(self.names)
        for name, words in _WORDS.items():
            found = _in_convention(self.numbers, name)
            if name != self.convention and not np.allclose(found, now):
                yield f"{listed} are {words}", f"data: {{orientation: {name}}}", found
        meant, factor = ("rad", 180 / np.pi) if {*self.units} <= {*DEGREES} else ("deg", np.pi / 180)
        line = "write " + ", ".join(f"{name} [{meant}]" for name in self.names)
        yield f"{listed} are in {meant}", line, _in_convention(self.numbers * factor, self.convention)
        line = "write the orientation of the target in the instrument's frame, not the reverse"
        line = f"reverse the signs of {listed}" if self.convention == "rotation_vector" else line
        yield f"{listed} are those of the inverse rotations", line, now * [1, -1, -1, -1]


def groups_of(robot: Robot, prefix: str = "") -> dict[str, tuple[str, ...]]:
    """The groups of columns that may hold an orientation: a joint of such a name takes its group away.

    With the prefix of poses of the flange, the angles that are its joints are one of them.
    """
    names = {key: tuple(prefix + name for name in group) for key, group in ORIENTATION_GROUPS.items()}
    taken = set() if prefix else {*robot.joint_names}
    return {key: group for key, group in names.items() if key == "quaternion" or not {*group} & taken}


def orientation_names(robot: Robot, angles: bool) -> tuple[str, ...]:
    """The columns that may hold an orientation: angles, or what has no unit, of a quaternion and of a matrix."""
    groups = [pair for prefix in {"", robot.pose_prefix} for pair in groups_of(robot, prefix).items()]
    return tuple(name for key, group in groups if (key in _OF_GROUP) == angles for name in group)


def turned_joints_of(robot: Robot, there: Container[str]) -> tuple[str, ...]:
    """The joints whose values an orientation with the prefix of the robot holds, where its columns are there."""
    if not robot.pose_prefix or not is_oriented(there, robot, robot.pose_prefix):
        return ()
    return robot.joint_names[-3:]


def joint_turns(
    cells: Cells, columns: dict[str, Column], robot: Robot, spec: DataSpec, faults: Faults
) -> dict[str, Array]:
    """Joint -> (N,) its values, of the joints that an orientation holds: ``R = Rz(q₃) Ry(q₄) Rx(q₅)``.

    The stated convention is that of what was measured, where the rows have such an orientation too.
    """
    joints = turned_joints_of(robot, columns)
    own = DataSpec() if is_oriented(columns, robot) else spec
    found = orientation_of(cells, columns, robot, own, faults, robot.pose_prefix) if joints else None
    if found is None:
        return {}
    R = rotation_matrices(found.quaternions())
    pitch = np.arctan2(-R[:, 2, 0], np.hypot(R[:, 2, 1], R[:, 2, 2]))
    turns = np.arctan2(R[:, 1, 0], R[:, 0, 0]), pitch, np.arctan2(R[:, 2, 1], R[:, 2, 2])
    return dict(zip(joints, turns, strict=True))


def is_oriented(there: Container[str], robot: Robot, prefix: str = "") -> bool:
    """Whether some columns of an orientation are there."""
    return any(name in there for group in groups_of(robot, prefix).values() for name in group)


def incomplete_orientation(there: Container[str], robot: Robot, line: int, faults: Faults, prefix: str = "") -> None:
    """Faults where only some of the columns of an orientation are there, or those of two."""
    groups = {key: group for key, group in groups_of(robot, prefix).items() if any(name in there for name in group)}
    given = list(groups.values())
    for key, group in groups.items():
        lacking = ", ".join(name for name in group if name not in there)
        if lacking:
            first = next(name for name in group if name in there)
            hint = f"give all of {', '.join(group)} or none"
            faults.add(f"{_GROUP_WORDS.get(key, 'the orientation')} lacks {lacking}", first, hint=hint, line=line)
    if len(given) > 1:
        both = " and ".join(", ".join(group) for group in given)
        faults.add(f"the orientation is stated twice, by {both}", given[1][0], hint="keep one", line=line)


def orientation_of(
    cells: Cells, columns: dict[str, Column], robot: Robot, spec: DataSpec, faults: Faults, prefix: str = ""
) -> OrientationColumns | None:
    """The columns of the orientation, checked; ``None`` without such columns."""
    found = next(((key, group) for key, group in groups_of(robot, prefix).items() if group[0] in columns), None)
    if found is None:
        return None
    key, names = found
    read = [cells.number(name) for name in names]
    stated = spec.orientation if spec.orientation != "matrix" and key in _OF_GROUP else None
    given = OrientationColumns(
        names,
        numbers=np.column_stack([values for values in read if values is not None]),
        units=tuple(columns[name].unit for name in names),
        convention=stated or _OF_GROUP.get(key, key),
    )
    in_degrees = [name for name in names if columns[name].unit in DEGREES]
    if given.convention == "rotation_vector" and in_degrees and not stated:
        hint = "are they angles? data: {orientation: rpy}, or abc, wpr …; else data: {orientation: rotation_vector}"
        faults.add(f"{', '.join(in_degrees)} in degrees: a rotation vector is in rad", in_degrees[0], hint=hint)
    else:
        _check_numbers(given, columns, cells.line, faults)
    return given


def _in_convention(numbers: Array, convention: str) -> Array:
    """(N, 4) quaternions of columns (N, k) in a convention."""
    if convention == "quaternion":
        norm = np.linalg.norm(numbers, axis=1)
        # One that was normalised before is not normalised again.
        divisor = np.where((norm > 0) & (np.abs(norm - 1) > 1e-15), norm, 1.0)
        return _upper_half(numbers / divisor[:, None])
    if convention == "rotation_vector":
        angle = np.linalg.norm(numbers, axis=1)
        half = angle / 2
        factor = np.where(angle > 0, np.sin(half) / np.where(angle > 0, angle, 1.0), 0.5)
        return _upper_half(np.column_stack([np.cos(half), numbers * factor[:, None]]))
    if convention == "matrix":
        return _upper_half(quaternions_of(numbers.reshape(-1, 3, 3)))
    axes, fixed = _CONVENTIONS[convention]
    angles = numbers.T[::-1] if fixed else numbers.T
    first, second, third = (axis_turn(axis, angle, False) for axis, angle in zip(axes, angles, strict=True))
    return _upper_half(quaternions_of(first @ second @ third))


def _check_numbers(given: OrientationColumns, columns: dict[str, Column], line: Codes, faults: Faults) -> None:
    """A fault for each row whose numbers are no rotation in the convention of its columns."""
    names, numbers = given.names, given.numbers
    size = np.linalg.norm(numbers, axis=1)
    if given.convention == "quaternion":
        for row in np.flatnonzero(np.abs(size - 1) > 5e-3):  # written with three decimals, it is nearer
            hint = "a rotation has norm 1; are the columns in the order of their names?"
            faults.add(f"the quaternion has norm {size[row]:.4g}", names[0], size[row], hint, int(line[row]))
    elif given.convention == "matrix":
        R = numbers.reshape(-1, 3, 3)
        off = np.abs(R @ R.swapaxes(1, 2) - np.eye(3)).max(axis=(1, 2))
        for row in np.flatnonzero((off > 0.02) | (np.linalg.det(R) < 0)):
            hint = "r12 is row 1, column 2; its rows have norm 1 and are at right angles"
            faults.add("the matrix is no rotation", names[0], None, hint, int(line[row]))
    elif given.convention == "rotation_vector":
        for row in np.flatnonzero(size > TURN * 1.01):
            message = f"the rotation vector has a length of {size[row]:.4g} rad, more than a turn"
            faults.add(message, names[0], size[row], "is it in rad, and axis times angle?", int(line[row]))
    else:
        for row, k in zip(*np.nonzero(np.abs(numbers) > TURN * 1.01), strict=True):
            column, value = columns[names[k]], numbers[row, k]
            message = f"{value / column.factor:.6g} {column.unit} is more than a turn"
            faults.add(message, column.name, value, "is its unit right?", int(line[row]))


def _upper_half(rotation: Array) -> Array:
    """(N, 4) the same rotations with w >= 0."""
    return np.asarray(np.where(rotation[:, :1] < 0, -rotation, rotation))
