"""The report on a batch of robots of one type: how they differ, and what that makes of the problem file.

Each robot is calibrated by itself. Across the batch, mean and standard deviation of each parameter are estimated, less
the standard errors of the estimates, and the correlations between parameters.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from posture_opt.problem.fitted_problem import batch_yaml
from posture_opt.report.figures.batch import plot_batch
from posture_opt.report.measured_parts.error_table import error_table
from posture_opt.report.page.presenter import Columns, Drawings, Presenter, problem_of
from posture_opt.report.page.save import Files
from posture_opt.report.parts.parts import note_facts, robot_facts
from posture_opt.report.text.blocks import Block, Document, Facts, Summary, Table
from posture_opt.report.text.words import MODEL_NAMES
from posture_opt.statements.notation import count, decimals_of, percent
from posture_opt.units import ERROR_UNITS, fixed, number

if TYPE_CHECKING:
    from posture_opt.batch.batch_calibration import Batch

_MAX_ROBOTS = 20
_MAX_PAIRS = 8


def batch_blocks(found: Batch) -> tuple[Block, ...]:
    """Variation across the batch, correlations, errors robot by robot, data."""
    return _spread_block(found), _pairs_block(found), _errors_block(found), _data_block(found)


def _data_block(found: Batch) -> Block:
    """The file, the robots with their number of rows, and what looks odd in either."""
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
    """Which parameters vary together; the level of 5 % is that of all pairs together."""
    rows = tuple(
        (
            f"{p.a}, {p.b}", fixed(p.correlation), " to ".join(map(fixed, p.interval)),
            fixed(p.stated) if p.stated else "", "yes" if p.significant else "no",
        )
        for p in found.known_pairs[:_MAX_PAIRS]
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


class BatchPresenter(Presenter["Batch"]):
    """Several robots of one type, calibrated; ``uncertainty.yaml`` holds how they differ."""

    stem = "calibration"
    delivers: ClassVar[tuple[str, ...]] = ("uncertainty.yaml",)

    def summary(self) -> Summary:
        """Robots, errors, determined parameters, correlations."""
        return Summary(f"Calibration of several robots of one type: {self.problem.name}", batch_facts(self.result))

    def document(self) -> Document:
        """The whole report, a block a question."""
        return Document(self.problem.name or "Batch", self.result.statements, batch_blocks(self.result))

    def drawings(self) -> Drawings:
        """How two parameters vary together, where there are two."""
        found = self.result
        return {"batch": partial(plot_batch, self.problem, found)} if found.pairs else {}

    def columns(self) -> Columns:
        """Mean and standard deviation of each parameter across the batch, SI units.

        "mean deviation" is from the file, "sigma across" between robots, "sigma stated" that of the file or 0.
        """
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
        """The section for the problem file."""
        return {"uncertainty.yaml": batch_yaml(self.problem, self.result).encode()}
