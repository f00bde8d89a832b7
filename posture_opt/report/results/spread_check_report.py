"""The report on whether the predicted spread is true, between repeats and over all postures.

Coverage tests regions against measured points: 95 % of them should lie in their 95 % regions. Repeats test scatter
alone, as systematic errors are the same in every repeat.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

from posture_opt.report.figures.spread_check import plot_joint_scatter, plot_reliability
from posture_opt.report.page.presenter import Columns, Drawings, Presenter, problem_of
from posture_opt.report.text.blocks import Block, Document, Summary, Table
from posture_opt.report.text.words import MODEL_NAMES
from posture_opt.statements import p_value
from posture_opt.statements.notation import angle_error, length, percent, stated_length
from posture_opt.units import number
from posture_opt.validation.spread_check import SpreadCheck

if TYPE_CHECKING:
    from posture_opt.selection.problem_data import ProblemData
    from posture_opt.validation.coverage import Coverage

_MAX_POSTURES = 8
_ZERO_SHARE = 1e-3  # of the upper end of an interval: less than that is zero


def spread_check_blocks(found: SpreadCheck) -> tuple[Block, ...]:
    """Coverage of the predicted regions, repeats against the prediction, scatter of each joint where estimated."""
    noise = (joints_block(found),) if found.noise is not None else ()
    return coverage_block(found), repeats_block(found), *noise


def coverage_block(found: SpreadCheck) -> Block:
    """How much of what was measured the predicted regions hold.

    Columns, a row a model:
      contains: share of the measured points in their region, with its 95 % interval;
      if correct: range in which that share would lie if the prediction were true;
      scale by: factor on all standard deviations that would make it true, with its interval.
    """
    how = "Each row is compared with the region that a fit without it predicts for its posture, instrument included."
    rows = tuple((MODEL_NAMES[name], *_coverage_cells(c)) for name, c in found.coverage.items())
    headers = ("95 % region", "contains", "95 % interval", "if correct", "scale by", "95 % interval")
    return Block("Coverage of the predicted spread", (how, Table(headers, rows)), "truth_coverage")


def _coverage_cells(c: Coverage) -> tuple[str, ...]:
    """The numbers of one model: share, interval, share if correct, factor, interval."""
    ends = [" to ".join(map(percent, interval)) for interval in (c.interval, c.expected)]
    return percent(c.share), *ends, number(c.factor), " to ".join(map(number, c.factor_interval))


def repeats_block(found: SpreadCheck) -> Block:
    """One row a posture, the most repeated first: measured and predicted size [mm], ratio, p of size and of shape."""
    title, test = "Repeats against the predicted scatter", found.repeats
    if test is None:
        return Block(title, ())
    headers = ("line", "repeats", "measured [mm]", "predicted [mm]", "ratio", "p, size", "p, shape", "as predicted")
    rows = tuple(
        (
            str(pose.line), str(pose.n), number(1e3 * pose.measured), number(1e3 * pose.predicted),
            number(pose.factor), p_value(pose.p_size), "" if math.isnan(pose.p_shape) else p_value(pose.p_shape),
            "yes" if pose.true else "no",
        )
        for pose in test.poses[:_MAX_POSTURES]
    )  # fmt: skip
    more = [f"and {test.groups - _MAX_POSTURES} more"] if test.groups > _MAX_POSTURES else []
    return Block(title, (Table(headers, rows, text_columns=0), *more))


def joints_block(found: SpreadCheck) -> Block:
    """σ of each joint and of the instrument; a joint that hardly moves the tool point is "undetermined"."""
    noise = found.noise
    assert noise is not None
    rows = []
    for name, given, sigma, std, ends, known in zip(
        noise.names, found.stated_sigma, noise.sigma, noise.std, noise.interval, found.shown, strict=True
    ):
        stated, write = (stated_length, length) if name.endswith(".d") else (angle_error, angle_error)
        values = tuple(map(float, (sigma, std, *ends)))
        cells = (
            _cells(values, partial(write, digits=2)) if known else ("undetermined", "", "hardly moves the tool point")
        )
        rows.append((name, stated(float(given)) if given else "", *cells))
    values = (noise.instrument, noise.instrument_std, *noise.instrument_interval)
    known = math.isfinite(noise.instrument_std)
    among = [noise.instrument_interval[1]]
    cells = _cells(values, partial(length, digits=2, among=among)) if known else ("undetermined", "", "not separable")
    rows.append(("instrument", stated_length(found.instrument), *cells))
    headers = ("scatter (standard deviation)", "stated", "estimated", "std. error", "95 % interval")
    return Block("Scatter of each joint", (Table(headers, tuple(rows)),), "truth_joints")


def _cells(values: tuple[float, ...], write: Callable[[float], str]) -> tuple[str, str, str]:
    """Estimate, standard error and 95 % interval; zero where the interval begins at zero."""
    sigma, std, low, high = values
    zero = _ZERO_SHARE * high
    interval = f"below {write(high)}" if low <= zero else f"{write(low)} to {write(high)}"
    return write(sigma) if sigma > zero else "0", write(std), interval


class SpreadCheckPresenter(Presenter[SpreadCheck]):
    """Predicted spread against measured errors."""

    stem = "spread_check"

    @property
    def problem(self) -> ProblemData:
        """The problem whose stated spread is checked."""
        return problem_of(self.result.calibration.request)

    def summary(self) -> Summary:
        """Coverage by model, scatter between repeats, and the RMS that the calibration leaves."""
        found = self.result
        shares = [(f"In 95 % regions, {MODEL_NAMES[name]}", percent(p)) for name, p in found.coverage95.items()]
        repeats = [("Between repeats", length(found.repeat_sigma))] if found.repeat_sigma else []
        facts = (*shares, *repeats, ("Left by the calibration", f"{length(found.residual_rms)} a coordinate (RMS)"))
        return Summary(f"Check of the predicted spread: {self.problem.name}", facts)

    def document(self) -> Document:
        """Coverage, repeats, joints."""
        return Document(self.problem.name or "Spread", self.result.statements, spread_check_blocks(self.result))

    def drawings(self) -> Drawings:
        """Coverage of the predicted regions, and the scatter of the joints."""
        return spread_check_drawings(self.result)

    def columns(self) -> Columns:
        """The share of the rows in the predicted 95 % region, by model."""
        shares = self.result.coverage95
        return {"model": list(shares), "share in the 95 % region": list(shares.values())}


def spread_check_drawings(found: SpreadCheck) -> Drawings:
    """Coverage of the predicted regions, and the scatter of the joints where it was estimated."""
    joints: Drawings = {} if found.noise is None else {"truth_joints": partial(plot_joint_scatter, found)}
    return {"truth_coverage": partial(plot_reliability, found), **joints}
