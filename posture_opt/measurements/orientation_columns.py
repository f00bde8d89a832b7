"""Measured orientations, by the columns and the convention in which a file writes them."""

from __future__ import annotations

from collections.abc import Callable, Container, Iterator
from dataclasses import dataclass

import numpy as np

from posture_opt.measurements.columns import Cells, Column
from posture_opt.measurements.data_section import DataSpec
from posture_opt.measurements.faults import Faults
from posture_opt.measurements.kinds.pose_columns import ORIENTATION_GROUPS, QUATERNION
from posture_opt.measurements.rotations import axis_turn, quaternions_of
from posture_opt.numerics import TURN, Array, Codes
from posture_opt.robot.robot import Robot

NO_ORIENTATION_NOTE = "orientations are left out: measurement.orientation states no σ for them"
_NORM_TOLERANCE = 5e-3
"""How far the norm of a quaternion written with three decimals may be off one."""
_UNIT_TOLERANCE = 1e-15
"""How far the norm of a quaternion that was normalised before is off one; it is not normalised again."""
_MATRIX_TOLERANCE = 0.02
"""How far the entries of a rotation matrix times its transpose may be off the identity."""
DEGREES = ("deg", "°", "º", "Grad", "Grd")
"""How files write degrees."""


def _about(axes: tuple[int, int, int]) -> Callable[[Array], Array]:
    """Angles (N, 3) [rad] -> (N, 3, 3) the product of turns about these axes, the first one outermost."""
    return lambda v: np.asarray(
        axis_turn(axes[0], v[:, 0], False) @ axis_turn(axes[1], v[:, 1], False) @ axis_turn(axes[2], v[:, 2], False)
    )


def _fixed_xyz(v: Array) -> Array:
    """``Rz(v₂) Ry(v₁) Rx(v₀)``, the convention of URDF."""
    return _about((2, 1, 0))(v[:, ::-1])


CONVENTIONS: dict[str, Callable[[Array], Array]] = {
    "rpy": _fixed_xyz,
    "intrinsic_xyz": _about((0, 1, 2)),
    "abc": _about((2, 1, 0)),
    "wpr": _fixed_xyz,
    "zyz": _about((2, 1, 2)),
}
"""``data: {orientation: …}`` of three angles -> (N, 3, 3) rotations of these; rotation vectors and matrices beside."""
_GROUP_WORDS = {"quaternion": "the quaternion", "vector": "the rotation vector", "matrix": "the matrix"}
_OF_GROUP = {"angles": "rpy", "abc": "abc", "wpr": "wpr", "vector": "rotation_vector"}
"""Group of columns -> the convention that its names stand for."""
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
    """The columns of an orientation as they were read.

    Args:
        names: (k,) of the columns; numbers: (N, k) their values [rad].
        units: (k,) as written.
        convention: how they are read; that of their names where none is stated.
    """

    names: tuple[str, ...]
    numbers: Array
    units: tuple[str, ...]
    convention: str

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
        elif self.convention == "quaternion":
            for order in ((3, 0, 1, 2), (1, 2, 3, 0)):
                at = ", ".join(f'{name}: "{QUATERNION[k]}"' for name, k in zip(QUATERNION, order, strict=True))
                said = f"the quaternion is written in the order {', '.join(QUATERNION[i] for i in np.argsort(order))}"
                yield said, f"data: {{columns: {{{at}}}}}", _in_convention(self.numbers[:, order], "quaternion")
            yield (
                "the quaternions are those of the inverse rotations", "reverse the signs of qx, qy, qz",
                self.quaternions() * [1, -1, -1, -1],
            )  # fmt: skip
        else:
            mapping = [(i, j) for i in range(3) for j in range(3) if i != j]
            line = ", ".join(f'r{i + 1}{j + 1}: "r{j + 1}{i + 1}"' for i, j in mapping)
            yield (
                "the rotation matrices are transposed", f"data: {{columns: {{{line}}}}}",
                self.quaternions() * [1, -1, -1, -1],
            )  # fmt: skip

    def _of_three(self) -> Iterator[tuple[str, str, Array]]:
        """Three angles or a vector in the other conventions, then in the other unit."""
        now, listed = self.quaternions(), ", ".join(self.names)
        for name, words in _WORDS.items():
            found = _in_convention(self.numbers, name)
            if name != self.convention and not np.allclose(found, now):
                yield f"{listed} are {words}", f"data: {{orientation: {name}}}", found
        if {*self.units} <= {*DEGREES}:
            meant, factor = "rad", 180 / np.pi
        else:
            meant, factor = "deg", np.pi / 180
        line = "write " + ", ".join(f"{name} [{meant}]" for name in self.names)
        yield f"{listed} are in {meant}", line, _in_convention(self.numbers * factor, self.convention)
        if self.convention == "rotation_vector":
            line = f"reverse the signs of {listed}"
            yield "the rotation vectors are those of the inverse rotations", line, now * [1, -1, -1, -1]


def groups_of(robot: Robot, prefix: str = "") -> dict[str, tuple[str, ...]]:
    """The groups of columns that may hold an orientation: a joint of such a name takes its group away."""
    names = {key: tuple(prefix + name for name in group) for key, group in ORIENTATION_GROUPS.items()}
    return {key: group for key, group in names.items() if key == "quaternion" or not {*group} & {*robot.joint_names}}


