"""The report on a diagnosis of several robots of one type: what they have in common, and how they differ."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from posture_opt.model.effects.cause import FittedSizes
from posture_opt.report.batch_report import batch_report
from posture_opt.report.blocks import Block, Report, Table
from posture_opt.report.finding_words import finding_words
from posture_opt.report.words import p_value
from posture_opt.report.write import report_files, write_files

if TYPE_CHECKING:
    from posture_opt.batch.batch_diagnosis import BatchDiagnosis
    from posture_opt.measurements.measurements import Measurements
    from posture_opt.problem.problem import Problem


def batch_diagnosis_report(problem: Problem, data: Measurements, found: BatchDiagnosis) -> Report:
    """The causes that a batch shows, and then the batch itself."""
    batch = batch_report(problem, data, found.batch)
    named = "; ".join(finding_words(f, problem) for f in found.findings)
    lead = f"What the model does not say of these robots: {named}." if named else "The robots are what the model says."
    return Report(problem.name or "Diagnosis", (lead, *batch.lead[1:]), (_causes(problem, found), *batch.blocks))


def _causes(problem: Problem, found: BatchDiagnosis) -> Block:
    if not found.findings:
        return Block("Causes", ("No lengths vary together, and no joint is noisier than stated, beyond chance.",))
    rows = []
    for finding in found.findings:
        sizes = ", ".join(f"{size.label} {size}" for size in finding.cause.sizes(FittedSizes(finding.estimate)))
        rows.append((finding_words(finding, problem), sizes, p_value(finding.p_value)))
    text = (
        "One robot alone cannot show lengths that vary together: a long link and a long neighbour are simply its links."
    )
    return Block("Causes", (Table(("cause", "size", "p-value"), tuple(rows), text_columns=3), text))


def write_batch_diagnosis(
    folder: Path, problem: Problem, data: Measurements, found: BatchDiagnosis, plots: bool = True
) -> None:
    """Writes diagnosis.json, the reports, the section for the problem file and the figure into ``folder``."""
    from posture_opt.problem.batch_section import batch_yaml
    from posture_opt.problem.noise_section import of_a_type

    figures = {}
    if plots and found.batch.pairs:
        from posture_opt.report.figures.batch import plot_batch

        figures["batch"] = plot_batch(problem, found.batch)
    report = batch_diagnosis_report(problem, data, found)
    files = report_files("diagnosis", found.to_json(), report, figures, problem)
    noises = [f.noise for f in found.findings if f.noise is not None and f.noise.of_arm and not of_a_type(f.noise)]
    write_files(folder, {**files, "uncertainty.yaml": batch_yaml(problem, found.batch, noises).encode()})
