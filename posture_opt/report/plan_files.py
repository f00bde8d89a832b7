"""The files of a measurement plan: the postures for the robot, where its tool comes to lie, and the report."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from posture_opt.report.plan_report import plan_report
from posture_opt.report.units_text import fixed
from posture_opt.report.write import Files, report_files, write_files

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from posture_opt.experiments.measurement_plan import MeasurementPlan
    from posture_opt.problem.problem import Problem


def write_plan(folder: Path, problem: Problem, plan: MeasurementPlan, plots: bool = True) -> None:
    """Writes the files of a plan into ``folder``, which exists."""
    write_files(folder, plan_files(problem, plan, plots))


def plan_files(problem: Problem, plan: MeasurementPlan, plots: bool = True) -> Files:
    """File name -> content: plan.csv, plan_points.csv, plan.json, reports and figures."""
    figures = _figures(plan) if plots else {}
    files = report_files("plan", plan.to_json(), plan_report(problem, plan), figures, problem)
    return {**files, "plan.csv": plan.to_csv().encode(), "plan_points.csv": points_csv(plan).encode()}


def points_csv(plan: MeasurementPlan) -> str:
    """Where the nominal tool point comes to lie, world [mm], for the eye and for the instrument."""
    rows = [f"{k}, {', '.join(fixed(1e3 * float(v)) for v in point)}" for k, point in enumerate(plan.points, start=1)]
    return "\n".join(["posture, x [mm], y [mm], z [mm]", *rows]) + "\n"


def _figures(plan: MeasurementPlan) -> dict[str, Figure]:
    from posture_opt.report.figures.plan import plot_plan_errors, plot_plan_points

    return {"plan_points": plot_plan_points(plan), "plan_errors": plot_plan_errors(plan)}
