"""The report on a diagnosis of several robots of one type: what they have in common, and how they differ.

Some causes show in a batch only: lengths of one production tool that vary together from robot to robot look like
independent errors of each robot alone.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, ClassVar

from posture_opt.diagnosis.diagnosis_statements import words as finding_words
from posture_opt.diagnosis.open_statements import uneven_statements
from posture_opt.model.effects.base.cause import FittedSizes
from posture_opt.problem.effects_section import of_a_type
from posture_opt.problem.fitted_problem import batch_yaml
from posture_opt.report.figures.batch import plot_batch
from posture_opt.report.page.presenter import Columns, Drawings, Presenter, problem_of
from posture_opt.report.page.save import Files
from posture_opt.report.results.batch_report import batch_facts, batch_report
from posture_opt.report.text.blocks import Block, Report, Summary, Table
from posture_opt.report.text.words import p_value

if TYPE_CHECKING:
    from posture_opt.batch.batch_diagnosis import BatchDiagnosis
    from posture_opt.selection.problem_data import ProblemData


def batch_diagnosis_report(found: BatchDiagnosis) -> Report:
    """The causes that a batch shows, and then the report on the batch itself.

    The first line names the causes, or says that there are none. "Uneven" errors, of which repeats are missing, follow
    with what to measure.
    """
    batch, problem = batch_report(found.batch), problem_of(found.batch)
    named = "; ".join(finding_words(f, problem) for f in found.effects)
    lead = f"Causes beyond the model: {named}." if named else "The model explains the data of these robots."
    if found.uneven and not named:
        lead = "The errors of these robots are uneven; the cause is not identifiable from these data."
    left = [one.text for one in uneven_statements(found.uneven)]
    return Report(problem.name or "Diagnosis", (lead, *left, *batch.lead[1:]), (_causes(problem, found), *batch.blocks))


def _causes(problem: ProblemData, found: BatchDiagnosis) -> Block:
    """Cause, size and p-value, one row a cause; a sentence where none is found."""
    if not found.effects:
        quiet = "" if found.uneven else ", and no joint is noisier than stated"
        return Block("Causes", (f"No lengths are significantly correlated{quiet}.",))
    rows = []
    for finding in found.effects:
        sizes = ", ".join(f"{size.label} {size}" for size in finding.cause.sizes(FittedSizes(finding.estimate)))
        rows.append((finding_words(finding, problem), sizes, p_value(finding.p_value)))
    text = "Correlated lengths cannot be identified from one robot alone."
    return Block("Causes", (Table(("cause", "size", "p-value"), tuple(rows), text_columns=3), text))


class BatchDiagnosisPresenter(Presenter["BatchDiagnosis"]):
    """What several robots of one type show together; ``uncertainty.yaml`` is the section for their problem file."""

    stem = "diagnosis"
    delivers: ClassVar[tuple[str, ...]] = ("uncertainty.yaml",)

    @property
    def problem(self) -> ProblemData:
        """The problem that the robots share."""
        return problem_of(self.result.batch)

    def summary(self) -> Summary:
        """Verdict, causes, and the first facts on the batch."""
        named = "; ".join(finding_words(f, self.problem) for f in self.result.effects) or "none"
        facts = (("Verdict", self.result.verdict), ("Causes", named), *batch_facts(self.result.batch)[:3])
        return Summary(f"Diagnosis of several robots of one type: {self.problem.name}", facts)

    def document(self) -> Report:
        return batch_diagnosis_report(self.result)

    def drawings(self) -> Drawings:
        """How two parameters vary together, where there are two."""
        found = self.result.batch
        return {"batch": partial(plot_batch, self.problem, found)} if found.pairs else {}

    def columns(self) -> Columns:
        """One row a cause: kind of the effect, joint or link that it acts on, p-value."""
        found = self.result.effects
        return {
            "kind": [f.kind for f in found],
            "target": [f.target for f in found],
            "p_value": [f.p_value for f in found],
        }

    def files(self) -> Files:
        """``uncertainty.yaml``: σ's, correlations and the scatter that was found, as a section for the problem file."""
        noises = [f.noise for f in self.result.effects if f.noise is not None]
        of_arm = [noise for noise in noises if noise.of_arm and not of_a_type(noise)]
        return {"uncertainty.yaml": batch_yaml(self.problem, self.result.batch, of_arm).encode()}
