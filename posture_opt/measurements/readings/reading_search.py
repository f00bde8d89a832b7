"""Which reading of the columns explains the data to their noise, where the one given does not."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from posture_opt.measurements.affine_fit import reach, sample_rows
from posture_opt.measurements.measurements import Measurements, carried_joint_values, nominal_poses
from posture_opt.measurements.readings.better_reading import BetterReading, ReadingWords
from posture_opt.measurements.readings.frame_fit import FrameFit, Sample, frame_fit
from posture_opt.measurements.readings.readings import FileRows, Reading
from posture_opt.measurements.rotations import rotation_matrices
from posture_opt.model.arm import Arm
from posture_opt.numerics import Array

_MAX_ROWS = 60
"""Postures by which readings are judged: a question about whole columns."""
_FITTED = 40
"""Readings that are fitted, the best of the linear screening."""
_SCREENED_ROWS = 26
"""FileRows from which on a linear map of 13 columns says something."""
_GIVEN_ROUNDS = 12
"""Gauss-Newton steps for the columns as given, which must not lose by a poor start."""
_QUIET = 2.0
"""Stated standard deviations of scatter up to which data fit and no other reading is looked for."""
_SHIFT_M = 0.02
"""Of the tool point from where the file starts it: of readings that fit alike, the one that moves it less is named."""
_RATIO = 2.5
"""How many times less the reading must leave."""
_MAX_LEFT = 0.01
"""Of the motion: what a right reading leaves at most, as `Disagreement` of a calibrated arm has it."""
_MAX_TURNED = math.radians(2)
_ALIKE = 1.5
"""Ratio of scatters up to which two readings fit alike: the simpler one is named."""
_USABLE_LEFT, _USABLE_TURNED = 0.01, math.radians(3)
"""Of the motion, and of orientations, up to which data can be used as they are read."""
_MAX_ALIKE = 3
"""Other readings that are named."""
_SPARE_NUMBERS = 12
"""Coordinates beyond those of two frames that a judgement needs."""
_EVIDENCE = 20.0
"""Logarithm of the likelihood ratio that a reading must gain, some hundred being tried."""
_LEAST_SCALE = 3e-3
"""Deviation of a scale from 1 that is a matter of reading: a wrong size of a board, a wrong unit; less is an error of
the instrument, which a diagnosis finds."""
_DEFAULT_SIGMA_M, _DEFAULT_TURN_RAD = 1e-4, 1e-3
"""Noise of an instrument whose file states none."""
Fitting = tuple[FrameFit, list[tuple[Reading, FrameFit]]]
"""What the columns as given leave, and the readings that leave far less with what they leave."""


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
    """What explains the rows to their noise where the columns as given do not, the simplest first.

    Args:
        sample: the rows as given.
        readings: the list, made when it is needed: data within the noise are not doubted.
    """
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
    """Whether an arm within tolerances explains with this reading what takes one beyond them as given."""
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
    """The reading in words, a scale with its size."""
    message, hint = reading.message, reading.hint
    if reading.scale:
        message = f"its lengths are {fit.scale:.5g} times too long"
        hint = (
            f"is the board {1 / fit.scale:.4g} times the size that was entered? else divide x, y, z by {fit.scale:.5g}"
        )
    return ReadingWords(reading.id, message, hint, reading.column)


def _read(sample: Sample, reading: Reading, arm: Arm) -> Sample:
    """The sample with its columns read otherwise."""
    rows = reading.of(FileRows(sample.commanded, sample.position, sample.rotation))
    return replace(sample, q=carried_joint_values(arm, rows.q), position=rows.position, rotation=rows.rotation)


def _screened(tried: list[tuple[Reading, Sample]]) -> list[tuple[Reading, Sample]]:
    """The readings whose nominal arm comes nearest, whatever its frames are: linear functions of the nominal pose.

    Every coordinate of a measured point and every entry of a measured rotation is linear in 1, p and R of the nominal
    arm; what a QR factorisation of these columns leaves of them decides, positions over the reach.
    """
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
