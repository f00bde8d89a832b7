"""The report on a diagnosis: the causes of the errors, their gain, their rivals, and what stays unexplained.

Three models are compared throughout: the arm of the file, the arm with fitted geometry, and the arm with the effects
that were found. Errors are of held-out rows.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from posture_opt.diagnosis.diagnosis import Diagnosis
from posture_opt.diagnosis.measured_goals import MeasuredGoals
from posture_opt.measurements.measurements import rows_back_in_time
from posture_opt.report.figures.diagnosis import plot_errors, plot_periodogram
from posture_opt.report.figures.diagnosis_curves import plot_curves, plot_left
from posture_opt.report.figures.diagnosis_scores import plot_scores
from posture_opt.report.interactive.arm_view import ArmView, ShownPosture
from posture_opt.report.interactive.error_marks import cause_marks, task_posture
from posture_opt.report.measured_parts.cause_advice import FILE, overfitted
from posture_opt.report.measured_parts.cause_inspections import bent_lead
from posture_opt.report.measured_parts.causes_table import gain_elsewhere, unconfirmed, view_key
from posture_opt.report.measured_parts.contradictions import doubts_lead
from posture_opt.report.measured_parts.diagnosis_causes import (
    causes_block,
    confusion_block,
    cyclic_block,
    each_cause_block,
    finding_words,
)
from posture_opt.report.measured_parts.diagnosis_errors import delivery_lead, elsewhere_lead, errors_block, test_block
from posture_opt.report.measured_parts.diagnosis_goals import goals_block, goals_lead
from posture_opt.report.measured_parts.diagnosis_open import (
    absorbed_block,
    left_block,
    scores_block,
    split_block,
    split_csv,
    unexplained_lead,
    unknowable_block,
)
from posture_opt.report.measured_parts.diagnosis_sizes import (
    MODELS,
    fitted_effects,
    headline_of,
    like_noise,
    noise_floor,
    periodic_joints,
)
from posture_opt.report.measured_parts.error_table import instrument_words, mm, rows_words
from posture_opt.report.measured_parts.instrument_scatter_words import instrument_scatter_lead, sure_gain_lead
from posture_opt.report.measured_parts.large_file_words import large_file_facts
from posture_opt.report.measured_parts.start_up_words import scatter_change_lead, start_up_lead
from posture_opt.report.page.presenter import Columns, Drawings, Presenter, problem_of
from posture_opt.report.page.save import Files
from posture_opt.report.parts.comparison_parts import comparison_blocks, comparison_lead
from posture_opt.report.parts.parts import note_facts, robot_facts
from posture_opt.report.results.comparison_report import comparison_drawings
from posture_opt.report.text.blocks import Block, Facts, Report, Summary
from posture_opt.statements.notation import count, listed_lines, percent

if TYPE_CHECKING:
    from collections.abc import Sequence

    from posture_opt.diagnosis.causes.causes import Finding
    from posture_opt.selection.comparison.comparison import Comparison

_OVERFITTED_LEAD = (
    "Measure more postures before anything of this is believed: rows held out from the fit are predicted worse than "
    "before calibration."
)
_MAX_NAMED_CAUSES = 3
_MIN_OUTLIER_RUN = 4  # outliers that follow each other, which instruments do not make
_FAR_OFF = 3.0  # times what 95 % of the rows are within: a row that is farther off is looked at by itself
_NAMED_OF_MANY = 2  # causes of the first sentence where there are more than it can name
_NUMBER_WORDS = ("Two", "Three", "Four", "Five", "Six", "Seven", "Eight", "Nine", "Ten")


def diagnosis_report(
    found: Diagnosis, comparison: Comparison | None = None, goals: MeasuredGoals | None = None
) -> Report:
    """The answer, the causes, their gain, their rivals, what stays unexplained, and the data.

    Args:
        comparison: the task planned again by the extended arm, or None without a task.
        goals: targets that were measured in several postures, or None.
    """
    names = MODELS if fitted_effects(found) else MODELS | {"extended": "extended"}
    blocks = (
        causes_block(found),
        *each_cause_block(found),
        *cyclic_block(found),
        errors_block(found),
        *([test_block(found)] if found.test is not None else []),
        *(replace(block, brief=()) for block in comparison_blocks(comparison, names)),
        *goals_block(goals),
        *confusion_block(found),
        *split_block(found),
        left_block(found),
        scores_block(found),
        absorbed_block(found),
        unknowable_block(found),
        data_block(found),
    )
    title = problem_of(found).name or "Diagnosis"
    return Report(title, answer(found, comparison, goals), blocks)


def answer(found: Diagnosis, comparison: Comparison | None, goals: MeasuredGoals | None) -> tuple[str, ...]:
    """The causes in one sentence, and what knowing them brings in another.

    Doubts about data and file come before it. What follows it: postures to repeat, which arm is delivered where it is
    not the one with all effects, the test file, the comparison of plans. Each is left out where it does not apply.
    """
    geometry = [f for f in found.effects if f.effect is None and f.noise is None]
    causes = [f for f in found.effects if f not in geometry and f.determined] or geometry
    vague = [f for f in found.effects if f not in geometry and not f.determined]
    named = len(causes) if len(causes) <= _MAX_NAMED_CAUSES else _NAMED_OF_MANY
    said = [_named(found, f) for f in sorted(causes, key=lambda f: unconfirmed(found, f))[:named]]
    more = len(causes) - len(said)
    names = "; ".join(said) + (f"; and {count(more, 'more cause')}" if more else "")
    also = f" {_vague(found, vague)}" if vague else ""
    counted = _counted(len(causes), [] if causes is geometry else geometry)
    if found.verdict == "none_found":
        first = f"The model explains these data: no cause of error is found{_beyond(found)}."
    elif found.verdict == "effects_found" and said:
        first = f"{counted} the errors: {names}.{also}"
    elif said:
        first = f"{counted} part of the error: {names}. {_rest(found)}{also}"
    else:
        cause = "cause of known size" if vague else "cause of the catalogue"
        first = f"Errors remain{_beyond(found)} that no {cause} explains.{also}"
    return (
        *instrument_scatter_lead(found.calibration.instrument_scatter),
        *sure_gain_lead(found.calibration, found.delivery.nominal),
        *doubts_lead(found.calibration),
        *((_OVERFITTED_LEAD,) if overfitted(found) else ()),
        first,
        *(() if overfitted(found) else bent_lead(found)),
        _improvement(found),
        *clock_lead(found),
        *unexplained_lead(found),
        *outliers_lead(found),
        *(start_up_lead(found.start_up) or scatter_change_lead(found.scatter_change)),
        *delivery_lead(found),
        *elsewhere_lead(found),
        *comparison_lead(comparison),
        *goals_lead(goals),
    )


def _beyond(found: Diagnosis) -> str:
    """What the errors are compared with, where repeats say it."""
    return " beyond measurement noise" if noise_floor(found).repeated else ""


def _named(found: Diagnosis, finding: Finding) -> str:
    """A cause in words with its size; without, where the words have the size already or no single number says it."""
    size, words = headline_of(finding), finding_words(finding, found.problem)
    doubt = f", {_tested(found, finding)} on the test file" if unconfirmed(found, finding) else ""
    if not size or size in words:
        return f"{words}{doubt}"
    size += " together" if len(finding.cause.spectral_lines) > 1 else ""
    return f"{words}, {size}{doubt}" if words.endswith(")") else f"{words} ({size}){doubt}"


def _tested(found: Diagnosis, finding: Finding) -> str:
    """What an effect that is not confirmed brings on the test file, in the words of the table."""
    assert found.test is not None
    assert finding.place is not None
    return gain_elsewhere(found.test.gains[finding.place])[1]


def _vague(found: Diagnosis, findings: list[Finding]) -> str:
    """Causes whose size the data do not determine."""
    if len(findings) > _NAMED_OF_MANY:
        first = max(findings, key=lambda f: f.gain)
        words = f"{finding_words(first, found.problem)} (RMS drop {percent(first.gain)})"
        return f"Suspected, of a size that these data do not determine: {words} and {len(findings) - 1} more causes."
    names = "; ".join(finding_words(f, found.problem) for f in findings)
    return f"Suspected, of a size that these data do not determine: {names}."


def _improvement(found: Diagnosis) -> str:
    """RMS error [mm] on held-out rows: before calibration, calibrated, with effects; and the noise floor below them."""
    sizes = {name: found.errors[name].rms for name in MODELS}
    data = found.request.data
    what = "error" if data.position is not None or data.touches else data.kind.error_words
    text = f"On rows held out from the fit, the RMS {what} was {mm(sizes['nominal'])} mm before calibration, "
    text += f"{mm(sizes['calibrated'])} mm calibrated"
    if fitted_effects(found):
        text += f", and {mm(sizes['extended'])} mm with {_these(len(fitted_effects(found)))}"
    text += f" ({_spread_words(found)})"
    floor = noise_floor(found)
    if not floor.rms:
        return f"{text}."
    surely = found.errors["extended"].interval[1] < floor.rms
    if surely and not floor.repeated and found.scatter_change is None:
        return f"{text}; {floor.words} would make {mm(floor.rms)} mm, so it errs by less than stated."
    every = ", for about all that is left" if floor.rms >= sizes["extended"] else ""
    return f"{text}; {floor.clause}{every}."


def clock_lead(found: Diagnosis) -> tuple[str, ...]:
    """That the clock of the file started anew, where what happened in time is not seen as it was."""
    data = found.request.data
    if data.time is None or data.visit is not None or not len(back := rows_back_in_time(data.time, data.robot)):
        return ()
    lines = listed_lines([int(line) for line in data.line[back]])
    return (
        f"The time goes back at {lines}: a drift, or what slipped or was knocked at some moment, is not seen as it "
        "was. Count the time from the first row on, or leave it out, and diagnose again.",
    )


def _spread_words(found: Diagnosis) -> str:
    """Within what 95 % of the rows are, and all; of a row that is far off its line."""
    best, held = found.errors["extended"], found.held["extended"].errors
    text = f"95 % of the rows within {mm(best.p95)} mm"
    mixed = found.model.residuals.data.part is not None  # instruments of several kinds are of different accuracy
    if mixed or best.max < _FAR_OFF * best.p95:
        return f"{text}, all within {mm(best.max)} mm"
    line = int(found.model.residuals.data.line[int(np.argmax(np.linalg.norm(held, axis=1)))])
    return f"{text}; line {line} is off by {mm(best.max)} mm: measure it again"


def outliers_lead(found: Diagnosis) -> tuple[str, ...]:
    """Which rows are left out as outliers, and which as nobody knows from where a joint with play came to them."""
    calibration, unsided = found.calibration, found.unsided_lines
    lines = [line for line in calibration.lines if line not in unsided]
    run = calibration.outliers_at_ends
    text = f"Left out as outliers: {listed_lines(lines)}"
    end = f"; {run} of them follow each other at an end of the session: was a tool, base or instrument moved?"
    side = f"Left out, as the side from which joints came there is not known: {listed_lines(unsided)}."
    outliers = [f"{text}{'.' if run < _MIN_OUTLIER_RUN else end}"] if lines else []
    return (*outliers, *([side] if unsided else ()))


def _rest(found: Diagnosis) -> str:
    """What is left beside the causes of part of the error: whether it is more than noise on average."""
    if like_noise(found):
        return "The rest is about as large as noise, but it follows a pattern that is unexplained."
    return "The rest is unexplained."


def _counted(n: int, geometry: Sequence[Finding]) -> str:
    """One cause explains, two causes and the geometry explain, 12 causes explain: as many as the table lists."""
    numbers = f"{_NUMBER_WORDS[n - 2] if 0 <= n - 2 < len(_NUMBER_WORDS) else 'One' if n == 1 else n}"
    text = f"{numbers} {'cause' if n == 1 else 'causes'}"
    if not geometry:
        return f"{text} {'explains' if n == 1 else 'explain'}"
    also = "the geometry" if geometry[0].kind == "geometry" else count(len(geometry), "geometric error")
    return f"{text} and {also} explain"


def _these(n: int) -> str:
    """What the third model has, without a number that is not that of all causes."""
    return "this effect" if n == 1 else "the effects"


def data_block(found: Diagnosis) -> Block:
    """The file, its rows, the instrument, and what looks odd.

    "Geometry" is how many combinations of parameters the data determine; they are fitted in every model, so that no
    effect takes the blame for a wrong length.
    """
    problem, data = problem_of(found), found.request.data
    gone = found.calibration.lines
    facts = [
        ("File", Path(data.file).name or "table"),
        ("Rows", rows_words(data, problem.robot)),
        *large_file_facts(found.large),
        ("Instrument", instrument_words(problem, data)),
        ("Geometry", f"{found.model.directions.shape[1]} combinations of parameters are fitted in every model"),
        *([("Left out", f"of the search, {listed_lines(gone)}")] if gone else []),
    ]
    notes = note_facts((*data.warnings, *data.notes, *problem.notes, *found.notes))
    return Block("Data", (Facts((*robot_facts(problem), *facts, *notes)),), brief=())


class DiagnosisPresenter(Presenter[Diagnosis]):
    """A diagnosis with the task planned again by the arm that was found; ``extended.yaml`` is that arm."""

    stem = "diagnosis"
    delivers: ClassVar[tuple[str, ...]] = ("extended.yaml",)

    def summary(self) -> Summary:
        """Verdict, the first causes, and the RMS error by model."""
        found = self.result
        errors = ", ".join(f"{mm(found.errors[name].rms)} mm {words}" for name, words in MODELS.items())
        named = [finding_words(f, self.problem) for f in found.effects]
        more = f"; and {len(named) - _MAX_NAMED_CAUSES} more" if len(named) > _MAX_NAMED_CAUSES else ""
        facts = (
            ("Verdict", found.verdict.replace("_", " ")),
            ("Causes", "; ".join(named[:_MAX_NAMED_CAUSES]) + more or "none"),
            ("RMS error", f"{errors} (held out)"),
        )
        return Summary(f"Diagnosis: {self.problem.name}", facts)

    def document(self) -> Report:
        """The whole report, a block a question."""
        return diagnosis_report(self.result, self.result.comparison, self.result.goals)

    def drawings(self) -> Drawings:
        """Each named effect with the errors behind it; errors by model, scores, and what is left.

        Curves need a named effect, the periodogram a periodic one, and the last figure a verdict of unexplained
        structure.
        """
        found = self.result
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
            words, size = finding_words(finding, found.problem), headline_of(finding)
            facts = (("Cause", words), *([("Size", size)] if size else []))
            postures.append(ShownPosture(view_key(found, finding), words, q, facts, spread, marks=own))
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
