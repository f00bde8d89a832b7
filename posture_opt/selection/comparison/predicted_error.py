"""The error that a model of an arm predicts in a posture that another model may have chosen."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from posture_opt.encoding import Encoded
from posture_opt.numerics import TURN, Array
from posture_opt.robot.robot import Robot
from posture_opt.selection.answer.solution import Solution
from posture_opt.selection.problem_data import ProblemData
from posture_opt.uncertainty.clearance import coverage_radius, within_clearance
from posture_opt.uncertainty.regions import deviation
from posture_opt.uncertainty.spread import relative_spread
from posture_opt.uncertainty.spread_parts import SpreadParts, spread_parts


@dataclass(frozen=True, eq=False)
class PredictedError:
    """Mean and covariance of the tool point about the target in one posture, predicted by one model."""

    miss: Array  # (3,) mean tool point minus the target [m], world
    across: Array  # (m,) its components that the task cares about [m]
    sigma_max: float  # largest standard deviation of these components [m]
    critical_error: float  # distance from the target that 95 of 100 repeats stay within, in these components [m]
    success_probability: float | None  # of staying within the clearance; None without one
    covariance: Array  # (3, 3) of the tool point [m²], world
    parts: SpreadParts | None = None  # what of it is scatter and what is systematic, in the components that count
    from_measured: PostureDistance | None = None  # from the postures that the model was fitted to, if known

    @property
    def distance(self) -> float:
        """Distance of the mean from the target in the components that count [m]."""
        return float(np.linalg.norm(self.across))


@dataclass(frozen=True, eq=False)
class JudgedAnswer(Encoded, json="sigma_max miss=distance critical_error success_probability"):
    """A cell of a comparison: the postures of one answer as one model predicts them."""

    predicted_errors: tuple[PredictedError, ...]

    @property
    def worst(self) -> PredictedError:
        """The largest error."""
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


def judged_answer(
    problem: ProblemData, stations: Sequence[Solution], basis: Array | None = None, measured: Array | None = None
) -> JudgedAnswer:
    """Postures as ``problem`` predicts them, in directions ``basis`` (3, m); measured ones (N, n) [rad or m]."""
    given = [(station, station.basis if basis is None else basis) for station in stations]
    return JudgedAnswer(tuple(_predicted_error(problem, station, B, measured) for station, B in given))


def _predicted_error(problem: ProblemData, solution: Solution, basis: Array, measured: Array | None) -> PredictedError:
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
    """Distance of a posture from measured ones."""

    # Least over the measured postures of the largest difference of a turning joint [rad], or else of a slide [m].
    nearest: float
    joint: str  # farthest outside its measured range; empty where all are within
    beyond: float  # by how much [rad or m]

    @classmethod
    def of(cls, robot: Robot, q: Array, measured: Array) -> PostureDistance:
        """Distance of q (n,) from the rows of ``measured`` (N, n) [rad or m]; whole turns count as none."""
        turns = np.array([joint.type == "revolute" for joint in robot.joints])
        apart = measured - q
        apart = np.abs(np.where(turns, (apart + math.pi) % TURN - math.pi, apart))
        near = apart[:, turns] if turns.any() else apart
        # By whole turns more or less the least distance from the range of each joint.
        shifted = q + np.where(turns, TURN, 0.0) * np.arange(-2, 3)[:, None]
        outside = np.maximum(measured.min(axis=0) - shifted, shifted - measured.max(axis=0))
        beyond = np.maximum(outside, 0.0).min(axis=0)
        # As much of a slide as its measured range weighs as a radian.
        worst = int(np.argmax(np.where(turns, beyond, beyond / np.maximum(np.ptp(measured, axis=0), 1e-3))))
        name = robot.joint_names[worst] if beyond[worst] > 0 else ""
        return cls(float(near.max(axis=1).min()), name, float(beyond[worst]))

    def to_json(self) -> dict[str, Any]:
        return {"nearest": self.nearest, "joint": self.joint or None, "beyond": self.beyond}
