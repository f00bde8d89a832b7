"""Measurements that look wrong as a whole: another unit, swapped columns, a mirrored frame, another robot's file.

What is guessed is reported and never applied: the user knows what was measured.
"""

from __future__ import annotations

import math
from typing import Protocol

import numpy as np

from posture_opt.measurements.affine_fit import AffineFit, affine_fit, reach, sample_rows, touch_misfit
from posture_opt.measurements.columns import AXES, Column
from posture_opt.measurements.data_section import DataSpec
from posture_opt.measurements.faults import Faults
from posture_opt.measurements.measurements import Measurements, carried_joint_values, nominal_poses
from posture_opt.measurements.orientation_columns import OrientationColumns
from posture_opt.measurements.readings.better_reading import BetterReading
from posture_opt.measurements.readings.reading_search import better_reading, sample_of
from posture_opt.measurements.readings.readings import (
    SCALE,
    Reading,
    axis_readings,
    coupling_readings,
    direction_reading,
    joint_readings,
    orientation_readings,
    unit_readings,
)
from posture_opt.model.arm import Arm
from posture_opt.numerics import Array
from posture_opt.robot.robot import Robot

_LENGTH_UNITS = {"m": 1.0, "mm": 1e-3, "um": 1e-6, "cm": 1e-2, "in": 0.0254}
"""Units of length -> [m], in which coordinates may have been written."""
_UNLIKE_MISFIT = 0.1
"""Unexplained share from which a warning says that another robot may have been measured."""
_MAX_DISTANCE_RATIO = 1e4
"""Lengths of the arm from the middle of all points; a wrong unit makes a thousand of one."""
_TRUSTED_MISFIT = 0.2
"""Unexplained share up to which scale and sign of the fitted map mean something."""


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
    """Warnings on data that can be used, and a reading that explains them better; faults where they cannot be.

    Args:
        data: all rows; a sample of at most 400 is checked.
        problem: the nominal arm, and how its data are read.
        columns: of the file, for names and units.
        turned: the columns of the orientation.
        faults: of the file.
    """
    robot, rows = problem.robot, sample_rows(data)
    if data.position is None and not data.touches:
        return [], None
    if data.position is not None and _far_off(data, data.position[:, data.measured_axes], robot, faults):
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
    turned_frame = _turned_note(found, robot, named)
    return [*_unlike_note(found.misfit, scale, "of the measured motion"), *turned_frame], better


def _better_reading(
    data: Measurements, problem: HasData, columns: dict[str, Column], turned: OrientationColumns | None
) -> BetterReading | None:
    """The reading of the list that explains the data where the one given does not; None where there is none."""
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
        return [*found, SCALE, *axis_readings([axis for axis in AXES if axis in columns], robot.base_free)]

    return better_reading(sample, problem.arm, readings)


def _far_off(data: Measurements, position: Array, robot: Robot, faults: Faults) -> bool:
    """Whether rows were measured where no instrument could have seen the tool: no outlier of an instrument."""
    size = max(reach(robot), 1.0)
    off = np.linalg.norm(position - np.median(position, axis=0), axis=1)
    far = np.flatnonzero(off > _MAX_DISTANCE_RATIO * size)
    for row in map(int, far):
        message = f"the point lies {off[row]:.3g} m from the middle of all, and the arm is {size:.3g} m long"
        faults.add(message, hint="leave out the row", line=int(data.line[row]))
    return bool(len(far))


def _motion_scale(found: AffineFit) -> float | None:
    """How many times as far as the nominal tool the measured point moves; None where the fit is too poor."""
    if found.map is None or not found.misfit < _TRUSTED_MISFIT:
        return None
    return float(np.sqrt(np.sum(found.map**2) / len(found.axes)))


def _wrong_lengths(
    found: AffineFit, measured: Array, q: Array, robot: Robot, columns: list[Column], faults: Faults
) -> bool:
    """Whether coordinates look like another unit of length, each column for itself where the data determine that."""
    scales: Array
    if found.misfit < _TRUSTED_MISFIT and found.map is not None and len(found.axes) == len(columns):
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
    """The median ratio of distances between measured points to those of the nominal tool points; NaN for none."""
    points, _ = nominal_poses(robot, q)
    order = np.random.default_rng(0).permutation(len(q))
    nominal = np.linalg.norm(points[order] - points[np.roll(order, 1)], axis=1)
    distance = np.linalg.norm(measured[order] - measured[np.roll(order, 1)], axis=1)
    # A tool offset that is not known yet moves the point too: postures that leave the nominal point say nothing.
    far = nominal > 0.05 * reach(robot)
    return float(np.median(distance[far] / nominal[far])) if far.any() else math.nan


def _likely_unit(scale: float, column: Column) -> str:
    """The unit that the numbers of a column seem to have, by the scale of their motion; empty where it is the stated
    one.
    """
    if not scale > 0 or 0.2 < scale < 5:
        return ""
    for units, tolerance in ((("m", "mm", "um"), 5.0), (("cm", "in"), 1.3)):
        for unit in units:
            if abs(math.log(scale * _LENGTH_UNITS[unit] / column.factor)) < math.log(tolerance):
                return unit
    return ""


def _square_map(found: AffineFit) -> Array | None:
    """The map (k, k) between as many axes as are measured, where the fit is good enough to trust its sign."""
    if found.map is None or found.map.shape[0] != found.map.shape[1] or not found.misfit < _TRUSTED_MISFIT:
        return None
    return found.map


def _turned_note(found: AffineFit, robot: Robot, named: list[str]) -> list[str]:
    """A warning where the problem states the base and the data are in another frame, by more than 10 deg."""
    square = _square_map(found)
    if robot.base_free or square is None:
        return []
    left, _, right = np.linalg.svd(square)
    cosine = (np.trace(left @ right) - (1 if len(named) == 3 else 0)) / 2
    angle = math.degrees(math.acos(min(1.0, max(-1.0, cosine))))
    if angle < 10:
        return []
    return [
        f"the measured frame is turned by {angle:.0f} deg against the base of the problem file: state the base, or "
        "write base: free to have it found"
    ]


def _unlike_note(misfit: float, scale: float | None, what: str) -> list[str]:
    """A warning where no base and no tool lets the nominal robot come near the data."""
    if misfit > _UNLIKE_MISFIT:
        return [
            f"whatever base and tool, the nominal robot leaves {100 * misfit:.3g} % unexplained ({what}): is it "
            "another robot's file, or are signs or zeros of joints different?"
        ]
    if scale is not None and not 0.9 < scale < 1.1:
        return [
            f"the measured points move {scale:.3g} times as far as the nominal robot's: is it another robot's file?"
        ]
    return []
