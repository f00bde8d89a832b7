"""Which reading of the columns, of a list of usual ones, explains the data where the one given does not."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, permutations, product

import numpy as np

from posture_opt.measurements.columns import AXES, Column
from posture_opt.measurements.frame_fit import FrameFit, Sample, frame_fit
from posture_opt.measurements.measurements import (
    BetterReading,
    Measurements,
    ReadingWords,
    carried_joint_values,
    nominal_poses,
    reach,
    sample_rows,
)
from posture_opt.measurements.orientation_columns import OrientationColumns
from posture_opt.measurements.rotations import inverted_poses, rotation_matrices
from posture_opt.model.arm import Arm
from posture_opt.numerics import Array
from posture_opt.robot.robot import Robot

_ZEROS_DEG = (90, -90, 180)  # Zeros of a joint that makers choose differently


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


# Lengths that the instrument or the board has a factor too long
SCALE = Reading("reading.scale", "", "", "x", lambda rows: rows, 1, scale=True)


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
    return any(q[:, j].max() > robot.upper[j] or q[:, j].min() < robot.lower[j] for j in some)


_MAX_ROWS = 60  # Postures by which readings are judged: a question about whole columns
_FITTED = 40  # Readings that are fitted, the best of the linear screening
_SCREENED_ROWS = 26  # FileRows from which on a linear map of 13 columns says something
_GIVEN_ROUNDS = 12  # Gauss-Newton steps for the columns as given, which must not lose by a poor start
_QUIET = 2.0  # Stated standard deviations of scatter up to which data fit and no other reading is looked for
# Of the tool point from where the file starts it: of readings that fit alike, the one that moves it less is named
_SHIFT_M = 0.02
_RATIO = 2.5  # How many times less the reading must leave
_MAX_LEFT = 0.01  # Of the motion: what a right reading leaves at most, as `Disagreement` of a calibrated arm has it
_MAX_TURNED = math.radians(2)
_ALIKE = 1.5  # Ratio of scatters up to which two readings fit alike: the simpler one is named
# Of the motion, and of orientations, up to which data can be used as they are read
_USABLE_LEFT, _USABLE_TURNED = 0.01, math.radians(3)
_MAX_ALIKE = 3  # Other readings that are named
_SPARE_NUMBERS = 12  # Coordinates beyond those of two frames that a judgement needs
_EVIDENCE = 20.0  # Logarithm of the likelihood ratio that a reading must gain, some hundred being tried
# Deviation of a scale from 1 that is a matter of reading: a wrong size of a board, a wrong unit; less is an error of
# the instrument, which a diagnosis finds
_LEAST_SCALE = 3e-3
_DEFAULT_SIGMA_M, _DEFAULT_TURN_RAD = 1e-4, 1e-3  # Noise of an instrument whose file states none
# What the columns as given leave, and the readings that leave far less with what they leave
Fitting = tuple[FrameFit, list[tuple[Reading, FrameFit]]]


def sample_of(data: Measurements, arm: Arm, measurement: object) -> Sample | None:
    """The rows that readings are judged by; None where they show no position, or are too few."""
    robot, touched = arm.robot, data.position is None
    if touched and not data.touches:
        return None
    rows = sample_rows(data)
    rows = rows[np.unique(np.linspace(0, len(rows) - 1, min(len(rows), _MAX_ROWS)).round().astype(np.intp))]
    sigma = float(getattr(measurement, "position", None) or 0.0)
    turn = float(getattr(measurement, "orientation", None) or 0.0)
    position = None if data.position is None else data.position[rows]
    rotation = data.rotation[rows] if data.rotation is not None and (turn or data.inverted) else None
    turn = turn or _DEFAULT_TURN_RAD
    beside = turn * np.median(np.linalg.norm(position, axis=1)) if data.inverted and position is not None else 0.0
    axes = np.arange(3) if touched else np.flatnonzero(data.measured_axes)
    block = len(axes) + (0 if rotation is None else 3)
    unknowns = 3 * len(np.unique(data.point[rows])) + 3 if touched else 12 if block > 3 else 9
    spare = len(rows) * block - unknowns
    if spare < _SPARE_NUMBERS:
        return None
    return Sample(
        rows, robot, data.q[rows], carried_joint_values(arm, data.q[rows]), position, rotation, axes, data.point[rows],
        touched or robot.base_free or len(data.robot_names) > 1, robot.tool_free or len(data.target_names) > 1,
        float(np.hypot(sigma or _DEFAULT_SIGMA_M, beside)), turn, spare,
    )  # fmt: skip


def fitting_readings(sample: Sample, arm: Arm, readings: Callable[[], Sequence[Reading]]) -> Fitting:
    """What explains the rows to their noise where the columns as given do not, the simplest first."""
    now = frame_fit(sample, rounds=_GIVEN_ROUNDS)
    if now.scatter < _QUIET and now.strain**2 < 2 * _EVIDENCE:
        return now, []
    tried = [(r, _read(sample, r, arm)) for r in readings()]
    fits = [(r, frame_fit(read, r.scale)) for r, read in _screened(tried)]
    good = [
        (r, fit)
        for r, fit in fits
        if (now.scatter > fit.scatter * max(_RATIO, math.exp(_EVIDENCE / sample.spare)) or _relieves(fit, now))
        and fit.left < _MAX_LEFT * sample.motion
        and fit.turned < _MAX_TURNED
        and (not r.scale or abs(fit.scale - 1) > _LEAST_SCALE)
    ]
    best = min((fit.scatter for _, fit in good), default=0.0)
    alike = [one for one in good if one[1].scatter < _ALIKE * best]
    return now, sorted(alike, key=lambda one: (one[0].changes, round(one[1].shift / _SHIFT_M)))


def _relieves(fit: FrameFit, given: FrameFit) -> bool:
    gained = (given.strain**2 - fit.strain**2) / 2
    return gained > _EVIDENCE and 2 * fit.strain < given.strain and fit.scatter < _ALIKE * given.scatter


def better_reading(sample: Sample, arm: Arm, readings: Callable[[], Sequence[Reading]]) -> BetterReading | None:
    """The reading to name; None where there is none, or where a calibration finds it: a coupling of two joints."""
    now, fits = fitting_readings(sample, arm, readings)
    if not fits or fits[0][0].coupling is not None:
        return None
    reading, found = fits[0]
    others = [_words(r, fit) for r, fit in fits[1:] if r.changes == reading.changes]
    of_base = reading.id == "reading.joint-zero" and reading.column == sample.robot.joint_names[0]
    usable = reading.scale or of_base or (now.left < _USABLE_LEFT * sample.motion and now.turned < _USABLE_TURNED)
    turned = None if sample.rotation is None else (now.turned, found.turned)
    return BetterReading(_words(reading, found), others[:_MAX_ALIKE], (now.left, found.left), turned, usable)


def _words(reading: Reading, fit: FrameFit) -> ReadingWords:
    message, hint = reading.message, reading.hint
    if reading.scale:
        message = f"its lengths are {fit.scale:.5g} times too long"
        hint = (
            f"is the board {1 / fit.scale:.4g} times the size that was entered? else divide x, y, z by {fit.scale:.5g}"
        )
    return ReadingWords(reading.id, message, hint, reading.column)


def _read(sample: Sample, reading: Reading, arm: Arm) -> Sample:
    rows = reading.of(FileRows(sample.commanded, sample.position, sample.rotation))
    return replace(sample, q=carried_joint_values(arm, rows.q), position=rows.position, rotation=rows.rotation)


def _screened(tried: list[tuple[Reading, Sample]]) -> list[tuple[Reading, Sample]]:
    if not tried:
        return []
    first = tried[0][1]
    m = len(first.q)
    poses = nominal_poses(first.robot, np.concatenate([read.q for _, read in tried]))
    p, R = poses[0].reshape(-1, m, 3), poses[1].reshape(-1, m, 9)
    misfits = [_linear_misfit(read, p[k], R[k]) for k, (_, read) in enumerate(tried)]
    order = np.argsort(misfits, kind="stable")[: _FITTED if m > _SCREENED_ROWS else None]
    chosen = {*map(int, order), *(k for k, (r, _) in enumerate(tried) if r.scale)}
    return [tried[k] for k in sorted(chosen)]


def _linear_misfit(read: Sample, p: Array, R: Array) -> float:
    """Sum of squares that a linear map from 1, p (m, 3) and R (m, 9) leaves of what was measured."""
    if read.position is None:
        codes = np.unique(read.point, return_inverse=True)[1]
        count = np.bincount(codes)[:, None]
        flat = np.concatenate([p, R], axis=1)
        means = np.stack([np.bincount(codes, column) for column in flat.T], axis=1) / count
        flat = flat - means[codes]
        X, Y = flat[:, 3:].reshape(-1, 3), flat[:, :3].reshape(-1, 1)
    else:
        X = np.concatenate([np.ones((len(p), 1)), p, R], axis=1)
        turned = [] if read.rotation is None else [rotation_matrices(read.rotation).reshape(-1, 9)]
        long = max(reach(read.robot), 1e-3)
        Y = np.concatenate([read.position[:, read.axes] / long, *turned], axis=1)
    Q = np.linalg.qr(X)[0]
    return float(np.sum((Y - Q @ (Q.T @ Y)) ** 2))
