"""Measurements that look wrong as a whole: another unit, a turned frame, another robot. Nothing guessed is applied."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from posture_opt.measurements.columns import AXES, Column
from posture_opt.measurements.data_section import DataSpec
from posture_opt.measurements.measurements import (
    BetterReading,
    Measurements,
    carried_joint_values,
    group_means,
    nominal_poses,
    reach,
    sample_rows,
)
from posture_opt.measurements.orientation_columns import OrientationColumns
from posture_opt.measurements.readings import (
    Reading,
    axis_readings,
    better_reading,
    coupling_readings,
    direction_reading,
    joint_readings,
    orientation_readings,
    sample_of,
    scale_reading,
    unit_readings,
)
from posture_opt.measurements.table import Faults
from posture_opt.model.arm import Arm
from posture_opt.numerics import Array, Codes
from posture_opt.robot.robot import Robot

_RANK_TOLERANCE = 1e-8  # Share of the largest singular value below which a direction is rounding
# Units of length -> [m], in which coordinates may have been written
_LENGTH_UNITS = {"m": 1.0, "mm": 1e-3, "um": 1e-6, "cm": 1e-2, "in": 0.0254}


@dataclass(frozen=True)
class AffineFit:
    """The free linear map from the nominal tool points to the measured ones."""

    # RMS of what the map leaves over that of the measured points, with its degrees of freedom; NaN where there are
    # too few
    misfit: float
    # (k, d) from the d world axes along which the nominal tool moves to the k measured axes; ``None`` where the
    # postures do not determine it, or more than a fifth is left: its scale and sign mean nothing then
    map: Array | None
    axes: Codes  # (d,) indices of those world axes


def affine_fit(robot: Robot, q: Array, measured: Array) -> AffineFit:
    """The agreement of postures with measured coordinates."""
    # q: (m, n) joint values [rad or m]; measured: (m, k) coordinates of the measured axes [m]
    points, rotations = (values - values.mean(axis=0) for values in nominal_poses(robot, q))
    target, turned = measured - measured.mean(axis=0), rotations.reshape(len(q), 9)
    axes = np.flatnonzero(np.sqrt(np.mean(points**2, axis=0)) > 1e-9)
    left, singular, _ = np.linalg.svd(turned, full_matrices=False)
    basis = left[:, singular > _RANK_TOLERANCE * max(singular[0], np.sqrt(len(q)))]
    free = len(q) - 1 - basis.shape[1] - len(axes)
    spread = np.sqrt(np.sum(target**2) / len(q))
    if not len(axes) or spread == 0:
        return AffineFit(np.nan, None, axes)
    if free >= (len(q) - 1) / 2:
        # B is free: what turns of the tool do to an unknown offset is projected off both sides.
        moved, rest = (x - basis @ (basis.T @ x) for x in (points[:, axes], target))
        fitted, *_ = np.linalg.lstsq(moved, rest, rcond=_RANK_TOLERANCE)
        misfit, found = np.sqrt(np.sum((rest - moved @ fitted) ** 2) / free) / spread, fitted.T
        # Of the tool's motion, 2 % must be free of the wrist's, so that B can be separated from the tool.
        size = np.linalg.svd(moved, compute_uv=False)[-1] / np.sqrt(len(q))
        known = size > 0.02 * np.sqrt(np.mean(np.sum(points**2, axis=1)))
    elif len(q) < 6 or target.shape[1] < 3:  # 18 coordinates for the 10 unknowns of a scaled rotation
        return AffineFit(np.nan, None, axes)
    else:
        tried = [_scaled_rotation(points, rotations, target, sign) for sign in (1.0, -1.0)]
        (misfit, found), known = tried[1] if tried[1][0] < tried[0][0] / 5 else tried[0], True
        found = found[:, axes]
    return AffineFit(float(misfit), np.asarray(found, dtype=float) if known and misfit < 0.2 else None, axes)


def _scaled_rotation(points: Array, rotations: Array, measured: Array, sign: float) -> tuple[float, Array]:
    """Misfit and map (3, 3) of the scaled rotation, in turns with the tool offset (Umeyama 1991, eqs. 40-43)."""
    tool = np.zeros(3)
    for _ in range(20):  # five suffice for measured arms
        reached = points + rotations @ tool
        left, singular, right = np.linalg.svd(measured.T @ reached)
        signs = np.array([1.0, 1.0, sign * np.sign(np.linalg.det(left @ right))])
        turn, scale = (left * signs) @ right, (singular @ signs) / max(np.sum(reached**2), 1e-300)
        wanted = measured @ turn / scale - points if scale > 0 else np.zeros_like(points)
        tool, *_ = np.linalg.lstsq(rotations.reshape(-1, 3), wanted.ravel(), rcond=_RANK_TOLERANCE)
    rest = measured - scale * (points + rotations @ tool) @ turn.T
    free = (measured.size - 10) / measured.size
    return float(np.sqrt(np.sum(rest**2) / np.sum(measured**2) / free)), np.asarray(scale * turn)


def touch_misfit(robot: Robot, q: Array, point: Codes) -> float:
    """RMS distance of the touches of one point from their mean, with the best tool offset."""
    # q: (m, n) joint values [rad or m]; point: (m,) code of the touched point of each row
    points, rotations = nominal_poses(robot, q)
    flat = np.column_stack([points, rotations.reshape(len(q), 9)])
    codes = np.unique(point, return_inverse=True)[1]
    flat = flat - group_means(flat, codes)[codes]
    offsets = flat[:, 3:].reshape(-1, 3)
    free = 3 * (len(q) - len(np.unique(point))) - 3
    if free < 3 * len(q) / 2:
        return float("nan")
    tool, *_ = np.linalg.lstsq(offsets, -flat[:, :3].ravel(), rcond=_RANK_TOLERANCE)
    rest = flat[:, :3].ravel() + offsets @ tool
    size = reach(robot) * np.sqrt(np.sum(offsets**2) / (2 * len(q)))  # postures that hardly differ agree with anything
    return float(np.sqrt(3 * np.sum(rest**2) / free) / size) if size > 0 else float("nan")


class HasData(Protocol):
    """Anything that names a robot, and what is known about data and instruments, such as a ``Problem``."""

    @property
    def arm(self) -> Arm: ...
    @property
    def robot(self) -> Robot: ...
    @property
    def data(self) -> DataSpec: ...
    @property
    def measurement(self) -> object: ...


def plausibility_checks(
    data: Measurements, problem: HasData, columns: dict[str, Column], turned: OrientationColumns | None, faults: Faults
) -> tuple[list[str], BetterReading | None]:
    """Warnings on data that can be used, and a reading that explains them better; faults where they cannot be."""
    robot, rows = problem.robot, sample_rows(data)
    if data.position is None and not data.touches:
        return [], None
    if data.position is not None:
        position, size = data.position[:, data.measured_axes], max(reach(robot), 1.0)
        off = np.linalg.norm(position - np.median(position, axis=0), axis=1)
        far = np.flatnonzero(off > 1e4 * size)  # a wrong unit makes a thousand of one
        for row in map(int, far):
            message = f"the point lies {off[row]:.3g} m from the middle of all, and the arm is {size:.3g} m long"
            faults.add(message, hint="leave out the row", line=int(data.line[row]))
        if len(far):
            return [], None
    better = _better_reading(data, problem, columns, turned)
    if better is not None and not better.usable:
        for k, one in enumerate((better.reading, *better.alike)):
            message = f"the data fit as well if {one.message}" if k else better.sentence
            faults.add(message, one.column, hint=one.hint, id=one.id)
        return [], better
    q = carried_joint_values(problem.arm, data.q[rows])
    if data.position is None:
        misfit = touch_misfit(robot, q, data.point[rows])
        return _unlike_note(misfit, None, "how far the touches of one point lie apart"), better
    measured = data.position[rows][:, data.measured_axes]
    found = affine_fit(robot, q, measured)
    named = [axis for axis in AXES if axis in columns]
    if _wrong_lengths(found, measured, q, robot, [columns[axis] for axis in named], faults):
        return [], better
    scale = None if better is not None else _motion_scale(found)
    unlike = _unlike_note(found.misfit, scale, "of the measured motion")
    return [*unlike, *_turned_note(found, robot, named)], better


def _better_reading(
    data: Measurements, problem: HasData, columns: dict[str, Column], turned: OrientationColumns | None
) -> BetterReading | None:
    sample = sample_of(data, problem.arm, problem.measurement)
    if sample is None:
        return None
    robot, spec = problem.robot, problem.data

    def readings() -> list[Reading]:
        found = [*unit_readings(robot, columns, sample.commanded), *joint_readings(robot, columns, sample.idle)]
        found += [*coupling_readings(robot)]
        if sample.rotation is not None and turned is not None:
            found += orientation_readings(turned.take(sample.rows), data.inverted != (spec.direction == "inverted"))
            found.append(direction_reading(spec.frame == "camera", spec.direction == "inverted"))
        if data.position is None:
            return found
        found.append(scale_reading(spec.frame == "camera"))
        return [*found, *axis_readings([axis for axis in AXES if axis in columns], robot.base_free)]

    return better_reading(sample, problem.arm, readings)


def _motion_scale(found: AffineFit) -> float | None:
    """How many times as far as the nominal tool the measured point moves."""
    return None if found.map is None else float(np.sqrt(np.sum(found.map**2) / len(found.axes)))


def _wrong_lengths(
    found: AffineFit, measured: Array, q: Array, robot: Robot, columns: list[Column], faults: Faults
) -> bool:
    scales: Array
    if found.map is not None and len(found.axes) == len(columns):
        scales = np.linalg.norm(found.map, axis=1)
    else:
        scales = np.full(len(columns), _motion_scale(found) or _distance_ratio(measured, q, robot))
    guesses = [_likely_unit(scale, column) for scale, column in zip(scales, columns, strict=True)]
    for unit in dict.fromkeys(guess for guess in guesses if guess):
        those = [column for column, guess in zip(columns, guesses, strict=True) if guess == unit]
        ratio = float(scales[guesses.index(unit)])
        names = ", ".join(column.name for column in those)
        message = f"the measured points move {ratio:.3g} times as far along {names} as the nominal robot's tool"
        hint = f"the numbers look like {unit}: write " + ", ".join(f"{column.name} [{unit}]" for column in those)
        faults.add(message, those[0].name, hint=hint)
    return any(guesses)


def _distance_ratio(measured: Array, q: Array, robot: Robot) -> float:
    points, _ = nominal_poses(robot, q)
    order = np.random.default_rng(0).permutation(len(q))
    nominal = np.linalg.norm(points[order] - points[np.roll(order, 1)], axis=1)
    distance = np.linalg.norm(measured[order] - measured[np.roll(order, 1)], axis=1)
    # A tool offset that is not known yet moves the point too: postures that leave the nominal point say nothing.
    far = nominal > 0.05 * reach(robot)
    return float(np.median(distance[far] / nominal[far])) if far.any() else math.nan


def _likely_unit(scale: float, column: Column) -> str:
    if not scale > 0 or 0.2 < scale < 5:
        return ""
    for units, tolerance in ((("m", "mm", "um"), 5.0), (("cm", "in"), 1.3)):
        for unit in units:
            if abs(math.log(scale * _LENGTH_UNITS[unit] / column.factor)) < math.log(tolerance):
                return unit
    return ""


def _turned_note(found: AffineFit, robot: Robot, named: list[str]) -> list[str]:
    if robot.base_free or found.map is None or found.map.shape[0] != found.map.shape[1]:
        return []
    left, _, right = np.linalg.svd(found.map)
    cosine = (np.trace(left @ right) - (1 if len(named) == 3 else 0)) / 2
    angle = math.degrees(math.acos(min(1.0, max(-1.0, cosine))))
    if angle < 10:
        return []
    return [
        f"the measured frame is turned by {angle:.0f} deg against the base of the problem file: state the base, or "
        "write base: free to have it found"
    ]


def _unlike_note(misfit: float, scale: float | None, what: str) -> list[str]:
    if misfit > 0.1:
        return [
            f"whatever base and tool, the nominal robot leaves {100 * misfit:.3g} % unexplained ({what}): is it "
            "another robot's file, or are signs or zeros of joints different?"
        ]
    if scale is not None and not 0.9 < scale < 1.1:
        return [
            f"the measured points move {scale:.3g} times as far as the nominal robot's: is it another robot's file?"
        ]
    return []
