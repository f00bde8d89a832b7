"""The list of readings: ways in which people misread, or write otherwise, the columns of a file of measurements."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import combinations, permutations, product

from posture_opt.measurements.columns import AXES, Column
from posture_opt.measurements.orientation_columns import OrientationColumns
from posture_opt.measurements.rotations import inverted_poses
from posture_opt.numerics import Array
from posture_opt.robot.robot import Robot

_ZEROS_DEG = (90, -90, 180)
"""Zeros of a joint that makers choose differently."""


@dataclass(frozen=True, eq=False)
class FileRows:
    """What a reading changes, of m postures.

    Args:
        q: (m, n) joint values [rad or m].
        position: (m, 3) measured points [m]; rotation: (m, 4) quaternions, w first; None where not measured.
    """

    q: Array
    position: Array | None
    rotation: Array | None


@dataclass(frozen=True, eq=False)
class Reading:
    """One way to read the columns.

    Args:
        id: of the statement, as ``reading.joint-zero``.
        message: what is assumed, after ``if``; hint: the line to paste, or what to write.
        column: the key of the message.
        of: the rows as given -> the rows so read.
        changes: how many columns it changes; of two that fit alike, the simpler one is named.
        scale: whether lengths are multiplied by a factor, to be found.
        coupling: (joint, the one it follows, ratio) of an effect that a calibration finds by itself.
    """

    id: str
    message: str
    hint: str
    column: str
    of: Callable[[FileRows], FileRows]
    changes: int = 1
    scale: bool = False
    coupling: tuple[str, str, float] | None = None


def joint_readings(robot: Robot, columns: dict[str, Column], idle: set[int]) -> Iterator[Reading]:
    """Signs, exchanged columns, zeros alone and two at a time, couplings with and without a sign.

    Args:
        idle: joints whose zero a free frame takes up.
    """
    names, turns = robot.joint_names, [i for i, joint in enumerate(robot.joints) if joint.type == "revolute"]
    for i, name in enumerate(names):
        line = f"data: {{joint_signs: {{{name}: -1}}}}"
        yield _of_joints("sign", f"{name} counts in the opposite direction", line, name, {i: (i, -1.0, 0.0)})
    for i, j in combinations(range(robot.n), 2):
        if robot.joints[i].type == robot.joints[j].type:
            a, b = names[i], names[j]
            pair = f'{a}: "{b} [{columns[b].unit}]", {b}: "{a} [{columns[a].unit}]"'
            line = f"are the two swapped? data: {{columns: {{{pair}}}}}"
            swapped = {i: (j, 1.0, 0.0), j: (i, 1.0, 0.0)}
            yield _of_joints("order", f"the columns {a} and {b} are exchanged", line, a, swapped, 2)
    zeros = [(i, degrees) for i in turns if i not in idle for degrees in _ZEROS_DEG]
    for some in (*combinations(zeros, 1), *combinations(zeros, 2)):
        own = {names[i]: degrees for i, degrees in some}
        if len(own) == len(some):
            what = " and ".join(f"{name} counts from a zero at {degrees} deg" for name, degrees in own.items())
            line = f"data: {{joint_zeros: {{{', '.join(f'{name}: {d} deg' for name, d in own.items())}}}}}"
            moved = {i: (i, 1.0, -math.radians(degrees)) for i, degrees in some}
            yield _of_joints("zero", what, line, next(iter(own)), moved, 2 * len(some) - 1)


def coupling_readings(robot: Robot) -> Iterator[Reading]:
    """``q_b ← sign · q_b + ratio · q_a`` of all pairs of turning joints; with the sign +1 it is a coupling."""
    names, turns = robot.joint_names, [i for i, joint in enumerate(robot.joints) if joint.type == "revolute"]
    for (a, b), sign, ratio in product(permutations(turns, 2), (1.0, -1.0), (1.0, -1.0)):
        pair = f"joint: {names[b]}, follows: {names[a]}"
        effect = f"effects: [{{kind: joint_coupling, {pair}, estimate: {{ratio: {ratio:g}}}}}]"
        if sign > 0:
            message, line = f"{names[b]} moves with {names[a]}", effect
        else:
            message = f"{names[b]} counts in the opposite direction and from {names[a]}"
            line = f"data: {{joint_signs: {{{names[b]}: -1}}}} and {effect}"

        def of(rows: FileRows, a: int = a, b: int = b, sign: float = sign, ratio: float = ratio) -> FileRows:
            q = rows.q.copy()
            q[:, b] = sign * q[:, b] + ratio * q[:, a]
            return replace(rows, q=q)

        coupling = (names[b], names[a], ratio) if sign > 0 else None
        yield Reading("reading.joint-sign", message, line, names[b], of, 2, coupling=coupling)


def unit_readings(robot: Robot, columns: dict[str, Column], q: Array) -> Iterator[Reading]:
    """Joint values in another unit than the header says."""
    names = robot.joint_names
    for stated, meant, factor, kind in (
        ("deg", "rad", 180 / math.pi, "revolute"),
        ("rad", "deg", math.pi / 180, "revolute"),
        ("mm", "m", 1e3, "prismatic"),
        ("m", "mm", 1e-3, "prismatic"),
    ):
        those = [j for j, joint in enumerate(robot.joints) if joint.type == kind and columns[names[j]].unit == stated]
        for some in dict.fromkeys([tuple(those), *((j,) for j in those)]):
            if some and (factor > 1 or _beyond_limits(q, robot, some)):
                what = f"the numbers of {', '.join(names[j] for j in some)} are {meant}"
                line = "write " + ", ".join(f"{names[j]} [{meant}]" for j in some)
                yield _of_joints("unit", what, line, names[some[0]], {j: (j, factor, 0.0) for j in some}, len(some))


def axis_readings(named: list[str], base_free: bool) -> Iterator[Reading]:
    """Measured coordinates that are exchanged or reversed, so that their frame is left-handed.

    Args:
        named: the measured coordinates; in a ``base_free`` frame, one mirror image is as good as another.
    """
    every = [AXES.index(axis) for axis in named]
    maps = [(f"{AXES[i]} and {AXES[j]} look swapped", {i: (j, 1.0), j: (i, 1.0)}) for i, j in combinations(every, 2)]
    maps += [(f"{AXES[i]} looks as if it had the opposite sign", {i: (i, -1.0)}) for i in every]
    if base_free:
        maps = [("two of the columns are swapped, or one has the opposite sign", {every[0]: (every[0], -1.0)})]
    for guess, changed in maps:

        def of(rows: FileRows, changed: dict[int, tuple[int, float]] = changed) -> FileRows:
            assert rows.position is not None, "coordinates are measured"
            position = rows.position.copy()
            for i, (j, sign) in changed.items():
                position[:, i] = sign * rows.position[:, j]
            return replace(rows, position=position)

        message, hint = f"the measured frame is left-handed ({guess})", f"correct the columns {', '.join(named)}"
        yield Reading("reading.axes", message, hint, named[0], of)


def orientation_readings(given: OrientationColumns, inverted: bool) -> Iterator[Reading]:
    """The orientation columns in every other convention.

    Args:
        given: the columns as they were read.
        inverted: whether poses were inverted after reading.
    """

    def turned(quaternions: Array) -> Callable[[FileRows], FileRows]:
        def of(rows: FileRows) -> FileRows:
            if not inverted or rows.position is None or rows.rotation is None:
                return replace(rows, rotation=quaternions)
            as_read = inverted_poses(rows.position, rows.rotation)[0]
            position, rotation = inverted_poses(as_read, quaternions)
            return replace(rows, position=position, rotation=rotation)

        return of

    first = given.names[0]
    for said, line, quaternions in given.otherwise():
        yield Reading("reading.orientation", said, line, first, turned(quaternions))


def direction_reading(camera: bool, inverted: bool) -> Reading:
    """Every pose inverted: the camera in the board for the board in the camera, the base in the tool."""

    def of(rows: FileRows) -> FileRows:
        assert rows.position is not None, "poses are inverted"
        assert rows.rotation is not None, "poses are inverted"
        position, rotation = inverted_poses(rows.position, rows.rotation)
        return replace(rows, position=position, rotation=rotation)

    value = "as_named" if inverted else "inverted"
    line = f"data: {{{'frame: camera, ' if camera else ''}direction: {value}}}"
    return Reading("reading.direction", "each pose is inverted", line, "x", of)


SCALE = Reading("reading.scale", "", "", "x", lambda rows: rows, 1, scale=True)
"""Lengths that the instrument or the board has a factor too long."""


def _of_joints(
    what: str, message: str, hint: str, column: str, changed: dict[int, tuple[int, float, float]], changes: int = 1
) -> Reading:
    """Joint i as ``factor · q_j + offset``, of ``changed`` i -> (j, factor, offset)."""

    def of(rows: FileRows) -> FileRows:
        q = rows.q.copy()
        for i, (j, factor, offset) in changed.items():
            q[:, i] = factor * rows.q[:, j] + offset
        return replace(rows, q=q)

    return Reading(f"reading.joint-{what}" if what != "unit" else "reading.unit", message, hint, column, of, changes)


def _beyond_limits(q: Array, robot: Robot, some: tuple[int, ...]) -> bool:
    """Whether any of these joints leaves its limits: numbers that are too large for their unit do."""
    return any(q[:, j].max() > robot.upper[j] or q[:, j].min() < robot.lower[j] for j in some)