def angle_columns(robot: Robot) -> tuple[str, ...]:
    """The columns of angles that may hold an orientation."""
    return tuple(name for key, group in groups_of(robot).items() if key in _OF_GROUP for name in group)


def number_columns(robot: Robot) -> tuple[str, ...]:
    """The columns without a unit that may hold an orientation: of a quaternion, and of a matrix."""
    return tuple(name for key, group in groups_of(robot).items() if key not in _OF_GROUP for name in group)


def is_oriented(there: Container[str], robot: Robot) -> bool:
    """Whether some columns of an orientation are there."""
    return any(group[0] in there for group in groups_of(robot).values())


def incomplete_orientation(there: Container[str], robot: Robot, line: int, faults: Faults) -> None:
    """Faults where only some of the columns of an orientation are there, or those of two."""
    groups = {key: group for key, group in groups_of(robot).items() if any(name in there for name in group)}
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
    numbers = _stacked_columns(cells, names)
    if key in ("quaternion", "matrix"):
        check = _check_norms if key == "quaternion" else _check_matrices
        check(numbers, names, cells.line, faults)
        return OrientationColumns(names, numbers, ("",) * len(names), key)
    stated = spec.orientation if spec.orientation != "matrix" else None
    convention = stated or _OF_GROUP[key]
    given = OrientationColumns(names, numbers, tuple(columns[name].unit for name in names), convention)
    if convention == "rotation_vector":
        _check_vectors(given, stated is not None, cells.line, faults)
    else:
        for values, name in zip(numbers.T, names, strict=True):
            _check_turns(values, columns[name], cells.line, faults)
    return given


def unit_quaternions(cells: Cells, line: Codes, faults: Faults) -> Array:
    """(N, 4) unit quaternions with w >= 0 of the columns ``qw, qx, qy, qz``; a norm that is far from one is a fault."""
    rotation = _stacked_columns(cells, QUATERNION)
    _check_norms(rotation, QUATERNION, line, faults)
    return _in_convention(rotation, "quaternion")


def _in_convention(numbers: Array, convention: str) -> Array:
    """(N, 4) quaternions of columns (N, k) in a convention."""
    if convention == "quaternion":
        norm = np.linalg.norm(numbers, axis=1)
        divisor = np.where((norm > 0) & (np.abs(norm - 1) > _UNIT_TOLERANCE), norm, 1.0)
        return _upper_half(numbers / divisor[:, None])
    if convention == "rotation_vector":
        angle = np.linalg.norm(numbers, axis=1)
        half = angle / 2
        factor = np.where(angle > 0, np.sin(half) / np.where(angle > 0, angle, 1.0), 0.5)
        return _upper_half(np.column_stack([np.cos(half), numbers * factor[:, None]]))
    if convention == "matrix":
        return _upper_half(quaternions_of(numbers.reshape(-1, 3, 3)))
    return _upper_half(quaternions_of(CONVENTIONS[convention](numbers)))


def _check_norms(rotation: Array, names: tuple[str, ...], line: Codes, faults: Faults) -> None:
    """A fault for each quaternion (N, 4) whose norm is far from one."""
    norm = np.linalg.norm(rotation, axis=1)
    for row in np.flatnonzero(np.abs(norm - 1) > _NORM_TOLERANCE):
        hint = "a rotation has norm 1; are the columns in the order of their names?"
        faults.add(f"the quaternion has norm {norm[row]:.4g}", names[0], norm[row], hint, int(line[row]))


def _check_matrices(numbers: Array, names: tuple[str, ...], line: Codes, faults: Faults) -> None:
    """A fault for each matrix (N, 9) that is no rotation."""
    R = numbers.reshape(-1, 3, 3)
    off = np.abs(R @ R.swapaxes(1, 2) - np.eye(3)).max(axis=(1, 2))
    for row in np.flatnonzero((off > _MATRIX_TOLERANCE) | (np.linalg.det(R) < 0)):
        hint = "r12 is row 1, column 2; its rows have norm 1 and are at right angles"
        faults.add("the matrix is no rotation", names[0], None, hint, int(line[row]))


def _check_vectors(given: OrientationColumns, stated: bool, line: Codes, faults: Faults) -> None:
    """Faults of rotation vectors: degrees that are not stated, and lengths of more than a turn."""
    names = given.names
    in_degrees = [name for name, unit in zip(names, given.units, strict=True) if unit in DEGREES]
    if in_degrees and not stated:
        hint = "are they angles? data: {orientation: rpy}, or abc, wpr …; else data: {orientation: rotation_vector}"
        faults.add(f"{', '.join(in_degrees)} in degrees: a rotation vector is in rad", in_degrees[0], hint=hint)
        return
    angle = np.linalg.norm(given.numbers, axis=1)
    for row in np.flatnonzero(angle > TURN * 1.01):
        message = f"the rotation vector has a length of {angle[row]:.4g} rad, more than a turn"
        faults.add(message, names[0], angle[row], "is it in rad, and axis times angle?", int(line[row]))


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
