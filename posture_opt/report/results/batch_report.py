"""Reports on several robots of one type, calibrated or diagnosed: how they differ, and what they have in common."""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from posture_opt.model.effects.base.cause import FittedSizes
from posture_opt.problem.effects_section import of_a_type
from posture_opt.problem.fitted_problem import batch_yaml
from posture_opt.report.figures.batch import plot_batch
from posture_opt.report.page.presenter import Columns, Drawings, Presenter, problem_of
from posture_opt.report.page.save import Files
from posture_opt.report.parts.model_tables import error_table
from posture_opt.report.parts.parts import note_facts, robot_facts
from posture_opt.report.text.blocks import Block, Facts, Table
from posture_opt.report.text.words import MODEL_NAMES
from posture_opt.statements import p_value
from posture_opt.statements.notation import count, decimals_of, percent
from posture_opt.units import ERROR_UNITS, fixed, number

if TYPE_CHECKING:
    from posture_opt import Batch, BatchDiagnosis

_MAX_ROBOTS = 20


def batch_blocks(found: Batch) -> tuple[Block, ...]:
    """Variation across the batch, correlations, errors robot by robot, data."""
    return _spread_block(found), _pairs_block(found), _errors_block(found), _data_block(found)


def _data_block(found: Batch) -> Block:
    data, problem = found.data, problem_of(found)
    names = ", ".join(found.robots[:_MAX_ROBOTS]) + (" …" if len(found.robots) > _MAX_ROBOTS else "")
    facts = [
        ("File", Path(data.file).name or "table"),
        ("Rows", f"{len(data)} of {count(len(found.robots), 'robot')}: {names}"),
    ]
    notes = note_facts((*data.warnings, *data.notes, *problem.notes, *found.notes))
    return Block("Data", (Facts((*robot_facts(problem), *facts, *notes)),))


def _errors_block(found: Batch) -> Block:
    """Errors of held-out rows of the whole batch with their coverage over robots, and robot by robot [mm]."""
    how = "Every row is predicted by a calibration of its own robot that was fitted without its group of rows."
    models = {MODEL_NAMES[name]: getattr(found, name) for name in ("nominal", "calibrated")}
    shares = tuple(
        (MODEL_NAMES[name], percent(share), " to ".join(map(percent, ends)))
        for name, (share, ends) in found.coverage.items()
    )
    coverage = Table(("rows in their predicted 95 % region", "share", "95 % interval over robots"), shares)
    rows = tuple(
        (name, str(len(mine)), number(1e3 * c.nominal.rms), number(1e3 * c.calibrated.rms), str(len(c.outliers)))
        for name, mine, c in zip(found.robots, found.rows, found.calibrations, strict=True)
    )
    headers = ("robot", "rows", "before calibration, RMS [mm]", "calibrated, RMS [mm]", "outliers")
    more = [f"and {len(rows) - _MAX_ROBOTS} more"] if len(rows) > _MAX_ROBOTS else []
    table = Table(headers, rows, worst=found.worst).cut(_MAX_ROBOTS)
    return Block("Position errors", (how, error_table(models), coverage, table, *more))


def _spread_block(found: Batch) -> Block:
    """Mean and standard deviation of each parameter across the batch, in mrad or mm.

    Columns:
      mean deviation: from the file, ± one standard error;
      off nominal: whether the file should be changed;
      σ across: standard deviation between robots, with its 95 % interval ("below" where it begins at zero).
    """
    rows = []
    for k, p in enumerate(found.parameters):
        factor, unit = ERROR_UNITS[p.unit]
        mean, error = factor * float(found.spread.mean[k]), factor * float(found.spread.mean_std[k])
        places = decimals_of(error)
        low, high = factor * found.spread.interval[k]
        interval = f"below {number(high)}" if low == 0 else f"{number(low)} to {number(high)}"
        sigma, stated = (factor * float(values[k]) for values in (found.spread.sigma, found.stated))
        off = "yes" if found.off_nominal[k] else "no"
        deviation = f"{fixed(mean, places)} ± {fixed(error, places)}"
        rows.append((p.name, unit, deviation, off, number(sigma), interval, number(stated) if stated else ""))
    headers = ("parameter", "unit", "mean deviation", "off nominal", "σ across", "95 % interval", "stated σ")
    text = "Robots are calibrated without priors; standard errors are subtracted from the variation between them."
    return Block("Across the batch", (text, Table(headers, tuple(rows), text_columns=2)))


