"""One joint that scatters more from repeat to repeat than stated."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import ClassVar, Literal

import numpy as np
from pydantic import Field, model_validator

from posture_opt.errors import BadValueError
from posture_opt.model.effects.base.cause import FittedSizes, Size
from posture_opt.model.effects.noise.noise_effect import NoiseEffect, Pattern, Rows
from posture_opt.numerics import Array
from posture_opt.robot.robot import Robot
from posture_opt.units import Quantity, parse_quantity, shown

# Variance along a joint's column over the variance of the instrument, at the root mean square of the column
_VARIANCE_RATIOS = np.concatenate([[0.0], np.geomspace(1e-2, 1e3, 41)])


class JointNoise(NoiseEffect):
    """``Σ = Σ0 + σ² J_j J_jᵀ``: a joint whose value is off by another amount at every visit; σ in rad, of a slide in
    m.
    """

    summary: ClassVar[str] = "the joint scatters from repeat to repeat, on top of what else is stated of it"
    phrase: ClassVar[str] = "{target} scatters more than stated"
    unstated: ClassVar[str] = "{target} scatters from repeat to repeat by {size}, which the file does not state"
    measurement: ClassVar[str] = "repeat each posture a few times, moving away in between"
    inspection: ClassVar[str] = (
        "{target}: brake, in-position window and servo gains, coupling of the encoder, a belt if it has one"
    )
    rivals: ClassVar[Mapping[str, str]] = {
        "range_noise": "repeat postures near the instrument and far from it, moving away in between",
        "outliers": "repeat each posture a few times, moving away in between: an outlier does not recur",
    }
    of_arm: ClassVar[bool] = True
    uneven: ClassVar[bool] = True

    kind: Literal["joint_noise"] = "joint_noise"
    joint: str = Field(description="the joint that scatters")
    sigma: Quantity = Field(description="standard deviation from repeat to repeat")
    std: Quantity | None = Field(None, description="standard error of sigma, where it was measured")

    @model_validator(mode="after")
    def _are_sizes(self) -> JointNoise:
        for value in (self.sigma, *(() if self.std is None else (self.std,))):
            if parse_quantity(value, _sigma_dimension(value)) <= 0:
                raise BadValueError(f"{value} is no standard deviation", "write one greater than 0")
        return self

    @property
    def target(self) -> str:
        return self.joint

    @property
    def stated(self) -> tuple[tuple[str, float, str], ...]:
        """σ [rad or m]."""
        return (("sigma", self.value, _sigma_dimension(self.sigma)),)

    @property
    def moved_joint(self) -> str:
        return self.joint

    def sizes(self, estimate: FittedSizes) -> tuple[Size, ...]:
        """σ with its standard error."""
        text = shown(estimate.entry("sigma")[0], _sigma_dimension(self.sigma), estimate.entry("sigma")[1])
        return (Size("scatter", text, ", one standard deviation"),)

    @property
    def value(self) -> float:
        """σ [rad or m]."""
        return parse_quantity(self.sigma, _sigma_dimension(self.sigma))

    def check_robot(self, robot: Robot) -> None:
        """Refuse a joint that the robot lacks."""
        types = {j.name: j.type for j in robot.joints}
        if self.joint not in types:
            raise BadValueError(f"the robot has no joint '{self.joint}'", f"its joints: {', '.join(types)}")
        parse_quantity(self.sigma, "angle" if types[self.joint] == "revolute" else "length")

    def scatter(self, robot: Robot) -> dict[str, float]:
        """σ [rad or m] of the parameter of the joint's own variable."""
        return {robot.factors[robot.driven[robot.joint_names.index(self.joint)]].parameter: self.value}

    def shape(self, rows: Rows) -> Array:
        """(N, d, d) ``I + σ² J_j J_jᵀ``, J_j in units of the instrument's σ."""
        column = self.value * rows.levers[rows.robot.joint_names.index(self.joint)]
        return np.asarray(np.eye(column.shape[1]) + column[:, :, None] * column[:, None, :])

    def joined(self, other: NoiseEffect) -> JointNoise:
        """One noise of the joint with ``√(σ₁² + σ₂²)``: both are independent."""
        assert isinstance(other, JointNoise)
        return self.of(self.joint, math.hypot(self.value, other.value), _sigma_dimension(self.sigma))

    @classmethod
    def of(cls, joint: str, sigma: float, dimension: str, std: float = math.nan) -> JointNoise:
        """The noise of a joint from numbers, written with four digits. sigma, std: standard deviation and its standard
        error [rad or m]; NaN for a standard error that is not known; dimension: ``angle`` or ``length``."""
        texts = {
            name: f"{float(f'{value * 1e3:.4g}'):g} {'mrad' if dimension == 'angle' else 'mm'}"
            for name, value in (("sigma", sigma), ("std", std))
            if math.isfinite(value)
        }
        return cls(joint=joint, **texts)

    @classmethod
    def patterns(cls, rows: Rows) -> Sequence[Pattern]:
        """One pattern for each joint that moves a measured coordinate."""
        joints = zip(rows.robot.joints, rows.levers, strict=True)
        return [Along(j.name, column, j.type == "revolute") for j, column in joints if np.linalg.norm(column) > 0]


def _sigma_dimension(text: object) -> str:
    """Whether a σ is that of an angle or of a length; an angle where it is neither, and reading it then fails."""
    try:
        parse_quantity(text, "length")
    except ValueError:
        return "angle"
    return "length"


class Along(Pattern):
    """Rows that a noisy joint spreads along its column. joint: its name; column: (N, d) shift of the measured
    coordinates per unit of the joint, in units of the instrument's σ; turns: whether σ is in rad, else in m."""

    effect: type[NoiseEffect] = JointNoise
    grid = _VARIANCE_RATIOS

    def __init__(self, joint: str, column: Array, turns: bool) -> None:
        self.target = joint
        self.quantity: tuple[str, str] = ("sigma", "rad" if turns else "m")
        self.square: Array = np.einsum("nd,nd->n", column, column)
        self.scale: float = float(np.mean(self.square))
        self.dimension: int = column.shape[1]
        self.unit: Array | None = column / np.sqrt(np.maximum(self.square, 1e-300))[:, None]

    def inflation(self, value: float) -> Array:
        """(N,) variance along the column over that across it, ``1 + value |J_i|² / mean |J|²``."""
        return np.asarray(1 + value * self.square / self.scale)

    def size(self, value: float, s2: float) -> float:
        """σ [rad or m] of a value of the grid and the variance s² that belongs to it."""
        return float(np.sqrt(value * s2 / self.scale))

    def error(self, value: float, s2: float) -> float:
        """Standard error of σ, from Fisher's information on s² and σ² together; infinite for σ = 0. Rows have the
        variance ``s² + σ² a_i`` along the column and s² in the d − 1 directions across it."""
        sigma, along = self.size(value, s2), s2 * self.inflation(value)
        if not sigma:
            return math.inf
        across = (self.dimension - 1) * len(along) / s2**2
        information = np.array([
            [np.sum((self.square / along) ** 2), np.sum(self.square / along**2)],
            [np.sum(self.square / along**2), np.sum(along**-2.0) + across],
        ])  # fmt: skip
        scale = np.sqrt(np.diag(information))
        return float(np.sqrt(2 * np.linalg.inv(information / np.outer(scale, scale))[0, 0]) / scale[0] / (2 * sigma))

    def named(self, value: float, s2: float, std: float) -> JointNoise:
        """The noise of the joint with that σ."""
        dimension = "angle" if self.quantity[1] == "rad" else "length"
        return JointNoise.of(self.target, self.size(value, s2), dimension, std)
