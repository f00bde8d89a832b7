"""The report on a calibration: what the simulation gets wrong, and what the measurements say about the arm.

All errors are of held-out rows: none of them was predicted by a fit that had seen it.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from posture_opt.report.figures.residuals import chosen_rows
from posture_opt.report.interactive.arm_view import VIEWED_ROWS, ArmView, ShownPosture
from posture_opt.report.interactive.error_marks import correction_marks, task_posture
from posture_opt.report.measured_parts.calibration_parameters import (
    determined_words,
    parameters_block,
    places_blocks,
    undetermined_block,
)
from posture_opt.report.measured_parts.error_table import error_table, instrument_words, mm, range_table, rows_words
from posture_opt.report.page.presenter import Columns, Drawings, Presenter, problem_of
from posture_opt.report.page.save import Files
from posture_opt.report.parts.comparison_parts import comparison_blocks
from posture_opt.report.parts.parts import robot_facts
from posture_opt.report.results.assessment_report import assessment_blocks, assessment_drawings
from posture_opt.report.results.comparison_report import comparison_drawings
from posture_opt.report.results.spread_check_report import spread_check_blocks, spread_check_drawings
from posture_opt.report.text.blocks import Block, Document, Facts, Item, Summary, Table
from posture_opt.report.text.words import MODEL_NAMES
from posture_opt.statements.notation import count, length, length_unit

if TYPE_CHECKING:
    from posture_opt.calibration.calibration import Calibration
    from posture_opt.calibration.second_file import OtherFile
    from posture_opt.selection.problem_data import ProblemData
    from posture_opt.validation.evaluation import Evaluation

_MAX_OUTLIERS = 20


def calibration_document(shown: CalibrationPresenter) -> Document:
    """The statements of a calibration, and its tables: errors, parameters, residuals, the spread, the planned task."""
    found, evaluation = shown.result, shown.evaluation
    data, test = found.request.data, found.test
    facts = [
        *robot_facts(shown.problem),
        ("File", Path(data.file).name or "table"),
        ("Rows", rows_words(data, shown.problem.robot)),
        *([("Targets", ", ".join(data.target_names))] if len(data.target_names) > 1 else []),
        ("Instrument", instrument_words(shown.problem, data)),
        ("Parameters", determined_words(found)),
    ]
    models = {MODEL_NAMES[name]: getattr(found, name) for name in ("nominal", "calibrated")}
    blocks = (
        Block("What the simulation gets wrong", (error_table(models, data),)),
        *(replace(block, brief=()) for block in assessment_blocks(evaluation.assessment)),
        *(replace(block, brief=()) for block in spread_check_blocks(evaluation.spread_check)),
        parameters_block(found),
        *(replace(block, brief=()) for block in places_blocks(found)),
        undetermined_block(found),
        Block("Outliers", _outliers(found), brief=()),
        Block("Test file", () if test is None else _test_tables(test), brief=()),
        *(replace(block, brief=()) for block in comparison_blocks(evaluation.comparison)),
        Block("Data", (Facts(tuple(facts)),)),
    )
    return Document(shown.problem.name or "Calibration", found.statements, blocks)


def _outliers(found: Calibration) -> tuple[Item, ...]:
    """Rows that were left out of the fit, with their lines in the file and by how much each is off [mm]."""
    if not found.outliers:
        return ()
    sizes = np.linalg.norm(found.errors[list(found.outliers)], axis=1)
    rows = tuple((str(line), mm(float(size))) for line, size in zip(found.lines, sizes, strict=True))
    return (Table(("line", "off by [mm]"), rows[:_MAX_OUTLIERS], text_columns=0),)


def _test_tables(other: OtherFile) -> tuple[Table, ...]:
    """Errors on the other file by model, and those inside and outside the joint ranges of the fit."""
    names = {name: MODEL_NAMES[name] for name in other.models}
    table = error_table({names[name]: statistics for name, statistics in other.models.items()}, other.data)
    return (table, *range_table(other, names))


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

    def document(self) -> Document:
        """The whole report, a block a question."""
        return calibration_document(self)

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
