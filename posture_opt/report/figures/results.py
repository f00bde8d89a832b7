"""Which figures a result has, the most important one first: one function a class of results, of its name."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from posture_opt.report.figures import (
    plot_budget,
    plot_cloud,
    plot_cross_section,
    plot_joint_map,
    plot_solution,
    plot_spread,
)
from posture_opt.report.figures.accuracy import plot_bias, plot_spread_map
from posture_opt.report.figures.batch import plot_batch
from posture_opt.report.figures.map import plot_target_map
from posture_opt.report.figures.plan import plot_plan_errors, plot_plan_points
from posture_opt.uncertainty.cloud import cloud_of

if TYPE_CHECKING:
    from posture_opt.report.accuracy_map_report import AccuracyMapPresenter
    from posture_opt.report.batch_diagnosis_report import BatchDiagnosisPresenter
    from posture_opt.report.batch_report import BatchPresenter
    from posture_opt.report.cloud_report import CloudPresenter
    from posture_opt.report.measurement_plan_report import MeasurementPlanPresenter
    from posture_opt.report.presenter import Drawings
    from posture_opt.report.solution_report import SolutionPresenter
    from posture_opt.report.spread_report import SpreadPresenter
    from posture_opt.report.target_map_report import TargetMapPresenter

_DRAWN = 2000  # tool points


def solution(shown: SolutionPresenter) -> Drawings:
    """The arm; where there is a posture, its cloud across the direction, its budget, and a map of two joints."""
    found = shown.result
    drawings: Drawings = {"arm": partial(plot_solution, found)}
    if found.status == "infeasible":
        return drawings
    drawings["cloud"] = partial(plot_cross_section, found)
    drawings["budget"] = lambda: plot_budget(found.spread, found.budget, found.critical.worst_axis)
    if found.optimisation_problem.robot.n == 2:
        drawings["joint_map"] = partial(plot_joint_map, found)
    return drawings


def spread(shown: SpreadPresenter) -> Drawings:
    """The arm, a small cloud with the ellipse, the budget of the longest axis."""
    found = shown.result
    return {
        "arm": partial(plot_spread, found),
        "cloud": lambda: plot_cloud(cloud_of(found, _DRAWN, 0)),
        "budget": lambda: plot_budget(found, found.budget, found.axes[-1]),
    }


def cloud(shown: CloudPresenter) -> Drawings:
    """The cloud beside the closed form, and the arm."""
    return {"cloud": partial(plot_cloud, shown.result), "arm": partial(plot_spread, shown.result.spread)}


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
