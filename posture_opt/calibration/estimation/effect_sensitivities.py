"""What one unit of an effect does to every measured coordinate."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from posture_opt.calibration.estimation.residuals import Residuals, gravity_of
from posture_opt.measurements.measurements import Measurements, inputs_of
from posture_opt.model.arm_state import ArmState
from posture_opt.model.chain import Walk
from posture_opt.model.effects import Effect, Excitation
from posture_opt.numerics import Array
from posture_opt.robot.robot import Robot


def case_of(data: Measurements, robot: Robot) -> Excitation:
    """What these measurements can show of effects."""
    state = ArmState(robot, list(data.q.T), inputs_of(data, robot))
    # 0.05 kg, 0.3 K: less shows nothing
    inputs = (("payload", data.payload, 0.05), ("temperature", data.temperature, 0.3))
    known = {name for name, values, least in inputs if values is not None and float(np.ptp(values)) > least}
    # Half of the rows must know the side from which their joints arrived.
    sided = np.mean(np.any(data.approach != 0, axis=1)) > 0.5 and len(np.unique(np.sign(data.approach))) > 1
    shown = {"time": len(data) > 1, "approach": sided, "masses": state.weighed, "speed": len(state.inputs.speed)}
    known |= {name for name, can in shown.items() if can}
    span = tuple(float(v) * (not robot.pose_prefix) for v in np.ptp(data.q, axis=0))  # a flange has no joints that err
    times = np.asarray(state.inputs.time, dtype=float)
    oriented = data.kind.oriented or len(np.unique(data.target)) > 1
    duration = float(np.ptp(times))
    return Excitation(robot, frozenset(known), span, duration, tuple(times.tolist()), oriented, data.touches)


@dataclass(frozen=True, eq=False)
class EffectSensitivities:
    """Columns of effects at the arm ``x`` (k,) of ``residuals``, laid out as the rows of its Jacobian."""

    residuals: Residuals  # the arm against N rows; x: (k,) its deviations from nominal [rad, m]
    x: Array

    @cached_property
    def walk(self) -> Walk:
        """The chain at all rows."""
        return self.residuals.walk(self.x)

    @cached_property
    def state(self) -> ArmState:
        """The arm at all rows with its loads: the file's links, on the base and with the tool that were found."""
        robot, frames = self.residuals.robot, self.residuals.frames(self.x)
        upright, q = replace(robot, gravity=gravity_of(robot, frames)), list(self.residuals.data.q.T)
        return ArmState(upright, q, self.residuals.arm.inputs, frames, self.residuals.arm.carried(q))

    @property
    def rows(self) -> int:
        """The number of residuals: of all rows, and behind them of known distances, on which no effect acts."""
        return self.residuals.measured + len(self.residuals.distances)

    @cached_property
    def joints(self) -> Array:
        """(n, N, block) whitened residual per unit of each joint."""
        columns = self.residuals.sensitivities(self.residuals.robot.driven, self.x, self.walk)
        return np.ascontiguousarray(np.moveaxis(columns, -1, 0))

    def columns(self, effect: Effect) -> Array:
        """(rows, parameters) whitened residual per unit of each parameter of an effect.

        ``∂r/∂θ = (1/σ) J_point ∂(joints, frames)/∂θ``: an effect moves joints or frames, the chain carries that to the
        point.
        """
        units = effect.sensitivities(self.state)
        if all(one.of_joints for one in units):
            found = np.zeros((len(self.residuals.data), self.residuals.block, len(units)))
            for k, one in enumerate(units):
                for joint, size in one.joints.items():
                    found[:, :, k] += self.joints[joint] * np.reshape(size, (-1, 1))
            return self._flat(found)
        twists = [self.residuals.arm.twist_of(self.walk, one) for one in units]
        return self._flat(self.residuals.whiten(twists, self.x, self.walk))

    def fitted_columns(self, effect: Effect, theta: Array) -> Array:
        """(rows, p) the columns of an effect of size ``theta``, and of its smooth shape where it has one."""
        wide = self.residuals.with_effects([effect], self.x)
        own = wide.parameters[len(self.x) :]
        x = np.r_[self.x, theta, np.zeros(len(own) - len(theta))]
        return self._flat(wide.sensitivities([p.source for p in own], x))

    def of_joint(self, joint: int, features: Array) -> Array:
        """Columns (rows, k) of features (N, k) [rad or m] that add to the value of one joint."""
        columns: Array = self.joints[joint][:, :, None] * features[:, None, :]
        return self._flat(columns)

    def of_point(self, features: Array) -> Array:
        """Columns (rows, axes·k) of features (N, k) [m] that shift the measured point along each measured axis."""
        residuals = self.residuals
        N, axes = len(residuals.data), len(residuals.axes)
        columns = np.zeros((N, residuals.block, axes, features.shape[1]))
        columns[:, range(axes), range(axes)] = (features / np.reshape(residuals.row_sigma, (-1, 1)))[:, None]
        return self._flat(columns.reshape(N, residuals.block, -1))

    def _flat(self, columns: Array) -> Array:
        """(N, block, k) as the rows of the Jacobian, zero for known distances."""
        flat = columns.reshape(self.residuals.measured, -1)
        return np.concatenate([flat, np.zeros((len(self.residuals.distances), flat.shape[1]))])
