"""The report on a calibration: errors of held-out rows, the parameters, and what the data leave open.

Angles are in deg, their errors in mrad, lengths in mm, with as many decimals as the standard error supports.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from posture_opt.calibration.calibration_statements import CORRELATION_SHOWN
from posture_opt.numerics import Json
from posture_opt.report.figures.residuals import chosen_rows
from posture_opt.report.page.presenter import Columns, Drawings, Presenter
from posture_opt.report.page.save import Files
from posture_opt.report.parts.model_tables import (
    comparison_blocks,
    error_table,
    instrument_words,
    mm,
    range_table,
    rows_words,
)
from posture_opt.report.parts.parts import robot_facts
from posture_opt.report.results.assessment_report import (
    assessment_blocks,
    assessment_drawings,
    spread_check_blocks,
    spread_check_drawings,
)
from posture_opt.report.results.comparison_report import comparison_drawings
from posture_opt.report.scene.arm_view import VIEWED_ROWS, ArmView, ShownPosture
from posture_opt.report.scene.posture_views import correction_marks, task_posture
from posture_opt.report.text.blocks import Block, Facts, Table
from posture_opt.report.text.words import MODEL_NAMES
from posture_opt.statements.notation import count, decimals_of, length, sentence
from posture_opt.units import ERROR_UNITS, fixed, number

if TYPE_CHECKING:
    from posture_opt.calibration.calibration import Calibration
    from posture_opt.validation.calibrated_arm import Evaluation


def parameters_block(found: Calibration) -> Block:
    """Every parameter of the arm: nominal value, estimate and standard error, prior, significance, correlations.
    "determined" is yes, no, or "by prior" where only the stated σ determines it; "change / std. error" beyond 1.96 is
    significant for one parameter."""
    shown = [i for i, p in enumerate(found.parameters) if p.group != "place"]
    values = ("parameter", "determined", "nominal [deg, mm]", "estimate [deg, mm]", "change [mrad, mm]")
    headers = (*values, "std. error [mrad, mm]", "change / std. error", "prior [mrad, mm]")
    width = len(headers) - (not np.isfinite(found.prior).any())
    table = Table(headers[:width], tuple(_row(found, i)[:width] for i in shown), text_columns=2)
    known = [i for i in shown if found.fixed[i]]
    C, names = found.correlation, [p.name for p in found.parameters]
    pairs = [(i, j) for a, i in enumerate(known) for j in known[a + 1 :] if abs(C[i, j]) > CORRELATION_SHOWN]
    pairs.sort(key=lambda pair: -abs(C[pair]))
    rows = tuple((names[i], names[j], fixed(float(C[i, j]), 3)) for i, j in pairs[:10])
    correlations = [Table(("estimate", "with", "correlation"), rows, 2)] if rows else []
    return Block("Parameters", (table, *correlations))


def places_blocks(found: Calibration) -> Iterable[Block]:
    """What was found of planes and anchors, in the frame of the base, and what such data cannot show."""
    for one in found.instruments.values():
        if not one.places or found.request.data.touches:
            continue
        places: dict[str, Mapping[str, Json]] = {}
        for name, place in one.places.items():
            # Of a place with several frames, as a camera and its board, each of them.
            inner = {f"{name}: {part}": own for part, own in place.items() if isinstance(own, Mapping)}
            places |= inner or {name: place}
        names = list(dict.fromkeys(key for place in places.values() for key in place))
        rows = []
        for name, place in places.items():
            cells = []
            for key in names:
                (factor, _, decimals), value = _UNITS.get(key, (1.0, "", 5)), place.get(key)
                values: Any = value if isinstance(value, list) else [value]
                text = "" if value is None else ", ".join(f"{factor * float(v):.{decimals}f}" for v in values)
                cells.append(f"({text})" if isinstance(value, list) else text)
            rows.append((name, *cells))
        headers = (one.kind, *(f"{key} [{_UNITS[key][1]}]" if key in _UNITS else key for key in names))
        blind = (f"{sentence(one.blind_spot)}",) if one.blind_spot else ()
        how = "In the world of the file; found together with the arm."
        yield Block(f"What the {one.noun} show", (how, Table(headers, tuple(rows)), *blind))


_UNITS = {
    **dict.fromkeys(("x", "y", "z", "offset", "distance"), (1e3, "mm", 3)),
    **dict.fromkeys(("roll", "pitch", "yaw"), (math.degrees(1.0), "deg", 4)),
    **dict.fromkeys(("focal_length", "principal_point"), (1.0, "px", 2)),
}
"""Unknowns of places with a unit: factor from SI, unit and decimals in reports."""


def _row(found: Calibration, i: int) -> tuple[str, ...]:
    """One parameter as a row of the table: values in deg or mm, errors in mrad or mm."""
    p, std, prior = found.parameters[i], float(found.std[i]), float(found.prior[i])
    of_value = math.degrees(1.0) if p.unit == "rad" else 1e3
    of_error, _ = ERROR_UNITS[p.unit]
    believed = "" if math.isnan(prior) else number(prior * of_error)
    if not found.fixed[i]:
        # A free frame needs some value; this one goes with the rest of the arm as it was drawn.
        some = fixed((p.nominal + float(found.x[i])) * of_value, 3) if p.group in ("base", "tool") else ""
        return p.name, "no", fixed(p.nominal * of_value, 3), some, "", "", "", believed
    nominal, estimate = (fixed(v * of_value, decimals_of(std * of_value)) for v in (p.nominal, p.nominal + found.x[i]))
    change, error = (fixed(v * of_error, decimals_of(std * of_error)) for v in (float(found.x[i]), std))
    how = "yes" if found.identifiability.determined[i] else "by prior"
    z = float(found.z[i])
    times = "" if math.isnan(z) else fixed(z, decimals_of(max(abs(z), 0.1)))
    return p.name, how, nominal, estimate, change, error, times, believed


def determined_words(found: Calibration) -> str:
    """How many unknowns are determined by themselves, and how many together."""
    alone, rank, all_of = int(found.fixed.sum()), found.identifiability.rank, len(found.parameters)
    if alone == all_of:
        return f"all {all_of} unknowns are determined"
    more = f", {rank - alone} more in combination" if rank > alone else ""
    return f"{alone} of {all_of} unknowns are determined individually{more}"


_OPEN = "What the data do not determine"
"""The only one of the detailed blocks that a short report has."""


def undetermined_block(found: Calibration) -> Block:
    """Condition number of the scaled Jacobian and observability indices; the statements name what is undetermined."""
    known = found.identifiability
    indices = ", ".join(f"{name} {value:.3g}" for name, value in known.observability.items())
    # Below 100 estimates lose little to noise (Schröer, Albright, Grethlein 1997).
    facts = (
        ("Determined", f"{known.rank} combinations of {count(len(found.parameters), 'unknown')}"),
        ("Condition", f"{number(known.condition)} (good below 100)"),
        ("Observability", indices),
    )
    return Block(_OPEN, (Facts(facts),))


class CalibrationPresenter(Presenter["Calibration"]):
    """A calibration with what it is held against: its residuals, the spread it predicts, the task planned again."""

    stem = "calibration"
    title = "Calibration"
    asked = "request"
    delivers: ClassVar[tuple[str, ...]] = ("calibrated.yaml",)

    @property
    def evaluation(self) -> Evaluation:
        evaluated: Evaluation = self.result.evaluation
        return evaluated

    def facts(self) -> Iterable[tuple[str, str]]:
        found, (before, after) = self.result, (mm(s.rms) for s in (self.result.nominal, self.result.calibrated))
        return (
            ("Rows", f"{len(found.request.data)}, {count(len(found.outliers), 'outlier')}"),
            (found.request.data.kind.error_words.capitalize(), f"{before} mm RMS before calibration, {after} mm after"),
            ("", "(cross-validated)"),
            ("Parameters", determined_words(found)),
        )

    def blocks(self) -> Iterable[Block]:
        found, evaluation, problem = self.result, self.evaluation, self.problem
        data, test = found.request.data, found.test
        facts = (
            *robot_facts(problem),
            ("File", Path(data.file).name or "table"),
            ("Rows", rows_words(data, problem.robot)),
            *([("Targets", ", ".join(data.target_names))] if len(data.target_names) > 1 else []),
            ("Instrument", instrument_words(problem, data)),
            ("Parameters", determined_words(found)),
        )
        models = {MODEL_NAMES[name]: getattr(found, name) for name in ("nominal", "calibrated")}
        off = np.linalg.norm(found.errors[list(found.outliers)], axis=1).tolist()
        outliers = tuple((str(line), mm(size)) for line, size in zip(found.lines, off, strict=True))[:20]
        tests: tuple[Table, ...] = ()
        if test is not None:
            names = {name: MODEL_NAMES[name] for name in test.models}
            errors = {names[name]: statistics for name, statistics in test.models.items()}
            tests = (error_table(errors, test.data), *range_table(test, names))
        detailed = (
            *assessment_blocks(evaluation.assessment),
            *spread_check_blocks(evaluation.spread_check),
            parameters_block(found),
            *places_blocks(found),
            undetermined_block(found),
            Block("Outliers", (Table(("line", "off by [mm]"), outliers, text_columns=0),) if outliers else ()),
            Block("Test file", tests),
            *comparison_blocks(evaluation.comparison),
        )
        yield Block("What the simulation gets wrong", (error_table(models, data),))
        yield from (block if block.title == _OPEN else replace(block, brief=()) for block in detailed)
        yield Block("Data", (Facts(facts),))

    def drawings(self) -> Drawings:
        return {
            **assessment_drawings(self.evaluation.assessment),
            **spread_check_drawings(self.evaluation.spread_check),
            **comparison_drawings(self.evaluation.comparison),
        }

    def view(self) -> ArmView:
        """The posture of the task with its spread and the corrections at their joints; then measured rows, a choice of
        many, coloured by their error after calibration."""
        found, calibrated = self.result, self.evaluation.models["calibrated"]
        data = found.request.data
        before, after = (np.linalg.norm(errors, axis=1) for errors in (found.errors_nominal, found.errors))
        rows = found.kept_rows[chosen_rows(len(found.kept_rows), VIEWED_ROWS)]
        rows = rows[np.argsort(-after[rows], kind="stable")]
        rows = rows[np.unique(data.line[rows], return_index=True)[1]]  # of several numbers of one line, the worst
        q, spread = task_posture(calibrated, self.evaluation.comparison, data.q)
        marks = correction_marks(found, calibrated)
        first = ShownPosture("corrections", "corrections of the arm", q, spread=spread, marks=marks)
        measured = []
        for k in rows:
            left, line = float(after[k]), data.line[k]
            facts = (("Error before calibration", length(float(before[k]))), ("Error after", length(left)))
            label = f"line {line}: {length(left)} off after calibration"
            measured.append((ShownPosture(f"line-{line}", label, data.q[k], facts), left))
        return ArmView.coloured(calibrated, "Shown", measured, "error after calibration", first)

    def columns(self) -> Columns:
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
        calibrated: Files = self.evaluation.models["calibrated"].files("calibrated")
        return calibrated
