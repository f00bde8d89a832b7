"""The files of a batch: calibration.json, the section for the problem file, report and figure."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from posture_opt.report.write import Files, report_files, write_files

if TYPE_CHECKING:
    from posture_opt.batch.batch_calibration import Batch
    from posture_opt.measurements.measurements import Measurements
    from posture_opt.problem.problem import Problem


def write_batch(folder: Path, problem: Problem, data: Measurements, found: Batch, plots: bool = True) -> None:
    """Writes the files of a batch into ``folder``, which exists."""
    write_files(folder, batch_files(problem, data, found, plots))


def batch_files(problem: Problem, data: Measurements, found: Batch, plots: bool = True) -> Files:
    """File name -> content: calibration.json, uncertainty.yaml, report.txt, report.html and the figure."""
    from posture_opt.problem.batch_section import batch_yaml
    from posture_opt.report.batch_report import batch_report

    figures = {}
    if plots and found.pairs:
        from posture_opt.report.figures.batch import plot_batch

        figures["batch"] = plot_batch(problem, found)
    files = report_files("calibration", found.to_json(), batch_report(problem, data, found), figures, problem)
    return {**files, "uncertainty.yaml": batch_yaml(problem, found).encode()}