def _pairs_block(found: Batch) -> Block:
    rows = tuple(
        (
            f"{p.a}, {p.b}", fixed(p.correlation), " to ".join(map(fixed, p.interval)),
            fixed(p.stated) if p.stated else "", "yes" if p.significant else "no",
        )
        for p in found.known_pairs[:8]
    )  # fmt: skip
    table = Table(("parameters", "correlation", "95 % interval", "stated", "significant"), rows)
    return Block("Correlations between parameters", (table,) if rows else (), "batch")


def batch_facts(found: Batch) -> tuple[tuple[str, str], ...]:
    """Robots, errors and what varies together, in a few lines; the last one only for a significant correlation."""
    before, after = (number(1e3 * s.rms) for s in (found.nominal, found.calibrated))
    real = [pair for pair in found.pairs if pair.significant]
    together = [("Correlated", f"{real[0].a} and {real[0].b}, {fixed(real[0].correlation)}")] if real else []
    return (
        ("Robots", f"{len(found.robots)}, {count(len(found.data), 'row')} in all"),
        ("Position error", f"{before} mm RMS before calibration, {after} mm calibrated (cross-validated)"),
        ("Parameters", f"{len(found.parameters)} determined for every robot"),
        *together,
    )


def batch_drawings(found: Batch) -> Drawings:
    """How two parameters vary together, where there are two."""
    return {"batch": partial(plot_batch, problem_of(found), found)} if found.pairs else {}


class BatchPresenter(Presenter["Batch"]):
    """Several robots of one type, calibrated; ``uncertainty.yaml`` holds how they differ."""

    stem = "calibration"
    title = "Batch"
    heading = "Calibration of several robots of one type"
    delivers: ClassVar[tuple[str, ...]] = ("uncertainty.yaml",)

    def facts(self) -> Iterable[tuple[str, str]]:
        return batch_facts(self.result)

    def blocks(self) -> Iterable[Block]:
        return batch_blocks(self.result)

    def drawings(self) -> Drawings:
        return batch_drawings(self.result)

    def columns(self) -> Columns:
        """Mean and standard deviation of each parameter across the batch, SI units, next to the stated ones."""
        found = self.result
        return {
            "parameter": found.names,
            "unit": [p.unit for p in found.parameters],
            "mean deviation": found.spread.mean,
            "its standard error": found.spread.mean_std,
            "sigma across": found.spread.sigma,
            "sigma stated": found.stated,
        }

    def files(self) -> Files:
        return {"uncertainty.yaml": batch_yaml(self.problem, self.result).encode()}


def _causes(found: BatchDiagnosis) -> Block:
    rows = []
    for finding in found.effects:
        sizes = ", ".join(f"{size.label} {size}" for size in finding.cause.sizes(FittedSizes(finding.estimate)))
        rows.append((finding.cause.label, sizes, p_value(finding.p_value)))
    table = Table(("cause", "size", "p-value"), tuple(rows), text_columns=3)
    return Block("Causes", (table,) if rows else ())


class BatchDiagnosisPresenter(Presenter["BatchDiagnosis"]):
    """What several robots of one type show together; ``uncertainty.yaml`` is the section for their problem file."""

    stem = "diagnosis"
    title = "Diagnosis"
    heading = "Diagnosis of several robots of one type"
    asked = "batch"
    delivers: ClassVar[tuple[str, ...]] = ("uncertainty.yaml",)

    def facts(self) -> Iterable[tuple[str, str]]:
        named = "; ".join(f.cause.label for f in self.result.effects) or "none"
        return ("Verdict", self.result.verdict), ("Causes", named), *batch_facts(self.result.batch)[:3]

    def blocks(self) -> Iterable[Block]:
        return _causes(self.result), *batch_blocks(self.result.batch)

    def drawings(self) -> Drawings:
        return batch_drawings(self.result.batch)

    def columns(self) -> Columns:
        return {name: [getattr(f, name) for f in self.result.effects] for name in ("kind", "target", "p_value")}

    def files(self) -> Files:
        noises = [f.noise for f in self.result.effects if f.noise is not None]
        of_arm = [noise for noise in noises if noise.of_arm and not of_a_type(noise)]
        return {"uncertainty.yaml": batch_yaml(self.problem, self.result.batch, of_arm).encode()}
