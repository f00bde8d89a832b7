"""The error that a model of an arm predicts in a posture that another model may have chosen."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from posture_opt.numerics import Array, Mask
from posture_opt.robot.robot import Robot
from posture_opt.selection.answer.solution import Solution
from posture_opt.selection.problem_data import ProblemData
from posture_opt.uncertainty.regions.clearance import within_clearance
from posture_opt.uncertainty.regions.coverage_radius import coverage_radius
from posture_opt.uncertainty.regions.regions import deviation
from posture_opt.uncertainty.spread.spread import relative_spread
from posture_opt.uncertainty.spread.spread_parts import SpreadParts, spread_parts

_TURN = 2 * math.pi


@dataclass(frozen=True, eq=False)
class PredictedError:
    """Mean and covariance of the tool point about the target in one posture, as one model predicts them.

    Args:
        miss: (3,) mean tool point minus the target [m], world.
        across: (m,) its components that the task cares about [m].
        sigma_max: largest standard deviation of these components [m].
        critical_error: distance from the target that 95 of 100 repeats stay within, in these components [m].
        success_probability: of staying within the clearance; None without one.
        covariance: (3, 3) of the tool point [m²], world.
        parts: what of it is scatter and what is systematic, in the components that count.
        from_measured: distance from the postures that the model was fitted to; None where these are not known.
    """

    miss: Array
    across: Array
    sigma_max: float
    critical_error: float
    success_probability: float | None
    covariance: Array
    parts: SpreadParts | None = None
    from_measured: PostureDistance | None = None

    @property
    def distance(self) -> float:
        """Distance of the mean from the target in the components that count [m]."""
        return float(np.linalg.norm(self.across))


@dataclass(frozen=True, eq=False)
class JudgedAnswer:
    """A cell of a comparison: the postures of one answer as one model predicts them, each with its error."""

    predicted_errors: tuple[PredictedError, ...]

    @property
    def worst(self) -> PredictedError:
        """The error in the posture that has the largest one."""
        return max(self.predicted_errors, key=lambda predicted: predicted.critical_error)

    @property
    def sigma_max(self) -> float:
        """Largest standard deviation of the part that counts [m]."""
        return max(predicted.sigma_max for predicted in self.predicted_errors)

    @property
    def distance(self) -> float:
        """Largest distance of a mean from its target, in the part that counts [m]."""
        return max(predicted.distance for predicted in self.predicted_errors)

    @property
    def critical_error(self) -> float:
        """Distance from the target that 95 of 100 repeats stay within, where it is largest [m]."""
        return self.worst.critical_error

    @property
    def success_probability(self) -> float | None:
        """To stay within the clearance where that is least likely; None without one."""
        probabilities = [predicted.success_probability for predicted in self.predicted_errors]
        known = [p for p in probabilities if p is not None]
        return min(known) if len(known) == len(probabilities) else None

    def to_json(self) -> dict[str, Any]:
        """Plain numbers, SI."""
        return {
            "sigma_max": self.sigma_max,
            "miss": self.distance,
            "critical_error": self.critical_error,
            "success_probability": self.success_probability,
        }


def judged_answer(
    problem: ProblemData, stations: Sequence[Solution], basis: Array | None = None, measured: Array | None = None
) -> JudgedAnswer:
    """The postures of an answer as the arm of ``problem`` predicts them.

    Args:
        basis: (3, m) orthonormal directions that count, world; those of each posture by default.
        measured: (N, n) postures that the arm was fitted to [rad or m].
    """
    return JudgedAnswer(
        tuple(
            predicted_error(problem, station, station.basis if basis is None else basis, measured)
            for station in stations
        )
    )


def predicted_error(problem: ProblemData, solution: Solution, basis: Array, measured: Array | None) -> PredictedError:
    """As ``problem`` predicts it in the posture of a solution that another model may have chosen."""
    own = solution.problem is problem
    spread = solution.spread if own else relative_spread(problem, solution.q, solution.target.lever)
    wanted = np.clip(solution.spread.position, solution.target.lower, solution.target.upper)
    miss = spread.position + spread.bias - wanted
    across, C = basis.T @ miss, basis.T @ spread.covariance @ basis
    return PredictedError(
        miss=miss,
        across=across,
        sigma_max=deviation(float(np.linalg.eigvalsh(C)[-1]), spread.covariance),
        critical_error=coverage_radius(0.95, C, across),
        success_probability=within_clearance(C, solution.target.clearance, across),
        covariance=spread.covariance,
        parts=spread_parts(spread, basis),
        from_measured=None if measured is None else PostureDistance.of(problem.robot, np.array(solution.q), measured),
    )


@dataclass(frozen=True)
class PostureDistance:
    """Distance of a posture from measured ones.

    Args:
        nearest: least over the measured postures of the largest difference of a joint [rad], slides left out where
            other joints turn; else [m].
        joint: the one that is farthest outside the range that it was measured in, by ``beyond`` [rad or m]; empty
            where all are within.
    """

    nearest: float
    joint: str
    beyond: float

    @classmethod
    def of(cls, robot: Robot, q: Array, measured: Array) -> PostureDistance:
        """Of posture q (n,) from the rows of ``measured`` (N, n) [rad or m]; whole turns count as none."""
        turns = np.array([joint.type == "revolute" for joint in robot.joints])
        apart = np.abs(_wrapped(measured - q, turns))
        near = apart[:, turns] if turns.any() else apart
        beyond = np.array(
            [_beyond(value, column, turn) for value, column, turn in zip(q, measured.T, turns, strict=True)]
        )
        worst = int(np.argmax(np.where(turns, beyond, beyond / _scale(measured, turns))))
        name = robot.joint_names[worst] if beyond[worst] > 0 else ""
        return cls(float(near.max(axis=1).min()), name, float(beyond[worst]))

    def to_json(self) -> dict[str, Any]:
        """Plain numbers [rad or m]."""
        return {"nearest": self.nearest, "joint": self.joint or None, "beyond": self.beyond}


def _wrapped(difference: Array, turns: Mask) -> Array:
    turned = (difference + math.pi) % _TURN - math.pi
    return np.where(turns, turned, difference)


def _beyond(value: float, column: Array, turns: bool) -> float:
    """How far a joint value lies outside of the range of measured ones, whole turns taken off."""
    low, high = float(column.min()), float(column.max())
    shifts = _TURN * np.arange(-2, 3) if turns else np.zeros(1)
    return float(np.min(np.maximum(0.0, np.maximum(low - value - shifts, value + shifts - high))))


def _scale(measured: Array, turns: Mask) -> Array:
    """(n,) metres of a slide that weigh as a radian: its measured range."""
    return np.where(turns, 1.0, np.maximum(np.ptp(measured, axis=0), 1e-3))
