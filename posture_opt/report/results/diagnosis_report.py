"""The report on a diagnosis: its statements, with the tables of causes, errors, rivals and candidates.

Three models are compared throughout: the arm of the file, the arm with fitted geometry, and the arm with the effects
that were found. Errors are of held-out rows.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import ClassVar

from posture_opt.diagnosis.diagnosis import Diagnosis
from posture_opt.diagnosis.diagnosis_statements import words
from posture_opt.report.figures.diagnosis import plot_errors, plot_periodogram
from posture_opt.report.figures.diagnosis_curves import plot_curves, plot_left
from posture_opt.report.figures.diagnosis_scores import plot_scores
from posture_opt.report.interactive.arm_view import ArmView, ShownPosture
from posture_opt.report.interactive.error_marks import cause_marks, task_posture
from posture_opt.report.measured_parts.diagnosis_tables import (
    MODELS,
    candidates_table,
    causes_table,
    each_cause,
    errors_table,
    goals_tables,
    split_tables,
    test_tables,
    view_key,
)
from posture_opt.report.measured_parts.error_table import instrument_words, mm, rows_words
from posture_opt.report.measured_parts.split_file import FILE, split_csv
from posture_opt.report.page.presenter import Columns, Drawings, Presenter, problem_of
from posture_opt.report.page.save import Files
from posture_opt.report.parts.comparison_parts import comparison_blocks
from posture_opt.report.parts.parts import robot_facts
from posture_opt.report.results.comparison_report import comparison_drawings
from posture_opt.report.text.blocks import Block, Document, Facts, Later, Summary

_MAX_NAMED_CAUSES = 3


def diagnosis_document(found: Diagnosis) -> Document:
    """The statements of a diagnosis, and its tables, a block a question."""
    problem, data = problem_of(found), found.request.data
    test, goals, split = found.test, found.goals, found.split
    facts = (
        *robot_facts(problem),
        ("File", Path(data.file).name or "table"),
        ("Rows", rows_words(data, problem.robot)),
        ("Instrument", instrument_words(problem, data)),
        ("Held out", f"{found.by}, in {found.rounds} rounds"),
    )
    blocks = (
        Block("Causes", (causes_table(found),) if found.effects else (), stays=True),
        Block("Each cause", each_cause(found), "diagnosis_curves" if found.fitted_effects else "", brief=()),
        Block("Periodic joint errors", (), "diagnosis_periodogram" if found.periodic_joints else "", brief=()),
        Block("Gain from the causes found", Later(lambda: (errors_table(found),)), "diagnosis_errors", brief=()),
        Block("On the test file", () if test is None else test_tables(found, test), brief=()),
        *comparison_blocks(found.comparison, MODELS),
        Block("Comparison of plans, as measured", () if goals is None else goals_tables(goals), brief=()),
        Block("Causes that could be confused", (), brief=()),
        Block(
            "Measurements that discriminate between causes",
            () if split is None else split_tables(found, split),
            brief=(),
        ),
        Block("Unexplained structure", (), "diagnosis_left" if found.verdict == "unexplained" else "", brief=()),
        Block("Candidates", (candidates_table(found),), "diagnosis_scores", brief=()),
        Block("What these data cannot show", (), brief=()),
        Block("What no data of this kind can show", (), brief=()),
        Block("Data", (Facts(facts),), brief=()),
    )
    return Document(problem.name or "Diagnosis", found.statements, blocks)


class DiagnosisPresenter(Presenter[Diagnosis]):
    """A diagnosis with the task planned again by the arm that was found; ``extended.yaml`` is that arm."""

    stem = "diagnosis"
    delivers: ClassVar[tuple[str, ...]] = ("extended.yaml",)

    def summary(self) -> Summary:
        """Verdict, the first causes, and the RMS error by model."""
        found = self.result
        errors = ", ".join(f"{mm(found.errors[name].rms)} mm {text}" for name, text in MODELS.items())
        named = [words(f, found.problem) for f in found.effects]
        more = f"; and {len(named) - _MAX_NAMED_CAUSES} more" if len(named) > _MAX_NAMED_CAUSES else ""
        facts = (
            ("Verdict", found.verdict.replace("_", " ")),
            ("Causes", "; ".join(named[:_MAX_NAMED_CAUSES]) + more or "none"),
            ("RMS error", f"{errors} (held out)"),
        )
        return Summary(f"Diagnosis: {self.problem.name}", facts)

    def document(self) -> Document:
        """The whole report, a block a question."""
        return diagnosis_document(self.result)

    def drawings(self) -> Drawings:
        """Each named effect with the errors behind it; errors by model, scores, and what is left."""
        found = self.result
        drawings: Drawings = {
            "diagnosis_curves": partial(plot_curves, found),
            "diagnosis_scores": partial(plot_scores, found),
            "diagnosis_errors": partial(plot_errors, found),
            "diagnosis_periodogram": partial(plot_periodogram, found),
            "diagnosis_left": partial(plot_left, found),
        }
        absent = {
            "diagnosis_curves": not found.fitted_effects,
            "diagnosis_periodogram": not found.periodic_joints,
            "diagnosis_left": found.verdict != "unexplained",
        }
        drawn = {name: draw for name, draw in drawings.items() if not absent.get(name)}
        return {**drawn, **comparison_drawings(self.result.comparison)}

    def view(self) -> ArmView:
        """Every cause at the joint that it is of, with its size: all of them, and each by itself.

        The posture is that of the task, planned by the extended arm, else one of the measured ones.
        """
        found, extended = self.result, self.result.extended
        q, spread = task_posture(extended, self.result.comparison, found.request.data.q)
        marks = [cause_marks(found, finding) for finding in found.effects]
        single = [own for own in marks if len(own) == 1] or marks
        every = tuple(mark for own in single for mark in own)
        title = "all causes" if every else "no cause found"
        postures = [ShownPosture("causes", title, q, spread=spread, marks=every)]
        for finding, own in zip(found.effects, marks, strict=True):
            clause, size = words(finding, found.problem), finding.size_text
            facts = (("Cause", clause), *([("Size", size)] if size else []))
            postures.append(ShownPosture(view_key(found, finding), clause, q, facts, spread, marks=own))
        return ArmView(extended.robot, tuple(postures), "Cause", extended.scene)

    def columns(self) -> Columns:
        """One row a cause: kind, joint or link, p-value (corrected for the search), share of the RMS it removes."""
        found = self.result.effects
        return {
            "kind": [f.kind for f in found],
            "target": [f.target for f in found],
            "p_value": [f.p_value for f in found],
            "gain": [f.gain for f in found],
        }

    def files(self) -> Files:
        """The extended arm as a problem file, and the measurements that discriminate between causes, if any help."""
        further = split_csv(self.result)
        extended: Files = self.result.extended.files("extended")
        return extended | ({FILE: further.encode()} if further else {})
