"""The report on a calibration: what the simulation gets wrong, and what the measurements say about the arm."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from posture_opt.calibration.instrument import position_sigma
from posture_opt.report.blocks import Block, Facts, Report, Table
from posture_opt.report.comparison_blocks import comparison_blocks, comparison_lead
from posture_opt.report.parameter_blocks import parameters_block, undetermined_block
from posture_opt.report.parts import note_facts, robot_facts
from posture_opt.report.residual_blocks import residual_blocks
from posture_opt.report.save import report_files, save_files
from posture_opt.report.truth_blocks import truth_blocks, truth_lead
from posture_opt.report.units_text import count, decimals_of, fixed, number, stated_length
from posture_opt.report.words import MODEL_NAMES

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from posture_opt.calibration.calibration import Calibration
    from posture_opt.calibration.error_statistics import Statistics
    from posture_opt.measurements.measurements import Measurements
    from posture_opt.problem.problem import Problem
    from posture_opt.selection.plan_comparison import Comparison
    from posture_opt.validation.assessment import Assessment
    from posture_opt.validation.spread_check import SpreadCheck

_LISTED = 20
_ELSEWHERE = 20  # times the errors at home: no arm drifts that far
_LEFT_OUT = {
    "pose": "its pose",
    "block": "its block of the workspace",
    "place": "the place that it touches",
}


@dataclass(frozen=True, eq=False)
class Learned:
    """A calibration with what it was made from."""

    data: Measurements
    calibration: Calibration
    folds: int = 5
    priors: bool = True
    test: Measurements | None = None
    refit_frames: bool = False
    calibrated: Problem | None = None
    comparison: Comparison | None = None
    assessment: Assessment | None = None
    spread_check: SpreadCheck | None = None


def calibration_report(problem: Problem, learned: Learned) -> Report:
    """Data, errors before and after, parameters, what is not determined, outliers, test file."""
    blocks = (
        data_block(problem, learned),
        errors_block(problem, learned),
        *(residual_blocks(learned.assessment) if learned.assessment is not None else ()),
        *(truth_blocks(learned.spread_check) if learned.spread_check is not None else ()),
        parameters_block(learned.calibration),
        undetermined_block(learned.calibration),
        outliers_block(learned),
        *([test_block(learned)] if learned.test is not None else []),
        *comparison_blocks(learned.comparison),
    )
    truth = (truth_lead(learned.spread_check),) if learned.spread_check is not None else ()
    return Report(
        problem.name or "Calibration",
        (_answer(learned.calibration), *comparison_lead(learned.comparison), *truth),
        blocks,
    )


def _answer(found: Calibration) -> str:
    before, after = (_mm(s.rms) for s in (found.nominal, found.calibrated))
    if found.calibrated.rms >= found.nominal.rms:
        return f"Calibration does not help: position errors of {before} mm RMS become {after} mm."
    return f"Calibration takes the position errors from {before} mm to {after} mm RMS where it has not seen the data."


def data_block(problem: Problem, learned: Learned) -> Block:
    """The file, its rows, the instrument, and what looks odd."""
    data = learned.data
    facts = [
        ("File", Path(data.file).name or "table"),
        ("Rows", f"{len(data)} in {count(len(np.unique(data.pose)), 'pose')}"),
        *([("Targets", ", ".join(data.target_names))] if len(data.target_names) > 1 else []),
        ("Instrument", _instrument(problem, data)),
    ]
    notes = note_facts((*data.warnings, *problem.notes, *learned.calibration.notes))
    return Block("Data", (Facts((*robot_facts(problem), *facts, *notes)),))


def _instrument(problem: Problem, data: Measurements) -> str:
    if data.position is None:
        return f"none: the arm touches {count(len(data.point_names), 'fixed point')}"
    sigma = position_sigma(problem, data)
    return f"{stated_length(sigma)} (one standard deviation of a coordinate)" if sigma else "no accuracy is stated"


def errors_block(problem: Problem, learned: Learned) -> Block:
    """Position errors before and after, cross-validated."""
    found = learned.calibration
    how = f"Every row is predicted by an arm that was fitted without {_LEFT_OUT[found.by]}"
    rounds = min(learned.folds, len(np.unique(learned.data.pose)))
    how += "." if found.by == "place" else f", in {rounds} rounds."
    free = [name for name, is_free in (("base", problem.robot.base_free), ("tool", problem.robot.tool_free)) if is_free]
    frames = f" Before calibration, the arm has only its free {' and '.join(free)} fitted." if free else ""
    gone = f" {count(len(found.outliers), 'outlier is', 'outliers are')} not counted." if found.outliers else ""
    table = statistics_table({MODEL_NAMES["nominal"]: found.nominal, MODEL_NAMES["calibrated"]: found.calibrated})
    text = f"{how}{frames} The interval holds the RMS with 95 % confidence.{gone}"
    return Block("What the simulation gets wrong", (text, table))


def statistics_table(rows: dict[str, Statistics]) -> Table:
    """Lengths of position errors in mm."""
    headers = ("position error [mm]", "RMS", "interval of RMS", "mean", "95 % below", "max")
    texts = tuple((name, _mm(s.rms), _interval(s), _mm(s.mean), _mm(s.p95), _mm(s.max)) for name, s in rows.items())
    return Table(headers, texts)


def _interval(s: Statistics) -> str:
    low, high = (value * 1e3 for value in s.interval)
    decimals = decimals_of(high, 3)
    return f"{fixed(low, decimals)} to {fixed(high, decimals)}"


def _mm(metres: float) -> str:
    return number(metres * 1e3)


def outliers_block(learned: Learned) -> Block:
    """Rows that were left out of the fit, with their lines."""
    found = learned.calibration
    if not found.outliers:
        return Block("Outliers", ("No row stands out.",))
    sizes = np.linalg.norm(found.errors[list(found.outliers)], axis=1)
    rows = tuple((str(line), _mm(float(size))) for line, size in zip(found.lines, sizes, strict=True))
    more = [f"and {len(rows) - _LISTED} more"] if len(rows) > _LISTED else []
    gone = "1 row was left out of the fit" if len(rows) == 1 else f"{len(rows)} rows were left out of the fit"
    text = f"{gone} of {Path(learned.data.file).name or 'the table'}: far more off than the others explain."
    return Block("Outliers", (text, Table(("line", "off by [mm]"), rows[:_LISTED], text_columns=0), *more))


def test_block(learned: Learned) -> Block:
    """Another file, predicted by what this one taught."""
    assert learned.test is not None
    how = "base and tool fitted again to it" if learned.refit_frames else "nothing fitted to it"
    text = f"{Path(learned.test.file).name or 'table'}, {count(len(learned.test), 'row')}: {how}."
    table = statistics_table({MODEL_NAMES[name]: statistics for name, statistics in learned.calibration.test.items()})
    test, own = learned.calibration.test["calibrated"].rms, learned.calibration.calibrated.rms
    moved = not learned.refit_frames and test > _ELSEWHERE * own
    hint = "So far off, base or instrument may have stood elsewhere: --refit-frames fits base and tool again."
    return Block("Test file", (text, table, *([hint] if moved else [])))


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


def save_calibration(folder: Path, problem: Problem, learned: Learned, plots: bool = True) -> None:
    """Writes the files of a calibration into ``folder``: the report and the calibrated arm."""
    document, figures = calibration_document(learned), _calibration_figures(problem, learned) if plots else {}
    files = report_files("calibration", document, calibration_report(problem, learned), figures, problem.to_yaml())
    if learned.calibrated is not None:
        files |= learned.calibrated.files("calibrated")
    save_files(folder, files)


def _calibration_figures(problem: Problem, learned: Learned) -> dict[str, Figure]:
    from posture_opt.report.figures.residuals import residual_figures

    figures = residual_figures(problem, learned)
    if learned.spread_check is not None:
        from posture_opt.report.figures.truth import truth_figures

        figures |= truth_figures(learned.spread_check)
    return figures | landing(learned.comparison)


def landing(comparison: Comparison | None) -> dict[str, Figure]:
    """The figure of a comparison in which the model before calibration and the reference have a posture."""
    if comparison is None or not {"nominal", comparison.reference} <= set(comparison.answered):
        return {}
    from posture_opt.report.figures.landing import plot_landing

    return {"landing": plot_landing(comparison)}
