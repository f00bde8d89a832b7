"""Which figures a result has, the most important one first: one function a class of results, of its name."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, cast

from posture_opt.report.figures import (
    plot_budget,
    plot_cloud,
    plot_cross_section,
    plot_joint_map,
    plot_solution,
    plot_spread,
)
from posture_opt.report.figures.accuracy_map import plot_bias, plot_spread_map
from posture_opt.report.figures.arm import plot_motion
from posture_opt.report.figures.arm_comparison import plot_arm_comparison
from posture_opt.report.figures.axis_names import critical_axis, with_letter
from posture_opt.report.figures.batch import plot_batch
from posture_opt.report.figures.bench import plot_bench
from posture_opt.report.figures.comparison import plot_landing
from posture_opt.report.figures.compensation import plot_compensation
from posture_opt.report.figures.diagnosis import plot_errors, plot_periodogram
from posture_opt.report.figures.diagnosis_curves import plot_curves, plot_left
from posture_opt.report.figures.diagnosis_scores import plot_scores
from posture_opt.report.figures.path import plot_path
from posture_opt.report.figures.plan import plot_plan_errors, plot_plan_points
from posture_opt.report.figures.posture_batch import plot_posture_batch
from posture_opt.report.figures.residual_scatter import plot_region, plot_repeats, plot_shape
from posture_opt.report.figures.residual_trends import plot_residuals_over_inputs, plot_residuals_over_joints
from posture_opt.report.figures.residuals import Shown, plot_residual_vectors
from posture_opt.report.figures.spread_check import plot_joint_scatter, plot_reliability
from posture_opt.report.figures.target_map import plot_target_map
from posture_opt.report.parts.diagnosis_sizes import fitted_effects, periodic_joints
from posture_opt.uncertainty.simulation.cloud import cloud_of

if TYPE_CHECKING:
    from posture_opt.problem.problem import Problem
    from posture_opt.report.page.presenter import Drawings
    from posture_opt.report.results.accuracy_map_report import AccuracyMapPresenter
    from posture_opt.report.results.arm_comparison_report import ArmComparisonPresenter
    from posture_opt.report.results.assessment_report import AssessmentPresenter
    from posture_opt.report.results.batch_diagnosis_report import BatchDiagnosisPresenter
    from posture_opt.report.results.batch_report import BatchPresenter
    from posture_opt.report.results.calibration_report import CalibrationPresenter
    from posture_opt.report.results.cloud_report import CloudPresenter
    from posture_opt.report.results.comparison_report import ComparisonPresenter
    from posture_opt.report.results.compensation_report import CompensationPresenter
    from posture_opt.report.results.diagnosis_report import DiagnosisPresenter
    from posture_opt.report.results.features_solution_report import FeaturesSolutionPresenter
    from posture_opt.report.results.measurement_plan_report import MeasurementPlanPresenter
    from posture_opt.report.results.path_solution_report import PathSolutionPresenter
    from posture_opt.report.results.posture_batch_report import PostureBatchPresenter
    from posture_opt.report.results.solution_report import SolutionPresenter
    from posture_opt.report.results.spread_check_report import SpreadCheckPresenter
    from posture_opt.report.results.spread_report import SpreadPresenter
    from posture_opt.report.results.target_map_report import TargetMapPresenter
    from posture_opt.selection.comparison.plan_comparison import Comparison
    from posture_opt.validation.assessment import Assessment
    from posture_opt.validation.spread_check import SpreadCheck

_DRAWN = 2000  # tool points


def solution(shown: SolutionPresenter) -> Drawings:
    """The arm; where there is a posture, its cloud across the direction, its budget, and a map of two joints."""
    found = shown.result
    drawings: Drawings = {"arm": partial(plot_solution, found)}
    if found.status == "infeasible":
        return drawings
    drawings["cloud"] = partial(plot_cross_section, found.spread, found.task_spread)
    drawings["budget"] = lambda: plot_budget(
        found.spread, found.task_spread.budget_groups, critical_axis(found.critical)
    )
    if found.optimisation_problem.robot.n == 2:
        drawings["joint_map"] = partial(plot_joint_map, found)
    return drawings


def path_solution(shown: PathSolutionPresenter) -> Drawings:
    """Spread and joints along the path; the arm at its worst point and at others."""
    found = shown.result
    return {
        "path": partial(plot_path, found),
        "arm": partial(plot_motion, found),
        "budget": lambda: plot_budget(
            found.worst.spread, found.worst.task_spread.budget_groups, critical_axis(found.worst.critical)
        ),
    }


def features_solution(shown: FeaturesSolutionPresenter) -> Drawings:
    """The bench with the placement, where there is a choice; the arm at the first feature; the worst one's cloud and
    budget.
    """
    found = shown.result
    if not found.stations:
        return {}
    arm: Drawings = {"arm": partial(plot_solution, found.stations[0])}
    if found.status == "infeasible":
        return arm
    worst = found.stations[found.worst]
    budget = lambda: plot_budget(worst.spread, worst.task_spread.budget_groups, critical_axis(worst.critical))  # noqa: E731
    bench: Drawings = {"bench": partial(plot_bench, found)} if found.placement.free.sum() > 1 else {}
    return {**bench, **arm, "cloud": partial(plot_cross_section, worst.spread, worst.task_spread), "budget": budget}


def spread(shown: SpreadPresenter) -> Drawings:
    """The arm, a small cloud with the ellipse, the budget of the axis that counts most."""
    found = shown.result
    seen, arm = found.for_task, partial(plot_spread, found)
    if seen is None:
        drawn = lambda: plot_cloud(cloud_of(found, _DRAWN, 0))  # noqa: E731
        longest = with_letter("along the longest axis of the scatter", found.axes[-1])
        return {"arm": arm, "cloud": drawn, "budget": lambda: plot_budget(found, found.budget_groups, longest)}
    return {
        "arm": arm,
        "cloud": partial(plot_cross_section, found, seen, origin="nominal point"),
        "budget": lambda: plot_budget(found, seen.budget_groups, critical_axis(seen.critical)),
    }


def cloud(shown: CloudPresenter) -> Drawings:
    """The cloud beside the closed form, and the arm."""
    return {"cloud": partial(plot_cloud, shown.result), "arm": partial(plot_spread, shown.result.spread)}


def compensation(shown: CompensationPresenter) -> Drawings:
    """What every target is missed by, before and after."""
    return {"compensation": partial(plot_compensation, shown.result)}


def target_map(shown: TargetMapPresenter) -> Drawings:
    """The map."""
    return {"map": partial(plot_target_map, shown.result)}


def accuracy_map(shown: AccuracyMapPresenter) -> Drawings:
    """The mean error, where there are corrections, and the spread."""
    found = shown.result
    bias: Drawings = {"map_bias": partial(plot_bias, found)} if found.corrected else {}
    return {**bias, "map_spread": partial(plot_spread_map, found)}


def measurement_plan(shown: MeasurementPlanPresenter) -> Drawings:
    """Where the tool goes, and what that will tell."""
    return {
        "plan_points": partial(plot_plan_points, shown.result),
        "plan_errors": partial(plot_plan_errors, shown.result),
    }


def batch(shown: BatchPresenter) -> Drawings:
    """How two parameters vary together, where there are two."""
    found = shown.result
    return {"batch": partial(plot_batch, shown.problem, found)} if found.pairs else {}


def batch_diagnosis(shown: BatchDiagnosisPresenter) -> Drawings:
    """As of the calibrated batch."""
    found = shown.result.batch
    return {"batch": partial(plot_batch, shown.problem, found)} if found.pairs else {}


def calibration(shown: CalibrationPresenter) -> Drawings:
    """Residuals, whether the predicted spread is true, and where the old and the new posture land."""
    return {
        **_assessed(shown.assessment),
        **_checked(shown.spread_check),
        **_landing(shown.comparison),
    }


def assessment(shown: AssessmentPresenter) -> Drawings:
    """Residuals over everything that they may depend on."""
    return _assessed(shown.result)


def spread_check(shown: SpreadCheckPresenter) -> Drawings:
    """Coverage of the predicted regions, and the scatter of the joints."""
    return _checked(shown.result)


def comparison(shown: ComparisonPresenter) -> Drawings:
    """Where the tool lands in the posture of each model."""
    return _landing(shown.result)


def arm_comparison(shown: ArmComparisonPresenter) -> Drawings:
    """Where the postures of all arms land, as each of them predicts it."""
    return {"arm_comparison": partial(plot_arm_comparison, shown.result)}


def posture_batch(shown: PostureBatchPresenter) -> Drawings:
    """The spread of every answer."""
    return {"answers": partial(plot_posture_batch, shown.result)}


def diagnosis(shown: DiagnosisPresenter) -> Drawings:
    """Each named effect with the errors behind it; errors by model, scores, and what is left."""
    found = shown.result
    drawings: Drawings = {
        "diagnosis_curves": partial(plot_curves, found),
        "diagnosis_scores": partial(plot_scores, found),
        "diagnosis_errors": partial(plot_errors, found),
        "diagnosis_periodogram": partial(plot_periodogram, found),
        "diagnosis_left": partial(plot_left, found),
    }
    absent = {
        "diagnosis_curves": not fitted_effects(found),
        "diagnosis_periodogram": not periodic_joints(found),
        "diagnosis_left": found.verdict != "unexplained",
    }
    drawn = {name: draw for name, draw in drawings.items() if not absent.get(name)}
    return {**drawn, **_landing(shown.comparison)}


def _assessed(found: Assessment) -> Drawings:
    rows = Shown.of(found.calibration)
    drawings: Drawings = {
        "residual_vectors": partial(plot_residual_vectors, rows),
        "residual_joints": partial(plot_residuals_over_joints, rows),
        "residual_inputs": partial(plot_residuals_over_inputs, rows),
    }
    if found.residual_scatter is not None:
        drawings["residual_region"] = partial(plot_region, rows, found)
        drawings["residual_shape"] = partial(plot_shape, rows)
    if found.repeats is not None:
        problem = cast("Problem", found.calibration.request.problem)
        drawings["residual_repeats"] = partial(plot_repeats, problem, rows, found)
    return drawings


def _checked(found: SpreadCheck) -> Drawings:
    joints: Drawings = {} if found.noise is None else {"truth_joints": partial(plot_joint_scatter, found)}
    return {"truth_coverage": partial(plot_reliability, found), **joints}


def _landing(found: Comparison | None) -> Drawings:
    """A comparison in which the model before calibration and the reference have a posture."""
    if found is None or not {"nominal", found.reference} <= set(found.answered):
        return {}
    return {"predicted_error": partial(plot_landing, found)}
