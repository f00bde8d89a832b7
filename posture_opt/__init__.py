"""Pick the robot posture whose position scatter hurts the task least.

::

    problem.yaml ─ load_problem ──────> problem ─ select_posture ─> solution   the best posture, with its reasons
    {name: problem} ─ select_postures ─> postures    the same of many problems, on all cores or a cluster
    {...} ──────── problem_from_dict ─> problem ─ propagate ──────> spread     closed form at one posture
                                        problem ─ simulate ───────> cloud      Monte Carlo at one posture
                                        problem ─ PostureSelector              built once, solved again and again
                                        problem ─ map_targets ─────> map       the best posture over a grid of targets
                                        problem ─ SpreadFunction               covariances of many postures
                                        problem ─ export_files ─> files        for controllers, simulators, own code
                                        problem ─ Arm.from_problem             CasADi expressions of one's own
    data.csv ───── read_measurements ─> data
    problem, data ─ calibrate ────────> calibration  the parameters of the arm, with what the data determine
                                        problem ─ plan_measurements ─> plan    the postures to measure next
    problem, data ─ calibrate_batch ──> batch        several robots of a type, and how they differ
    problem, data ─ recheck ──────────> recheck      what changed on a calibrated arm since
    calibration ── assess ────────────> assessment   what the model gets wrong, and whether the rest is scatter
    calibration ── check_spread ──────> check        is the predicted spread true?
    problem, data ─ map_accuracy ─────> map          bias and spread over a grid of targets, beside what was measured
    targets.csv ── compensate ────────> compensation  joint values that bring this arm to the targets
    {name: problem} ─ compare ────────> comparison   one task for several arms, each answer judged by the others
    {name: problem} ─ compare_plans ──> comparison   what models of one arm choose for its task
    calibration ── problem.with_fit ──> problem      the calibrated arm, to be planned with

Inside everything is SI and radians. Wrong input raises ``errors.InputError``, an unsolvable problem
``errors.NoSolutionError``; all exceptions derive from ``errors.PostureOptError``.
"""

from __future__ import annotations

import warnings
from functools import partial
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from posture_opt import errors
    from posture_opt.batch.batch_calibration import Batch, calibrate_batch
    from posture_opt.batch.batch_diagnosis import BatchDiagnosis, diagnose_batch
    from posture_opt.calibration.calibrate import calibrate
    from posture_opt.calibration.calibration import Calibration
    from posture_opt.changes.check_again import recheck
    from posture_opt.changes.what_changed import Recheck
    from posture_opt.compensation.compensate import compensate
    from posture_opt.compensation.compensation import Compensation
    from posture_opt.diagnosis.diagnose import diagnose
    from posture_opt.diagnosis.diagnosis import Diagnosis
    from posture_opt.experiments.measurement_plan import MeasurementPlan
    from posture_opt.experiments.plan_measurements import plan_measurements
    from posture_opt.export.export_files import export_files
    from posture_opt.export.export_format import Exported
    from posture_opt.measurements.measurements import Measurements
    from posture_opt.measurements.reading import read_measurements
    from posture_opt.model.arm import Arm
    from posture_opt.problem.fitted_problem import calibrated_problem, extended_problem
    from posture_opt.problem.load import load_problem, problem_from_dict
    from posture_opt.problem.problem import Problem
    from posture_opt.robot.robot import Robot
    from posture_opt.selection.answer.selector import PostureSelector
    from posture_opt.selection.answer.solution import Solution
    from posture_opt.selection.comparison.compare import compare, compare_plans
    from posture_opt.selection.comparison.comparison import Comparison
    from posture_opt.selection.maps.target_map import TargetMap, map_targets
    from posture_opt.selection.posture_batch import PostureBatch, select_postures
    from posture_opt.selection.select_posture import select_posture
    from posture_opt.selection.tasks.task import Task
    from posture_opt.uncertainty.cloud import Cloud, simulate
    from posture_opt.uncertainty.spread import Spread, propagate
    from posture_opt.uncertainty.spread_function import SpreadFunction
    from posture_opt.validation.accuracy_map import AccuracyMap, map_accuracy
    from posture_opt.validation.assessment import Assessment, assess
    from posture_opt.validation.spread_check import SpreadCheck, check_spread

    ArmComparison = Comparison
    FeaturesSolution = PathSolution = Solution

__version__ = "0.1.0"

__all__ = [
    "AccuracyMap",
    "Arm",
    "Assessment",
    "Batch",
    "BatchDiagnosis",
    "Calibration",
    "Cloud",
    "Comparison",
    "Compensation",
    "Diagnosis",
    "Exported",
    "MeasurementPlan",
    "Measurements",
    "PostureBatch",
    "PostureSelector",
    "Problem",
    "Recheck",
    "Robot",
    "Solution",
    "Spread",
    "SpreadCheck",
    "SpreadFunction",
    "TargetMap",
    "Task",
    "__version__",
    "assess",
    "calibrate",
    "calibrate_batch",
    "calibrated_problem",
    "check_spread",
    "compare",
    "compare_plans",
    "compensate",
    "diagnose",
    "diagnose_batch",
    "errors",
    "export_files",
    "extended_problem",
    "load_problem",
    "map_accuracy",
    "map_targets",
    "plan_measurements",
    "problem_from_dict",
    "propagate",
    "read_measurements",
    "recheck",
    "select_posture",
    "select_postures",
    "simulate",
]

