"""The report on a calibration: what the simulation gets wrong, and what the measurements say about the arm.

All errors are of held-out rows: none of them was predicted by a fit that had seen it.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from posture_opt.model.effects import Effect
from posture_opt.report.figures.residuals import chosen_rows
from posture_opt.report.interactive.arm_view import VIEWED_ROWS, ArmView, ShownPosture
from posture_opt.report.interactive.error_marks import correction_marks, task_posture
from posture_opt.report.measured_parts.calibration_brief import calibration_brief, stood_elsewhere
from posture_opt.report.measured_parts.calibration_parameters import (
    determined_words,
    parameters_block,
    places_blocks,
    undetermined_block,
)
from posture_opt.report.measured_parts.contradictions import doubts_lead
from posture_opt.report.measured_parts.error_table import (
    error_table,
    held_out_sentence,
    instrument_words,
    mm,
    rows_words,
)
from posture_opt.report.measured_parts.instrument_scatter_words import instrument_scatter_lead, sure_gain_lead
from posture_opt.report.measured_parts.large_file_words import large_file_facts
from posture_opt.report.measured_parts.other_file_words import calibration_words, file_words, range_items
from posture_opt.report.measured_parts.start_up_words import start_up_lead
from posture_opt.report.page.presenter import Columns, Drawings, Presenter, problem_of
from posture_opt.report.page.save import Files
from posture_opt.report.parts.comparison_parts import comparison_blocks, comparison_lead
from posture_opt.report.parts.parts import note_facts, robot_facts, sentence
from posture_opt.report.results.assessment_report import assessment_blocks, assessment_drawings
from posture_opt.report.results.comparison_report import comparison_drawings
from posture_opt.report.results.spread_check_report import spread_check_blocks, spread_check_drawings
from posture_opt.report.text.blocks import Block, Document, Facts, Report, Summary, Table
from posture_opt.report.text.words import MODEL_NAMES
from posture_opt.statements.notation import count, length, length_unit

if TYPE_CHECKING:
    from posture_opt.calibration.calibration import Calibration
    from posture_opt.calibration.second_file import OtherFile
    from posture_opt.selection.problem_data import ProblemData
    from posture_opt.validation.evaluation import Evaluation

_MAX_OUTLIERS = 20
_MAX_LEAD_NOTES = 2  # in the lead


def calibration_report(shown: CalibrationPresenter) -> Report:
    """Data, errors before and after, parameters, what is not determined, outliers, test file.

    The blocks of the assessment, of the check of the spread and of the re-planned posture are among them; the test
    file has a block where there is one.
    """
    found, assessment, check = shown.result, shown.evaluation.assessment, shown.evaluation.spread_check
    blocks = (
        data_block(shown.problem, found),
        errors_block(shown.problem, found),
        *Document("", assessment.statements[1:], assessment_blocks(assessment)).whole.blocks,
        *Document("", check.statements[1:], spread_check_blocks(check)).whole.blocks,
        parameters_block(found),
        *places_blocks(found),
        undetermined_block(found),
        outliers_block(found),
        *([test_block(found, found.test)] if found.test is not None else []),
        *comparison_blocks(shown.evaluation.comparison),
    )
    return Report(shown.problem.name or "Calibration", calibration_lead(shown), blocks)


def calibration_lead(shown: CalibrationPresenter) -> tuple[str, ...]:
    """The answer, what may be wrong with the data or the fit, what it means for the task, and for its spread.

    Order: an instrument that is worse than the arm, contradictions with the file and implausible values, the answer,
    a test file on which the calibration fails, the first warnings, the comparison of plans, and the coverage of the
    predicted spread. Warnings of the data are left out where a fitted contradiction explains them.
    """
    found = shown.result
    explained = any(isinstance(c.cause, Effect) for c in found.contradictions)  # by the first line
    warnings = () if explained else found.request.data.warnings
    doubts = [sentence(note) for note in dict.fromkeys((*warnings, *found.fit.notes))]
    more = (
        (f"{len(doubts) - _MAX_LEAD_NOTES} more notes of this kind are under Data.",)
        if len(doubts) > _MAX_LEAD_NOTES
        else ()
    )
    fails = () if found.test is None or found.test.improves else (calibration_words(found.test),)
    return (
        *instrument_scatter_lead(found.instrument_scatter),
        *sure_gain_lead(found, found.keeps_nominal),
        *doubts_lead(found),
        _answer(found),
        *fails,
        *start_up_lead(found.start_up),
        *doubts[:_MAX_LEAD_NOTES],
        *more,
        *comparison_lead(shown.evaluation.comparison),
        shown.evaluation.spread_check.statements[0].text,
    )


def _answer(found: Calibration) -> str:
    """RMS position error [mm] before and after, or that calibration does not help."""
    before, after = (mm(s.rms) for s in (found.nominal, found.calibrated))
    what = found.request.data.kind.error_words
    if found.calibrated.rms >= found.nominal.rms:
        return f"Calibration does not help: {what.replace('error', 'errors')} of {before} mm RMS become {after} mm."
    return f"On rows held out from the fit, calibration reduces the RMS {what} from {before} mm to {after} mm."


def data_block(problem: ProblemData, found: Calibration) -> Block:
    """The file, its rows, the instrument, and what looks odd.

    Targets are listed where the tool has several, thinning where only a part of a large file was fitted. Warnings that
    the lead has already are not repeated.
    """
    data = found.request.data
    facts = [
        ("File", Path(data.file).name or "table"),
        ("Rows", rows_words(data, problem.robot)),
        *([("Targets", ", ".join(data.target_names))] if len(data.target_names) > 1 else []),
        *large_file_facts(found.large),
        ("Instrument", instrument_words(problem, data)),
    ]
    doubts = tuple(dict.fromkeys((*data.warnings, *found.fit.notes)))
    every = (*data.warnings, *data.notes, *problem.notes, *found.notes)
    notes = note_facts(note for note in every if note not in doubts[:_MAX_LEAD_NOTES])
    return Block("Data", (Facts((*robot_facts(problem), *facts, *notes)),))


def errors_block(problem: ProblemData, found: Calibration) -> Block:
    """Position errors before and after, cross-validated: RMS with its 95 % interval, mean, 95 % quantile and maximum
    [mm].

    "Before" has only the frames fitted that the file leaves free: without them no error could be computed.
    """
    how = held_out_sentence(found.by, min(found.request.folds, len(np.unique(found.request.data.pose))))
    free = [name for name, is_free in (("base", problem.robot.base_free), ("tool", problem.robot.tool_free)) if is_free]
    frames = f" Before calibration, the arm has only its free {' and '.join(free)} fitted." if free else ""
    gone = f" {count(len(found.outliers), 'outlier is', 'outliers are')} not counted." if found.outliers else ""
    models = {MODEL_NAMES["nominal"]: found.nominal, MODEL_NAMES["calibrated"]: found.calibrated}
    table = error_table(models, found.request.data)
    text = f"{how}{frames} The interval holds the RMS with 95 % confidence.{gone}"
    return Block("What the simulation gets wrong", (text, table))


def outliers_block(found: Calibration) -> Block:
    """Rows that were left out of the fit, with their lines in the file and by how much each is off [mm]."""
    if not found.outliers:
        return Block("Outliers", ("No row stands out.",))
    sizes = np.linalg.norm(found.errors[list(found.outliers)], axis=1)
    rows = tuple((str(line), mm(float(size))) for line, size in zip(found.lines, sizes, strict=True))
    more = [f"and {len(rows) - _MAX_OUTLIERS} more"] if len(rows) > _MAX_OUTLIERS else []
    gone = "1 row was left out of the fit" if len(rows) == 1 else f"{len(rows)} rows were left out of the fit"
    text = f"{gone} of {Path(found.request.data.file).name or 'the table'}: far more off than the others explain."
    return Block("Outliers", (text, Table(("line", "off by [mm]"), rows[:_MAX_OUTLIERS], text_columns=0), *more))


def test_block(found: Calibration, other: OtherFile) -> Block:
    """Another file, predicted by what this one taught.

    Errors by model, then those of rows inside and outside the joint ranges of the fit. Errors many times those of the
    first file come with the hint to fit base and tool again.
    """
    names = {name: MODEL_NAMES[name] for name in other.models}
    table = error_table({names[name]: statistics for name, statistics in other.models.items()}, other.data)
    hint = "So far off, base or instrument may have stood elsewhere: --refit-frames fits base and tool again."
    items = (file_words(other), table, *range_items(other, names))
    return Block("Test file", (*items, *([hint] if stood_elsewhere(found) else [])))


class CalibrationPresenter(Presenter["Calibration"]):
    """A calibration with what it is held against: its residuals, the spread it predicts, the task planned again.

    ``calibrated.yaml`` is the problem file with the corrections and the covariance of the parameters.
    """

    stem = "calibration"
    delivers: ClassVar[tuple[str, ...]] = ("calibrated.yaml",)

    @property
    def problem(self) -> ProblemData:
        """The problem whose arm was calibrated."""
        return problem_of(self.result.request)

    @property
    def evaluation(self) -> Evaluation:
        """What the calibration is held against."""
        evaluated: Evaluation = self.result.evaluation
        return evaluated

    def summary(self) -> Summary:
        """Rows and outliers, RMS before and after, how many parameters are determined."""
        found = self.result
        facts = (
            ("Rows", f"{len(found.request.data)}, {count(len(found.outliers), 'outlier')}"),
            (
                found.request.data.kind.error_words.capitalize(),
                f"{mm(found.nominal.rms)} mm RMS before calibration, {mm(found.calibrated.rms)} mm after",
            ),
            ("", "(cross-validated)"),
            ("Parameters", determined_words(found)),
        )
        return Summary(f"Calibration: {self.problem.name}", facts)

    def document(self) -> Report:
        """The whole report, a block a question."""
        return calibration_report(self)

    def brief(self) -> Report:
        """The report on one screen, with what to do next."""
        return calibration_brief(self.problem, self.result, self.evaluation.assessment, calibration_lead(self))

    def drawings(self) -> Drawings:
        """Residuals, whether the predicted spread is true, and the error in the old and in the new posture."""
        return {
            **assessment_drawings(self.evaluation.assessment),
            **spread_check_drawings(self.evaluation.spread_check),
            **comparison_drawings(self.evaluation.comparison),
        }

    def view(self) -> ArmView:
        """The corrections, each at its joint, and the measured rows, coloured by their error after calibration.

        The first posture is that of the task, with the predicted spread; the others are measured ones, a choice of
        them where there are many.
        """
        found, calibrated = self.result, self.evaluation.models["calibrated"]
        data = found.request.data
        before, after = (np.linalg.norm(errors, axis=1) for errors in (found.errors_nominal, found.errors))
        rows = found.kept_rows[chosen_rows(len(found.kept_rows), VIEWED_ROWS)]
        rows = rows[np.argsort(-after[rows], kind="stable")]
        rows = rows[np.unique(data.line[rows], return_index=True)[1]]  # of several numbers of one line, the worst
        unit, factor = length_unit(after[rows].tolist())
        q, spread = task_posture(calibrated, self.evaluation.comparison, data.q)
        marks = correction_marks(found, calibrated)
        first = ShownPosture("corrections", "corrections of the arm", q, spread=spread, marks=marks)
        measured = tuple(
            ShownPosture(
                f"line-{data.line[k]}",
                f"line {data.line[k]}: {length(float(after[k]))} off after calibration",
                data.q[k],
                (("Error before calibration", length(float(before[k]))), ("Error after", length(float(after[k])))),
                value=round(factor * float(after[k]), 5),
            )
            for k in rows
        )
        values = f"error after calibration [{unit}]"
        return ArmView(calibrated.robot, (first, *measured), "Shown", calibrated.scene, points=True, values=values)

    def columns(self) -> Columns:
        """The parameters with their standard errors, SI units.

        "determined" is whether data (with the stated priors) determine a parameter by itself; a value that is not
        determined goes with the others of its combination only.
        """
        found = self.result
        return {
            "parameter": [p.name for p in found.parameters],
            "estimate": [float(p.nominal + x) for p, x in zip(found.parameters, found.x, strict=True)],
            "std": found.std,
            "nominal": [p.nominal for p in found.parameters],
            "unit": [p.unit for p in found.parameters],
            "determined": found.fixed,
        }

    def files(self) -> Files:
        """The calibrated arm as a problem file."""
        calibrated: Files = self.evaluation.models["calibrated"].files("calibrated")
        return calibrated
