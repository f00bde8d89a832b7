"""The report on a diagnosis: its statements, with the tables of causes, errors, rivals and candidates.

Three models are compared throughout: the arm of the file, the arm with fitted geometry, and the arm with the effects
that were found. Errors are of held-out rows.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import ClassVar

from posture_opt.diagnosis.diagnosis import Diagnosis
from posture_opt.diagnosis.diagnosis_statements import words
from posture_opt.report.figures.diagnosis import plot_errors, plot_periodogram, plot_scores
from posture_opt.report.figures.diagnosis_curves import plot_curves, plot_left
from posture_opt.report.page.presenter import Columns, Drawings, Presenter, problem_of
from posture_opt.report.page.save import Files
from posture_opt.report.parts import diagnosis_tables as tables
from posture_opt.report.parts.model_tables import comparison_blocks, instrument_words, mm, rows_words
from posture_opt.report.parts.parts import robot_facts
from posture_opt.report.results.comparison_report import comparison_drawings
from posture_opt.report.scene.arm_view import ArmView, ShownPosture
from posture_opt.report.scene.posture_views import cause_marks, task_posture
from posture_opt.report.text.blocks import Block, Facts, Item, Later

_MAX_NAMED_CAUSES = 3
_PLOTS = {
    "diagnosis_curves": plot_curves,
    "diagnosis_scores": plot_scores,
    "diagnosis_errors": plot_errors,
    "diagnosis_periodogram": plot_periodogram,
    "diagnosis_left": plot_left,
}


def diagnosis_blocks(found: Diagnosis) -> tuple[Block, ...]:
    """The tables of a diagnosis; blocks without items hold the statements of their section."""
    problem, data = problem_of(found), found.request.data
    test, goals, split = found.test, found.goals, found.split
    facts = (
        *robot_facts(problem),
        ("File", Path(data.file).name or "table"),
        ("Rows", rows_words(data, problem.robot)),
        ("Instrument", instrument_words(problem, data)),
        ("Held out", f"{found.by}, in {found.rounds} rounds"),
    )
    curves, periodogram, left = (name if there else "" for name, there in _sometimes(found).items())
    detailed: dict[str, tuple[Sequence[Item], str]] = {
        "Each cause": (tables.each_cause(found), curves),
        "Periodic joint errors": ((), periodogram),
        "Gain from the causes found": (Later(lambda: (tables.errors_table(found),)), "diagnosis_errors"),
        "On the test file": (() if test is None else tables.test_tables(found, test), ""),
        "Comparison of plans, as measured": (() if goals is None else tables.goals_tables(goals), ""),
        "Causes that could be confused": ((), ""),
        "Measurements that discriminate between causes": (
            () if split is None else tables.split_tables(found, split),
            "",
        ),
        "Unexplained structure": ((), left),
        "Candidates": ((tables.candidates_table(found),), "diagnosis_scores"),
        "What these data cannot show": ((), ""),
        "What no data of this kind can show": ((), ""),
        "Data": ((Facts(facts),), ""),
    }
    blocks = [Block(title, items, figure, brief=()) for title, (items, figure) in detailed.items()]
    causes = Block("Causes", (tables.causes_table(found),) if found.effects else (), stays=True)
    return causes, *blocks[:4], *comparison_blocks(found.comparison, tables.MODELS), *blocks[4:]


def _sometimes(found: Diagnosis) -> dict[str, bool]:
    """Figures that not every diagnosis has."""
    return {
        "diagnosis_curves": bool(found.fitted_effects),
        "diagnosis_periodogram": bool(found.periodic_joints),
        "diagnosis_left": found.verdict == "unexplained",
    }


class DiagnosisPresenter(Presenter[Diagnosis]):
    """A diagnosis with the task planned again by the arm that was found; ``extended.yaml`` is that arm."""

    stem = "diagnosis"
    title = "Diagnosis"
    delivers: ClassVar[tuple[str, ...]] = ("extended.yaml",)

    def facts(self) -> Iterable[tuple[str, str]]:
        found = self.result
        errors = ", ".join(f"{mm(found.errors[name].rms)} mm {text}" for name, text in tables.MODELS.items())
        named = [words(f, found.problem) for f in found.effects]
        more = f"; and {len(named) - _MAX_NAMED_CAUSES} more" if len(named) > _MAX_NAMED_CAUSES else ""
        return (
            ("Verdict", found.verdict.replace("_", " ")),
            ("Causes", "; ".join(named[:_MAX_NAMED_CAUSES]) + more or "none"),
            ("RMS error", f"{errors} (held out)"),
        )

    def blocks(self) -> Iterable[Block]:
        return diagnosis_blocks(self.result)

    def drawings(self) -> Drawings:
        there = _sometimes(self.result)
        drawn = {name: partial(plot, self.result) for name, plot in _PLOTS.items() if there.get(name, True)}
        return {**drawn, **comparison_drawings(self.result.comparison)}

    def view(self) -> ArmView:
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
            postures.append(ShownPosture(tables.view_key(found, finding), clause, q, facts, spread, marks=own))
        return ArmView(extended.robot, tuple(postures), "Cause", extended.scene)

    def columns(self) -> Columns:
        return {name: [getattr(f, name) for f in self.result.effects] for name in ("kind", "target", "p_value", "gain")}

    def files(self) -> Files:
        further = tables.split_csv(self.result)
        extended: Files = self.result.extended.files("extended")
        return extended | ({tables.FILE: further.encode()} if further else {})