_HOMES = {
    # A name is imported when it is first used: `import posture_opt` and `--help` need none of CasADi.
    "AccuracyMap": "validation.accuracy_map",
    "Arm": "model.arm",
    "Assessment": "validation.assessment",
    "Batch": "batch.batch_calibration",
    "BatchDiagnosis": "batch.batch_diagnosis",
    "Calibration": "calibration.calibration",
    "Cloud": "uncertainty.cloud",
    "Compensation": "compensation.compensation",
    "Comparison": "selection.comparison.comparison",
    "Diagnosis": "diagnosis.diagnosis",
    "Exported": "export.export_format",
    "MeasurementPlan": "experiments.measurement_plan",
    "Measurements": "measurements.measurements",
    "PostureBatch": "selection.posture_batch",
    "PostureSelector": "selection.answer.selector",
    "Problem": "problem.problem",
    "Recheck": "changes.what_changed",
    "Robot": "robot.robot",
    "Solution": "selection.answer.solution",
    "Spread": "uncertainty.spread",
    "SpreadCheck": "validation.spread_check",
    "SpreadFunction": "uncertainty.spread_function",
    "TargetMap": "selection.maps.target_map",
    "Task": "selection.tasks.task",
    "assess": "validation.assessment",
    "calibrate": "calibration.calibrate",
    "calibrate_batch": "batch.batch_calibration",
    "calibrated_problem": "problem.fitted_problem",
    "check_spread": "validation.spread_check",
    "compare": "selection.comparison.compare",
    "compare_plans": "selection.comparison.compare",
    "compensate": "compensation.compensate",
    "diagnose": "diagnosis.diagnose",
    "diagnose_batch": "batch.batch_diagnosis",
    "export_files": "export.export_files",
    "extended_problem": "problem.fitted_problem",
    "load_problem": "problem.load",
    "map_accuracy": "validation.accuracy_map",
    "map_targets": "selection.maps.target_map",
    "plan_measurements": "experiments.plan_measurements",
    "problem_from_dict": "problem.load",
    "propagate": "uncertainty.spread",
    "read_measurements": "measurements.reading",
    "recheck": "changes.check_again",
    "select_posture": "selection.select_posture",
    "select_postures": "selection.posture_batch",
    "simulate": "uncertainty.cloud",
}

_RENAMED = {"ArmComparison": "Comparison", "FeaturesSolution": "Solution", "PathSolution": "Solution"}
"""Names of before -> what they are now; they are importable for one release."""


def __getattr__(name: str) -> Any:
    if name == "errors":
        return import_module("posture_opt.errors")
    if name in _RENAMED:
        new = _RENAMED[name]
        warnings.warn(f"posture_opt.{name} is posture_opt.{new} now", DeprecationWarning, stacklevel=2)
        return getattr(import_module(f"posture_opt.{_HOMES[new]}"), new)
    if name not in _HOMES:
        raise AttributeError(f"module 'posture_opt' has no attribute '{name}'")
    value = getattr(import_module(f"posture_opt.{_HOMES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


_PRESENTED_IN = {
    **dict.fromkeys(("TargetMap", "AccuracyMap"), "map"),
    **dict.fromkeys(("Assessment", "SpreadCheck"), "assessment"),
    **dict.fromkeys(("Batch", "BatchDiagnosis"), "batch"),
    **dict.fromkeys(("Spread", "Cloud"), "spread"),
    **dict.fromkeys(("MeasurementPlan", "Recheck"), "plan"),
    **dict.fromkeys(("Problem", "Measurements"), "input"),
    "PostureBatch": "posture_batch",
}
"""Results whose presenter is not in the file of their own name: ``TargetMap`` is in ``map_report.py``."""


def presenter_of(result: object) -> Any:
    """``TargetMap`` is presented by ``TargetMapPresenter`` of a file in ``report/results``."""
    name = type(result).__name__
    file = _PRESENTED_IN.get(name, name.lower())
    return getattr(import_module(f"posture_opt.report.results.{file}_report"), f"{name}Presenter")(result)


def evaluation_of(calibration: Calibration) -> Any:
    """What the predictions of a calibration are held against."""
    return import_module("posture_opt.validation.calibrated_arm").Evaluation(calibration)


def explorer_of(problem: Problem) -> Any:
    """What starts the live page of a problem."""
    return partial(import_module("posture_opt.explore.explorer").explore, problem)
