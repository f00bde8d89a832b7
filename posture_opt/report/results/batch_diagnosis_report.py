"""The report on a diagnosis of several robots of one type: what they have in common, and how they differ.

Some causes show in a batch only: lengths of one production tool that vary together from robot to robot look like
independent errors of each robot alone.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, ClassVar

from posture_opt.model.effects.base.cause import FittedSizes
from posture_opt.problem.effects_section import of_a_type
from posture_opt.problem.fitted_problem import batch_yaml
from posture_opt.report.figures.batch import plot_batch
from posture_opt.report.page.presenter import Columns, Drawings, Presenter, problem_of
from posture_opt.report.page.save import Files
from posture_opt.report.results.batch_report import batch_blocks, batch_facts
from posture_opt.report.text.blocks import Block, Document, Summary, Table
from posture_opt.statements import p_value

if TYPE_CHECKING:
    from posture_opt.batch.batch_diagnosis import BatchDiagnosis
    from posture_opt.selection.problem_data import ProblemData


def _causes(found: BatchDiagnosis) -> Block:
    """Cause, size and p-value, one row a cause."""
    rows = []
    for finding in found.effects:
        sizes = ", ".join(f"{size.label} {size}" for size in finding.cause.sizes(FittedSizes(finding.estimate)))
        rows.append((finding.cause.label, sizes, p_value(finding.p_value)))
    table = Table(("cause", "size", "p-value"), tuple(rows), text_columns=3)
    return Block("Causes", (table,) if rows else ())


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
        named = "; ".join(f.cause.label for f in self.result.effects) or "none"
        facts = (("Verdict", self.result.verdict), ("Causes", named), *batch_facts(self.result.batch)[:3])
        return Summary(f"Diagnosis of several robots of one type: {self.problem.name}", facts)

    def document(self) -> Document:
        """The causes that a batch shows, and then the report on the batch itself."""
        found = self.result
        blocks = (_causes(found), *batch_blocks(found.batch))
        return Document(self.problem.name or "Diagnosis", found.statements, blocks)

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
