"""The report on a batch of robots of one type: how they differ, and what that makes of the problem file.

Each robot is calibrated by itself. Across the batch, mean and standard deviation of each parameter are estimated, less
the standard errors of the estimates, and the correlations between parameters.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from posture_opt.calibration.calibration_statements import refuted_of_robots
from posture_opt.problem.fitted_problem import batch_yaml
from posture_opt.report.figures.batch import plot_batch
from posture_opt.report.measured_parts.error_table import error_table, mm
from posture_opt.report.page.presenter import Columns, Drawings, Presenter, problem_of
from posture_opt.report.page.save import Files
from posture_opt.report.parts.parts import note_facts, robot_facts
from posture_opt.report.text.blocks import Block, Facts, Report, Summary, Table
from posture_opt.report.text.words import source_words
from posture_opt.statements.notation import count, decimals_of, percent
from posture_opt.units import ERROR_UNITS, fixed, number

if TYPE_CHECKING:
    from posture_opt.batch.batch_calibration import Batch
    from posture_opt.batch.batch_covariance import CorrelatedPair
    from posture_opt.selection.problem_data import ProblemData

_MAX_ROBOTS = 20
_MAX_PAIRS = 8
_MAX_NAMED_PARAMETERS = 4  # parameters on the first screen
_MIN_ROBOTS = 10  # robots: with fewer, a correlation is hardly determined


def batch_report(found: Batch) -> Report:
    """Data, errors robot by robot, variation across the batch, correlations, the section for the problem file."""
    problem = problem_of(found)
    blocks = (
        _data_block(problem, found),
        _errors_block(found),
        _spread_block(problem, found),
        _pairs_block(found),
        _section_block(),
    )
    lead = (*(one.text for one in refuted_of_robots(found.calibrations)), _answer(problem, found), _errors(found))
    return Report(problem.name or "Batch", lead, blocks)


def _answer(problem: ProblemData, found: Batch) -> str:
    """The strongest significant correlation with its interval, or that there is none."""
    real = [pair for pair in found.pairs if pair.significant]
    many = count(len(found.robots), "robot")
    if not real:
        return f"{many} of one type: no significant correlation between their parameters."
    first = real[0]
    a, b = (source_words(name, problem.arm) for name in (first.a, first.b))
    also = f", and {count(len(real) - 1, 'other pair')} too" if len(real) > 1 else ""
    return f"{many} of one type: {a} and {b} are correlated, {_rho(first)}{also}."


def _rho(pair: CorrelatedPair) -> str:
    """A correlation with its 95 % interval."""
    low, high = pair.interval
    return f"{fixed(pair.correlation)} ({fixed(low)} to {fixed(high)} with 95 % confidence)"


def _errors(found: Batch) -> str:
    """RMS position error [mm] of all robots before and after calibration."""
    before, after = (number(1e3 * s.rms) for s in (found.nominal, found.calibrated))
    return f"Calibrated one by one, their position errors go from {before} mm to {after} mm RMS."


def _data_block(problem: ProblemData, found: Batch) -> Block:
    """The file, the robots with their number of rows, and what looks odd in either."""
    data = found.data
    names = ", ".join(found.robots[:_MAX_ROBOTS]) + (" …" if len(found.robots) > _MAX_ROBOTS else "")
    facts = [
        ("File", Path(data.file).name or "table"),
        ("Rows", f"{len(data)} of {count(len(found.robots), 'robot')}: {names}"),
    ]
    notes = note_facts((*data.warnings, *data.notes, *problem.notes, *found.notes))
    return Block("Data", (Facts((*robot_facts(problem), *facts, *notes)),))


def _errors_block(found: Batch) -> Block:
    """Errors of the whole batch, and robot by robot.

    Every row is predicted by a fit to the other groups of rows of its own robot. The second table has a row a robot:
    rows, RMS [mm] before and after, and how many rows were left out as outliers.
    """
    how = "Every row is predicted by a calibration of its own robot that was fitted without its group of rows."
    whole = error_table({"before calibration": found.nominal, "calibrated": found.calibrated})
    texts = [_coverage_text(name, found) for name in found.coverage]
    rows = [
        (name, str(len(mine)), number(1e3 * c.nominal.rms), number(1e3 * c.calibrated.rms), str(len(c.outliers)))
        for name, mine, c in zip(found.robots, found.rows, found.calibrations, strict=True)
    ]
    headers = ("robot", "rows", "before calibration, RMS [mm]", "calibrated, RMS [mm]", "outliers")
    more = [f"and {len(rows) - _MAX_ROBOTS} more"] if len(rows) > _MAX_ROBOTS else []
    worst = int(np.argmax([c.calibrated.rms for c in found.calibrations]))
    table = Table(headers, tuple(rows), worst=worst).cut(_MAX_ROBOTS)
    return Block("Position errors", (how, whole, *texts, table, *more))


def _coverage_text(name: str, found: Batch) -> str:
    """Share of all rows in their predicted 95 % region, with an interval over robots, not over rows."""
    share, (low, high) = found.coverage[name]
    who = {"nominal": "before calibration", "calibrated": "after calibration"}[name]
    held = f"{who[:1].upper()}{who[1:]}, {percent(share)} of all rows lie in their predicted 95 % region"
    return f"{held} (95 % confidence over robots: {percent(low)} to {percent(high)})."


def _spread_block(problem: ProblemData, found: Batch) -> Block:
    """Mean and standard deviation of each parameter across the batch, in mrad or mm.

    Columns:
      mean deviation: from the file, ± one standard error;
      off nominal: whether it exceeds t(0.975, robots − 1) standard errors, so that the file should be changed;
      σ across: standard deviation between robots, with its 95 % interval ("below" where the interval begins at zero);
      stated σ: that of the problem file, empty where it has none.
    """
    from scipy.special import stdtrit

    sure = float(stdtrit(len(found.robots) - 1, 0.975))
    rows = []
    for k, p in enumerate(found.parameters):
        factor, unit = ERROR_UNITS[p.unit]
        mean, error = factor * float(found.spread.mean[k]), factor * float(found.spread.mean_std[k])
        sigma, (low, high) = factor * float(found.spread.sigma[k]), factor * found.spread.interval[k]
        places = decimals_of(error)
        interval = f"below {number(high)}" if low == 0 else f"{number(low)} to {number(high)}"
        stated = number(factor * float(found.stated[k])) if found.stated[k] else ""
        off = "no" if abs(mean) <= sure * error else "yes"
        rows.append(
            (p.name, unit, f"{fixed(mean, places)} ± {fixed(error, places)}", off, number(sigma), interval, stated)
        )
    headers = ("parameter", "unit", "mean deviation", "off nominal", "σ across", "95 % interval", "stated σ")
    text = (
        "Every robot is calibrated separately, without priors; the standard errors of its estimates are subtracted "
        "from the variation between robots (restricted likelihood). Off nominal: the mean differs from the file."
    )
    left = (
        [f"Not determined by the data of every robot: {', '.join(found.undetermined)}."] if found.undetermined else []
    )
    return Block("Across the batch", (text, Table(headers, tuple(rows), text_columns=2), *left))


def _pairs_block(found: Batch) -> Block:
    """Which parameters vary together.

    Listed are pairs that are significant, stated in the file, or known to within an interval shorter than 1; the level
    of 5 % is that of all pairs together. With fewer than ten robots a sentence says that more are needed.
    """
    title = "Correlations between parameters"
    if not found.pairs:
        return Block(title, ("Only one parameter is determined: there are no correlations.",))
    telling = [p for p in found.pairs if p.significant or p.stated or np.ptp(p.interval) < 1]
    shown = telling[:_MAX_PAIRS] or list(found.pairs[:1])
    rows = tuple(
        (
            f"{p.a}, {p.b}", fixed(p.correlation), f"{fixed(p.interval[0])} to {fixed(p.interval[1])}",
            fixed(p.stated) if p.stated else "", "yes" if p.significant else "no",
        )
        for p in shown
    )  # fmt: skip
    real = sum(p.significant for p in found.pairs)
    pairs = count(len(found.pairs), "pair")
    text = f"Of {pairs} {real} {'is' if real == 1 else 'are'} significantly correlated (family-wise level 5 %)."
    few = (
        [f"{_MIN_ROBOTS} robots or more would determine correlations better."]
        if len(found.robots) < _MIN_ROBOTS
        else []
    )
    table = Table(("parameters", "correlation", "95 % interval", "stated", "significant"), rows)
    return Block(title, (text, table, *few), "batch")


def _section_block() -> Block:
    """What ``uncertainty.yaml`` holds and what it is for."""
    text = (
        "uncertainty.yaml holds this as a section of the problem file: the estimated σ's (where none was found, "
        "those stated) and the significant correlations. With it the program plans for any robot of this type."
    )
    return Block("For the problem file", (text,))


def batch_facts(found: Batch) -> tuple[tuple[str, str], ...]:
    """Robots, errors and what varies together, in a few lines; the last one only for a significant correlation."""
    before, after = (number(1e3 * s.rms) for s in (found.nominal, found.calibrated))
    real = [pair for pair in found.pairs if pair.significant]
    together = [("Correlated", f"{real[0].a} and {real[0].b}, {_rho(real[0])}")] if real else []
    return (
        ("Robots", f"{len(found.robots)}, {count(len(found.data), 'row')} in all"),
        ("Position error", f"{before} mm RMS before calibration, {after} mm calibrated (cross-validated)"),
        ("Parameters", f"{len(found.parameters)} determined for every robot"),
        *together,
    )


def batch_brief(found: Batch) -> Report:
    """The lead of the whole report and a line on each of its parts, on one screen.

    "Next" asks for more robots below ten, and else says to plan with the section for the problem file.
    """
    worst = max(range(len(found.robots)), key=lambda i: found.calibrations[i].calibrated.rms)
    left = found.undetermined
    names = ", ".join(left[:_MAX_PAIRS]) + (f" and {len(left) - _MAX_PAIRS} more" if len(left) > _MAX_PAIRS else "")
    plan = "plan for the type with uncertainty.yaml, which --out DIR writes."
    many = "measure more robots: ten or more determine correlations better."
    facts = [
        ("Measured", f"{count(len(found.data), 'row')} of {count(len(found.robots), 'robot')}"),
        ("Errors", f"the largest calibrated RMS is {mm(found.calibrations[worst].calibrated.rms)} mm, of "
                   f"{found.robots[worst]}"),
        ("Varying", _varying(found)),
        *([("Undetermined", names)] if left else []),
        ("Next", many if len(found.robots) < _MIN_ROBOTS else plan),
    ]  # fmt: skip
    problem = problem_of(found)
    lead = (*(one.text for one in refuted_of_robots(found.calibrations)), _answer(problem, found), _errors(found))
    return Report(problem.name or "Batch", lead, (Block("", (Facts(tuple(facts)),)),))


def _varying(found: Batch) -> str:
    """The parameters that vary from robot to robot, each with its σ: those whose interval does not reach zero."""
    sizes = []
    for k, p in enumerate(found.parameters):
        factor, unit = ERROR_UNITS[p.unit]
        if found.spread.interval[k][0] > 0:
            sizes.append(f"{p.name} by {number(factor * float(found.spread.sigma[k]), 2)} {unit}")
    more = f" and {len(sizes) - _MAX_NAMED_PARAMETERS} more" if len(sizes) > _MAX_NAMED_PARAMETERS else ""
    return (
        f"{', '.join(sizes[:_MAX_NAMED_PARAMETERS])}{more} (σ from robot to robot)"
        if sizes
        else "no parameter, significantly"
    )


class BatchPresenter(Presenter["Batch"]):
    """Several robots of one type, calibrated; ``uncertainty.yaml`` holds how they differ."""

    stem = "calibration"
    delivers: ClassVar[tuple[str, ...]] = ("uncertainty.yaml",)

    def summary(self) -> Summary:
        """Robots, errors, determined parameters, correlations."""
        return Summary(f"Calibration of several robots of one type: {self.problem.name}", batch_facts(self.result))

    def document(self) -> Report:
        """The whole report, a block a question."""
        return batch_report(self.result)

    def brief(self) -> Report:
        """The report on one screen."""
        return batch_brief(self.result)

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
