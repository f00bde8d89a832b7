"""Which reading of the columns, of a list of usual ones, explains the data where the one given does not."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, permutations, product

import numpy as np

from posture_opt.measurements.columns import AXES, Column
from posture_opt.measurements.frame_fit import FrameFit, Sample, frame_fit, start_misfit
from posture_opt.measurements.measurements import (
    BetterReading,
    Measurements,
    ReadingWords,
    carried_joint_values,
    group_means,
    nominal_poses,
    reach,
    sample_rows,
)
from posture_opt.measurements.orientation_columns import OrientationColumns
from posture_opt.measurements.rotations import inverted_poses, rotation_matrices
from posture_opt.model.arm import Arm
from posture_opt.numerics import Array
from posture_opt.robot.robot import Robot


@dataclass(frozen=True, eq=False)
class FileRows:
    """What a reading changes, of m postures."""

    q: Array  # (m, n) joint values [rad or m]
    position: Array | None  # (m, 3) measured points [m]
    rotation: Array | None  # (m, 4) quaternions, w first; None where not measured


@dataclass(frozen=True, eq=False)
class Reading:
    """One way to read the columns."""

    id: str  # of the statement, as ``reading.joint-zero``
    message: str  # what is assumed, after ``if``
    hint: str  # the line to paste, or what to write
    column: str  # the key of the message
    of: Callable[[FileRows], FileRows]  # the rows as given -> the rows so read
    changes: int = 1  # how many columns it changes; of two that fit alike, the simpler one is named
    scale: bool = False  # whether lengths are multiplied by a factor, to be found
    # (joint, the one it follows, ratio) of an effect that a calibration finds by itself
    coupling: tuple[str, str, float] | None = None


def joint_readings(robot: Robot, columns: dict[str, Column], idle: set[int]) -> Iterator[Reading]:
    """Signs, exchanged columns, zeros alone and two at a time, couplings with and without a sign."""
    names = robot.joint_names
    written = [i for i, name in enumerate(names) if name in columns]  # the turns of a flange have no columns
    turns = [i for i in written if robot.joints[i].type == "revolute"]
    for i in written:
        line, what = f"data: {{joint_signs: {{{names[i]}: -1}}}}", f"{names[i]} counts in the opposite direction"
        yield _of_joints("sign", what, line, names[i], {i: (i, -1.0, 0.0)})
    for i, j in combinations(written, 2):
        if robot.joints[i].type == robot.joints[j].type:
            a, b = names[i], names[j]
            pair = f'{a}: "{b} [{columns[b].unit}]", {b}: "{a} [{columns[a].unit}]"'
            line = f"are the two swapped? data: {{columns: {{{pair}}}}}"
            swapped = {i: (j, 1.0, 0.0), j: (i, 1.0, 0.0)}
            yield _of_joints("order", f"the columns {a} and {b} are exchanged", line, a, swapped, 2)
    zeros = [(i, degrees) for i in turns if i not in idle for degrees in (90, -90, 180)]  # as makers choose them
    for some in (*combinations(zeros, 1), *combinations(zeros, 2)):
        own = {names[i]: degrees for i, degrees in some}
        if len(own) == len(some):
            what = " and ".join(f"{name} counts from a zero at {degrees} deg" for name, degrees in own.items())
            line = f"data: {{joint_zeros: {{{', '.join(f'{name}: {d} deg' for name, d in own.items())}}}}}"
            moved = {i: (i, 1.0, -math.radians(degrees)) for i, degrees in some}
            yield _of_joints("zero", what, line, next(iter(own)), moved, 2 * len(some) - 1)


def coupling_readings(robot: Robot) -> Iterator[Reading]:
    """``q_b ← sign · q_b + ratio · q_a`` of all pairs of turning joints; with the sign +1 it is a coupling."""
    joints = () if robot.pose_prefix else robot.joints  # a flange has none
    names, turns = robot.joint_names, [i for i, joint in enumerate(joints) if joint.type == "revolute"]
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
        own = [(j, columns[name]) for j, name in enumerate(names) if name in columns and robot.joints[j].type == kind]
        those = [j for j, column in own if column.unit == stated]
        for some in dict.fromkeys([tuple(those), *((j,) for j in those)]):
            beyond = any(q[:, j].max() > robot.upper[j] or q[:, j].min() < robot.lower[j] for j in some)
            if some and (factor > 1 or beyond):  # numbers too large for their unit leave the limits
                what = f"the numbers of {', '.join(names[j] for j in some)} are {meant}"
                line = "write " + ", ".join(f"{names[j]} [{meant}]" for j in some)
                yield _of_joints("unit", what, line, names[some[0]], {j: (j, factor, 0.0) for j in some}, len(some))


def axis_readings(named: list[str], base_free: bool) -> Iterator[Reading]:
    """Measured coordinates that are exchanged or reversed, so that their frame is left-handed."""
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
    """The orientation columns in every other convention."""

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


def scale_reading(camera: bool) -> Reading:
    """Lengths that the board or the instrument has a factor too long."""
    board = "was the board printed at {size} of the size that was entered? Else divide x, y, z by {factor}"
    hint = board if camera else "check the unit and the scale of the instrument, or divide x, y, z by {factor}"
    message = "all measured lengths are {factor} times those of the arm"
    return Reading("reading.scale", message, hint, "x", lambda rows: rows, 1, scale=True)


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


_MAX_LEFT = 0.01  # Of the motion: what a right reading leaves at most, as `Disagreement` of a calibrated arm has it
_ALIKE = 1.5  # Ratio of scatters up to which two readings fit alike: the simpler one is named
_EVIDENCE = 20.0  # Logarithm of the likelihood ratio that a reading must gain, some hundred being tried
# What the columns as given leave, and the readings that leave far less with what they leave
Fitting = tuple[FrameFit, list[tuple[Reading, FrameFit]]]


def sample_of(data: Measurements, arm: Arm, measurement: object) -> Sample | None:
    """The rows that readings are judged by; None where they show no position, or are too few."""
    robot, touched = arm.robot, data.position is None
    if touched and not data.touches:
        return None
    rows = sample_rows(data)
    rows = rows[np.unique(np.linspace(0, len(rows) - 1, min(len(rows), 60)).round().astype(np.intp))]
    sigma = float(getattr(measurement, "position", None) or 0.0)
    turn = float(getattr(measurement, "orientation", None) or 0.0)
    position = None if data.position is None else data.position[rows]
    rotation = data.rotation[rows] if data.rotation is not None and (turn or data.inverted) else None
    turn = turn or 1e-3
    beside = turn * np.median(np.linalg.norm(position, axis=1)) if data.inverted and position is not None else 0.0
    axes = np.arange(3) if touched else np.flatnonzero(data.measured_axes)
    block = len(axes) + (0 if rotation is None else 3)
    unknowns = 3 * len(np.unique(data.point[rows])) + 3 if touched else 12 if block > 3 else 9
    spare = len(rows) * block - unknowns
    if spare < 12:
        return None
    return Sample(
        rows, robot, data.q[rows], carried_joint_values(arm, data.q[rows]), position, rotation, axes, data.point[rows],
        touched or robot.base_free or len(data.robot_names) > 1, robot.tool_free or len(data.target_names) > 1,
        float(np.hypot(sigma or 1e-4, beside)), turn, spare,
    )  # fmt: skip


def fitting_readings(sample: Sample, arm: Arm, readings: Callable[[], Sequence[Reading]]) -> Fitting:
    """What explains the rows to their noise where the columns as given do not, the simplest first."""
    now = frame_fit(sample, rounds=12)  # the columns as given must not lose by a poor start
    if now.scatter < 2 and now.strain**2 < 2 * _EVIDENCE:
        return now, []
    given, tried = FileRows(sample.commanded, sample.position, sample.rotation), []
    for reading in readings():
        rows = reading.of(given)
        q = carried_joint_values(arm, rows.q)
        tried.append((reading, replace(sample, q=q, position=rows.position, rotation=rows.rotation)))
    fits = [(r, frame_fit(read, r.scale)) for r, read in _screened(tried)]
    closer, gain = max(2.5, math.exp(_EVIDENCE / sample.spare)), 2 * _EVIDENCE
    good = [
        (r, fit)
        for r, fit in fits
        if (
            now.scatter > fit.scatter * closer
            # or the parts deviate far less from nominal, with about the same scatter
            or (
                (now.strain**2 - fit.strain**2 > gain and 2 * fit.strain < now.strain)
                and fit.scatter < _ALIKE * now.scatter
            )
        )
        and fit.left < _MAX_LEFT * sample.motion
        and fit.turned < math.radians(2)
        # A smaller scale is an error of the instrument, which a diagnosis finds.
        and (not r.scale or abs(fit.scale - 1) > 3e-3)
    ]
    best = min((fit.scatter for _, fit in good), default=0.0)
    alike = [one for one in good if one[1].scatter < _ALIKE * best]
    # Of readings that fit alike, the simplest is named, then the one that moves the tool point less, in steps of 20 mm.
    return now, sorted(alike, key=lambda one: (one[0].changes, round(one[1].shift / 0.02)))


def better_reading(sample: Sample, arm: Arm, readings: Callable[[], Sequence[Reading]]) -> BetterReading | None:
    """The reading to name; None where there is none, or where a calibration finds it: a coupling of two joints."""
    now, fits = fitting_readings(sample, arm, readings)
    if not fits or fits[0][0].coupling is not None:
        return None
    reading, found = fits[0]
    others = [_words(r, fit) for r, fit in fits[1:] if r.changes == reading.changes]
    of_base = reading.id == "reading.joint-zero" and reading.column == sample.robot.joint_names[0]
    usable = reading.scale or of_base  # what a free base takes up, and what a diagnosis weighs
    turned = None if sample.rotation is None else (now.turned, found.turned)
    return BetterReading(_words(reading, found), others[:3], (now.left, found.left), turned, usable)


def _words(reading: Reading, fit: FrameFit) -> ReadingWords:
    numbers = {"size": f"{1 / fit.scale:.4g}", "factor": f"{fit.scale:.5g}"} if reading.scale else {}
    message, hint = (text.format(**numbers) if numbers else text for text in (reading.message, reading.hint))
    return ReadingWords(reading.id, message, hint, reading.column)


def _screened(tried: list[tuple[Reading, Sample]]) -> list[tuple[Reading, Sample]]:
    if not tried:
        return []
    m, robot = len(tried[0][1].q), tried[0][1].robot
    poses = nominal_poses(robot, np.concatenate([read.q for _, read in tried]))
    p, R = poses[0].reshape(-1, m, 3), poses[1].reshape(-1, m, 3, 3)
    # A linear map of 13 columns says something from twice as many rows on.
    few, touched = m <= 26, tried[0][1].position is None
    misfit = start_misfit if few and not touched else _linear_misfit
    misfits = [misfit(read, p[k], R[k]) for k, (_, read) in enumerate(tried)]
    order = np.argsort(misfits, kind="stable")[: None if few and touched else 40]
    chosen = {*map(int, order), *(k for k, (r, _) in enumerate(tried) if r.scale)}
    return [tried[k] for k in sorted(chosen)]


def _linear_misfit(read: Sample, p: Array, R: Array) -> float:
    """Sum of squares that a linear map from 1, p (m, 3) and R (m, 3, 3) leaves of what was measured."""
    R = R.reshape(-1, 9)
    if read.position is None:
        codes = np.unique(read.point, return_inverse=True)[1]
        flat = np.concatenate([p, R], axis=1)
        flat = flat - group_means(flat, codes)[codes]
        X, Y = flat[:, 3:].reshape(-1, 3), flat[:, :3].reshape(-1, 1)
    else:
        X = np.concatenate([np.ones((len(p), 1)), p, R], axis=1)
        turned = [] if read.rotation is None else [rotation_matrices(read.rotation).reshape(-1, 9)]
        long = max(reach(read.robot), 1e-3)
        Y = np.concatenate([read.position[:, read.axes] / long, *turned], axis=1)
    Q = np.linalg.qr(X)[0]
    return float(np.sum((Y - Q @ (Q.T @ Y)) ** 2))
