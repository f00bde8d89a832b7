"""Free frames near gimbal lock: fitted by small turns, reported in roll, pitch and yaw.

At a pitch of ±90° roll and yaw turn about one axis: their sum or difference is all that matters, and a fit in them
takes steps without end. Small angles about the start have no such place nearby.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from posture_opt.calibration.estimation.parameters import tool_unknown
from posture_opt.calibration.estimation.residuals import Residuals
from posture_opt.calibration.estimation.starting_values import frame_rotation, starting_deviations
from posture_opt.measurements.rotations import roll_pitch_yaw
from posture_opt.numerics import Array, Mask
from posture_opt.robot.robot import Factor, Robot, frame_factors

_LOCKED_COSINE = 0.1  # cosine of the pitch: below, a turn about one axis takes large turns of roll against yaw
_MIN_COSINE = 0.01  # cosine of the pitch in standard errors of roll and yaw, which would be endless at ±90°
_LOCK_STD_ERRORS = 5.0  # standard errors from the lock: from there on roll and yaw have errors as others have
_LOOSE_SHARE = 1e-3  # of an undetermined turn: a smaller part of it in an angle is no matter
_ANGLE_NAMES = ("yaw", "pitch", "roll")


@dataclass(frozen=True, eq=False)
class Chart:
    """The unknowns of ``given`` as they are reported, and those of ``fitted`` as they are fitted.

    In ``fitted`` a locked frame is ``Trans(x, y, z) R₀ Rz(yaw) Ry(pitch) Rx(roll)`` with small angles; in ``given`` it
    is ``Trans(x, y, z) Rz(yaw) Ry(pitch) Rx(roll)``. Where no frame is locked both are the same.

    Args:
        locked: which of ``base`` and ``tool`` start within 6° of a pitch of ±90°.
    """

    given: Residuals
    fitted: Residuals
    locked: tuple[str, ...]

    @classmethod
    def of(cls, residuals: Residuals) -> Chart:
        """The chart that suits where free frames start."""
        robot = residuals.robot
        value = dict(zip((p.name for p in residuals.parameters), starting_deviations(residuals), strict=True))
        free = {"base": robot.base_free, "tool": tool_unknown(robot, residuals.data)}
        locked = []
        for frame in ("base", "tool"):
            factors = {f.parameter: f for f in getattr(robot, frame)}
            if not free[frame] or any(f"{frame}.{turn}" not in value for turn in _ANGLE_NAMES):
                continue
            angles = {turn: factors[f"{frame}.{turn}"].nominal + value[f"{frame}.{turn}"] for turn in _ANGLE_NAMES}
            if abs(math.cos(angles["pitch"])) < _LOCKED_COSINE:
                small = _unlocked_factors(frame, getattr(robot, frame), angles)
                robot = replace(robot, base=small) if frame == "base" else replace(robot, tool=small)
                locked.append(frame)
        return cls(residuals, _in_robot(residuals, robot) if locked else residuals, tuple(locked))

    def given_deviations(self, x: Array) -> Array:
        """Deviations (k,) of ``given`` from those of ``fitted``."""
        x = x.copy()
        for frame in self.locked:
            at = self._angle_indices(frame)
            turned = frame_rotation(getattr(self.fitted.robot, frame), dict(zip(_ANGLE_NAMES, x[at], strict=True)))
            angles = roll_pitch_yaw(turned)
            nominal = {f.parameter: f.nominal for f in getattr(self.given.robot, frame)}
            x[at] = [angles[turn] - nominal[f"{frame}.{turn}"] for turn in _ANGLE_NAMES]
        return x

    def given_steps(self, x: Array, directions: Array) -> Array:
        """Steps (k, r) of ``given`` from those of ``fitted``."""
        return np.asarray(self._rates(x) @ directions) if self.locked else directions

    def given_determined(self, x: Array, fixed: Mask, covariance: Array) -> Mask:
        """Which of ``given``'s are determined (k,): an angle is, where all the turns are that it is made of.

        Where the lock itself lies within the errors (``covariance`` of ``fitted``), roll and yaw have no values of
        their own.
        """
        loose = np.asarray((np.abs(self._rates(x)) * ~fixed > _LOOSE_SHARE).any(axis=1))
        for frame in self.locked:
            yaw, pitch, roll = at = self._angle_indices(frame)
            angles = roll_pitch_yaw(
                frame_rotation(getattr(self.fitted.robot, frame), dict(zip(_ANGLE_NAMES, x[at], strict=True)))
            )
            tilt = math.sqrt(max(covariance[yaw, yaw], covariance[pitch, pitch], 0.0))
            if abs(math.cos(angles["pitch"])) < max(_MIN_COSINE, _LOCK_STD_ERRORS * tilt):
                loose[[yaw, roll]] = True
        return np.asarray(~loose)

    def given_sizes(self, x: Array, sizes: Array) -> Array:
        """Sizes of errors (k,) of ``given`` from those of ``fitted``."""
        return np.asarray(np.sqrt(self._rates(x) ** 2 @ sizes**2))

    def _rates(self, x: Array) -> Array:
        """The derivative (k, k) of the deviations of ``given`` by those of ``fitted``, at x (k,)."""
        G = np.eye(len(x))
        for frame in self.locked:
            at = self._angle_indices(frame)
            angles = roll_pitch_yaw(
                frame_rotation(getattr(self.fitted.robot, frame), dict(zip(_ANGLE_NAMES, x[at], strict=True)))
            )
            G[np.ix_(at, at)] = _angle_rates(angles["roll"], angles["pitch"])
        return G

    def _angle_indices(self, frame: str) -> list[int]:
        """Indices of yaw, pitch and roll of a frame among the parameters."""
        names = [p.name for p in self.given.parameters]
        return [names.index(f"{frame}.{turn}") for turn in _ANGLE_NAMES]


def _unlocked_factors(frame: str, factors: tuple[Factor, ...], angles: dict[str, float]) -> tuple[Factor, ...]:
    """The factors of a frame: its angles as a constant rotation R₀, then small angles as the parameters."""
    shifts = tuple(f for f in factors if f.kind == "translate")
    turned = frame_factors(frame, (0.0, 0.0, 0.0), (angles["roll"], angles["pitch"], angles["yaw"]))[3:]
    small = frame_factors(frame, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))[3:]
    return (*shifts, *(replace(factor, parameter="") for factor in turned), *small)


def _in_robot(residuals: Residuals, robot: Robot) -> Residuals:
    """The same unknowns in a robot with other nominal factors."""
    nominal = {name: factor.nominal for name, factor in robot.parameters.items()}
    parameters = (replace(p, nominal=nominal.get(p.source, p.nominal)) for p in residuals.parameters)
    return residuals.of_robot(robot, tuple(parameters))


def _angle_rates(roll: float, pitch: float) -> Array:
    """Rates (3, 3) of (yaw, pitch, roll) per small turn about the frame's (z, y, x); cos(pitch) is kept off zero."""
    c, s = math.cos(roll), math.sin(roll)
    cosine = math.copysign(max(abs(math.cos(pitch)), _MIN_COSINE), math.cos(pitch))
    tangent = math.sin(pitch) / cosine
    return np.array([[c / cosine, s / cosine, 0.0], [-s, c, 0.0], [c * tangent, s * tangent, 1.0]])
