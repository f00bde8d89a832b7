"""The files of ``--out``: JSON, report as text and as a page, figures as PNG and SVG."""

from __future__ import annotations

from collections.abc import Mapping
from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

from posture_opt.report.blocks import Report
from posture_opt.report.document import json_text
from posture_opt.report.html import report_html
from posture_opt.report.text import render

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from posture_opt.problem.problem import Problem
    from posture_opt.report.calibration_report import Learned
    from posture_opt.report.diagnosed import Diagnosed
    from posture_opt.selection.plan_comparison import Comparison
    from posture_opt.selection.solution import Solution
    from posture_opt.uncertainty.cloud import Cloud
    from posture_opt.uncertainty.spread import Spread

Files = dict[str, bytes]

RESIDUALS = ("vectors", "joints", "inputs", "region", "shape", "repeats")
TRUTH = ("truth_coverage", "truth_joints", "batch")
PLAN = ("plan_points", "plan_errors")
DIAGNOSIS = tuple(f"diagnosis_{name}" for name in ("curves", "errors", "periodogram", "left", "scores"))
MAPS = ("map", "map_bias", "map_spread")
FIGURES = (
    "arm",
    "cloud",
    "budget",
    "joint_map",
    "landing",
    *(f"residual_{name}" for name in RESIDUALS),
    *TRUTH,
    *PLAN,
    *MAPS,
    *DIAGNOSIS,
)
DOCUMENTS = (
    "solution.json",
    "spread.json",
    "calibration.json",
    "diagnosis.json",
    "plan.json",
    "map.json",
    "report.txt",
    "report.html",
)
CALIBRATED = tuple(
    f"{name}{end}" for name in ("calibrated", "extended") for end in (".yaml", "_covariance.csv", ".urdf")
)
OWN_FILES = frozenset(
    (
        *DOCUMENTS,
        *CALIBRATED,
        "cloud.csv",
        "plan_points.csv",
        "uncertainty.yaml",
        "map.csv",
        *(f"{name}.{kind}" for name in FIGURES for kind in ("png", "svg")),
    )
)
"""Every name that a report's files may have: of an earlier run they would speak of another problem.

``plan.csv`` and ``split_measurements.csv`` are not among them: by then they may hold what was measured.
"""


def write_solution(folder: Path, problem: Problem, solution: Solution, plots: bool = True) -> None:
    """Writes the files of a solution into ``folder``, which exists."""
    write_files(folder, solution_files(problem, solution, plots))


def write_spread(folder: Path, problem: Problem, spread: Spread, plots: bool = True) -> None:
    """Writes the files of the spread at one posture into ``folder``, which exists."""
    write_files(folder, spread_files(problem, spread, plots))


def write_cloud(folder: Path, problem: Problem, cloud: Cloud, plots: bool = True) -> None:
    """Writes the files of a simulation into ``folder``, which exists."""
    write_files(folder, cloud_files(problem, cloud, plots))


def write_calibration(folder: Path, problem: Problem, learned: Learned, plots: bool = True) -> None:
    """Writes the files of a calibration into ``folder``, which exists: the report and the calibrated arm."""
    from posture_opt.report.calibration_report import calibration_report

    document, figures = calibration_document(learned), _calibration_figures(problem, learned) if plots else {}
    files = report_files("calibration", document, calibration_report(problem, learned), figures, problem)
    if learned.calibrated is not None:
        files |= learned.calibrated.files("calibrated")
    write_files(folder, files)


def calibration_document(learned: Learned) -> dict[str, Any]:
    """The document ``calibration.json``."""
    document = learned.calibration.to_json()
    if learned.assessment is not None:
        document["assessment"] = learned.assessment.to_json()
    if learned.spread_check is not None:
        document["coverage95"] = learned.spread_check.coverage95
        document["spread_check"] = learned.spread_check.to_json()
    if learned.comparison is not None:
        document["posture"] = learned.comparison.to_json()
    return document


def write_diagnosis(folder: Path, problem: Problem, diagnosed: Diagnosed, plots: bool = True) -> None:
    """Writes the files of a diagnosis into ``folder``, which exists: the report and the extended arm."""
    from posture_opt.report.diagnosis_report import diagnosis_report
    from posture_opt.report.split_blocks import FILE, split_csv

    figures: Mapping[str, Figure] = {}
    if plots:
        from posture_opt.report.figures.diagnosis import diagnosis_figures

        figures = diagnosis_figures(diagnosed)
        figures = {**figures, **_landing(diagnosed.comparison)}
    report = diagnosis_report(problem, diagnosed)
    files = report_files("diagnosis", diagnosis_document(diagnosed), report, figures, problem)
    if diagnosed.extended is not None:
        files |= diagnosed.extended.files("extended")
    if further := split_csv(diagnosed):
        files[FILE] = further.encode()
    write_files(folder, files)


