"""Problems with the arm that a calibration or a diagnosis found, ready to be planned with and to be written."""

from __future__ import annotations

from posture_opt.calibration.calibration import Calibration
from posture_opt.diagnosis.diagnosis import Diagnosis
from posture_opt.problem.problem import Problem
from posture_opt.validation.calibrated_arm import calibrated_arm


def calibrated_problem(problem: Problem, calibration: Calibration) -> Problem:
    """The problem with the calibrated arm: its parameters, what is still uncertain of them, and its scatter.

    The arm is the one that fits the measurements: every deviation of ``calibration.x`` counts, those too that are
    determined together only. Frames that were found are numbers and no longer free; of several targets the first is
    the tool point. The covariance is the estimate's, under the scatter of repeats that the calibration leaves;
    that scatter comes to it. :meth:`Problem.files` writes it as a complete problem file with its covariance beside it.

    Raises:
        InputError: the calibration is one of another robot.
    """
    return problem.with_fit(calibrated_arm(problem, calibration))


def extended_problem(problem: Problem, diagnosis: Diagnosis) -> Problem:
    """The problem with the arm that the diagnosis fitted: geometry, effects, and what is uncertain of both together.

    Effects that change with time are left out: they belong to the session that was measured. So is noise of the
    instrument or of the data; that of a joint is an effect of the arm.

    Raises:
        InputError: the diagnosis is one of another robot.
    """
    return problem.with_fit(diagnosis.fitted_arm)