def diagnosis_document(diagnosed: Diagnosed) -> dict[str, Any]:
    """The document ``diagnosis.json``."""
    document = diagnosed.diagnosis.to_json()
    if diagnosed.comparison is not None:
        goals = {} if diagnosed.goals is None else {"goals": diagnosed.goals.to_json()}
        document["posture"] = goals | diagnosed.comparison.to_json()
    return document


def solution_files(problem: Problem, solution: Solution, plots: bool = True) -> Files:
    """File name -> content of a solution: solution.json, report.txt, report.html and the figures."""
    from posture_opt.report.solution_report import solution_report

    figures = _solution_figures(solution) if plots else {}
    return report_files("solution", solution.to_json(), solution_report(problem, solution), figures, problem)


def spread_files(problem: Problem, spread: Spread, plots: bool = True) -> Files:
    """File name -> content of the spread at one posture: spread.json, report.txt, report.html and the figures."""
    from posture_opt.report.spread_report import spread_report

    figures = _spread_figures(spread) if plots else {}
    return report_files("spread", spread.to_json(), spread_report(problem, spread), figures, problem)


def cloud_files(problem: Problem, cloud: Cloud, plots: bool = True) -> Files:
    """File name -> content of a simulation: spread.json (of the sample), cloud.csv, reports and figures."""
    from posture_opt.report.cloud_report import cloud_report

    figures = _cloud_figures(cloud) if plots else {}
    files = report_files("spread", cloud.to_json(), cloud_report(problem, cloud), figures, problem)
    return {**files, "cloud.csv": _points(cloud)}


def report_files(
    name: str, document: dict[str, Any], report: Report, figures: Mapping[str, Figure], problem: Problem
) -> Files:
    """File name -> content of a report: its document as ``{name}.json``, report.txt, report.html, the figures."""
    from posture_opt import __version__

    files = {f"{name}.json": (json_text(document) + "\n").encode(), "report.txt": render(report).encode()}
    images: dict[str, bytes] = {}
    if figures:
        from posture_opt.report.style import image

        images = {figure: image(drawn, "png") for figure, drawn in figures.items()}
        files |= {f"{figure}.png": data for figure, data in images.items()}
        files |= {f"{figure}.svg": image(drawn, "svg") for figure, drawn in figures.items()}
    return {**files, "report.html": report_html(report, images, __version__, problem.to_yaml()).encode()}


def _solution_figures(solution: Solution) -> dict[str, Figure]:
    from posture_opt.report import figures

    drawn = {"arm": figures.plot_solution(solution)}
    if solution.status == "infeasible":
        return drawn
    drawn["cloud"] = figures.plot_cross_section(solution)
    drawn["budget"] = figures.plot_budget(solution.spread, solution.budget, solution.critical.worst_axis)
    if solution.optimisation_problem.robot.n == 2:
        drawn["joint_map"] = figures.plot_joint_map(solution)
    return drawn


def _spread_figures(spread: Spread) -> dict[str, Figure]:
    from posture_opt.report import figures
    from posture_opt.uncertainty.cloud import cloud_of

    return {
        "arm": figures.plot_spread(spread),
        "cloud": figures.plot_cloud(cloud_of(spread, 2000, 0)),
        "budget": figures.plot_budget(spread, spread.budget, spread.axes[-1]),
    }


def _cloud_figures(cloud: Cloud) -> dict[str, Figure]:
    from posture_opt.report import figures

    return {"arm": figures.plot_spread(cloud.spread), "cloud": figures.plot_cloud(cloud)}


def _calibration_figures(problem: Problem, learned: Learned) -> dict[str, Figure]:
    from posture_opt.report.figures.residuals import residual_figures

    figures = residual_figures(problem, learned)
    if learned.spread_check is not None:
        from posture_opt.report.figures.truth import truth_figures

        figures |= truth_figures(learned.spread_check)
    return figures | _landing(learned.comparison)


def _landing(comparison: Comparison | None) -> dict[str, Figure]:
    """The figure of a comparison in which the model before calibration and the reference have a posture."""
    if comparison is None or not {"nominal", comparison.reference} <= set(comparison.answered):
        return {}
    from posture_opt.report.figures.landing import plot_landing

    return {"landing": plot_landing(comparison)}


def _points(cloud: Cloud) -> bytes:
    """The simulated tool points in mm."""
    import numpy as np

    text = StringIO()
    np.savetxt(text, 1e3 * cloud.points, fmt="%.6f", delimiter=", ", header="x [mm], y [mm], z [mm]", comments="")
    return text.getvalue().encode()


def write_files(folder: Path, files: Files) -> None:
    """Writes the files, by name, into ``folder``, which exists."""
    for name, content in files.items():
        (folder / name).write_bytes(content)
