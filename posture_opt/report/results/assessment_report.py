"""Reports on what a model gets wrong, whether the rest is scatter, and whether the predicted spread is true."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from posture_opt.report.figures.residual_scatter import plot_region, plot_repeats, plot_shape
from posture_opt.report.figures.residual_trends import plot_residuals_over_inputs, plot_residuals_over_joints
from posture_opt.report.figures.residuals import Shown, plot_residual_vectors
from posture_opt.report.figures.spread_check import plot_joint_scatter, plot_reliability
from posture_opt.report.page.presenter import Columns, Drawings, Presenter, problem_of
from posture_opt.report.text.blocks import Block, Facts, Table
from posture_opt.report.text.words import MODEL_NAMES, direction_words, line_words
from posture_opt.statements import p_value
from posture_opt.statements.notation import angle_error, count, length, lengths, percent, shift, stated_length
from posture_opt.units import fixed, number
from posture_opt.validation.assessment import NORMAL_TAIL, Assessment
from posture_opt.validation.spread_check import SpreadCheck

if TYPE_CHECKING:
    from posture_opt.validation.model_errors import ModelErrors
    from posture_opt.validation.repeatability_tests import Repeats

_TOTALS = {1: "in all", 2: "in the plane", 3: "in space"}
MODELS = {name: MODEL_NAMES[name] for name in ("nominal", "calibrated")}


def assessment_blocks(found: Assessment) -> tuple[Block, ...]:
    """Every table on what a model gets wrong, the figures with them; the statements stand in their sections."""
    return (
        directions_block(found),
        *([goals_block(found)] if found.goals is not None else []),
        mean_block(found),
        Block("Errors over time and other inputs", (), "residual_inputs"),
        scatter_block(found),
        *measures_blocks(found),
        repeats_block(found),
    )


def directions_block(found: Assessment) -> Block:
    """Bias, RMS, mean, 95 % and maximum [mm] by axis and by the task's direction, before and after calibration."""
    models = {name: getattr(found, name) for name in MODELS}
    smallest = min(d.rms for model in models.values() for d in model.deviations)
    decimals = 3 if smallest >= 1e-5 or smallest <= 0 else 4
    data, d = found.calibration.request.data, found.direction
    names = dict(zip("xyz", data.kind.axis_names, strict=False)) | {"all": _TOTALS[len(found.axes)]}
    if d is not None:
        names |= {"along": f"along the task ({direction_words(d)})", "across": "across the task"}
    rows = tuple(
        (
            names[pair[0].name] if k == 0 else "",
            model,
            *(fixed(1e3 * value, decimals) for value in (d.bias, d.rms, d.mean, d.p95, d.max)),
        )
        for pair in zip(*(model.deviations for model in models.values()), strict=True)
        for k, (model, d) in enumerate(zip(MODELS.values(), pair, strict=True))
    )
    headers = ("measured minus model [mm]", "model", "bias", "RMS", "mean", "95 % below", "max")
    how = "Bias keeps its sign; RMS, mean, 95 % and max are of the length of the error vector."
    figure = "residual_vectors" if len(data.kind.axis_names) == 3 else ""
    return Block("Errors by direction", (how, Table(headers, rows, text_columns=2)), figure)


def goals_block(found: Assessment) -> Block:
    """How far apart the postures of one target land: an error that does not depend on the posture cancels here."""
    goals = found.goals
    assert goals is not None
    apart = {"measured apart": goals.measured}
    apart |= {f"predicted apart, {words}": goals.said[name] for name, words in MODELS.items()}
    apart |= {f"prediction error, {words}": goals.missed[name] for name, words in MODELS.items()}
    rows = [(what, *(fixed(1e3 * v, 3) for v in (d.median, d.p95, d.max))) for what, d in apart.items()]
    text = f"{count(goals.goals, 'target')} with two postures or more, {count(goals.pairs, 'pair')} of postures."
    return Block("One target, several postures", (text, Table(("[mm]", "median", "95 % below", "max"), tuple(rows))))


def mean_block(found: Assessment) -> Block:
    """The test of the mean over all rows, and of those in parts of the workspace (of joint values, of touches)."""
    rows = tuple((words, *_mean_cells(getattr(found, name))) for name, words in MODELS.items())
    headers = ("model", "mean error", "standard error", "p-value", "parts off zero")
    return Block("Are the residuals pure scatter?", (Table(headers, rows, text_columns=5),), "residual_joints")


def _mean_cells(model: ModelErrors) -> tuple[str, ...]:
    """Mean, standard error and p-value over all rows, and how many parts have a mean that is not zero."""
    off = f"{sum(not block.zero for block in model.blocks)} of {len(model.blocks)}" if model.blocks else "not tested"
    test = model.mean
    if test is None:
        return "fitted", "", "", off
    # Below a tenth of its standard error on all axes, the fit has made the mean zero: chance hardly would.
    if np.all(np.abs(test.mean) <= 0.1 * test.error):
        return "zero, as fitted", "", "", off
    mean, error = test.mean.tolist(), test.error.tolist()
    return shift(mean), shift(error, among=mean), p_value(test.p_value), off


def scatter_block(found: Assessment) -> Block:
    """The 95 % region of the residuals, semi-axes ``k sqrt(eigenvalue)`` of ``C = (1/l) Σ Δx Δxᵀ`` over l rows."""
    left = found.residual_scatter
    if left is None:
        return Block("Residual scatter", ())
    ellipse = left.ellipse
    axes = np.zeros((ellipse.rank, 3))
    axes[:, list(found.axes)] = ellipse.axes.T[::-1][: ellipse.rank]
    names = found.calibration.request.data.kind.axis_names
    along = ", ".join(map(line_words, axes)) if len(names) == 3 else f"the errors {', '.join(names)}"
    half = lengths([float(s) for s in (left.factor * ellipse.semi_axes)[::-1][: ellipse.rank]])
    facts = (
        ("Rows", f"{left.samples} in {count(left.dof, 'pose')}"),
        ("95 % region", f"semi-axes {half} along {along}"),
        ("Factor", f"{left.factor:.3f} standard deviations ({ellipse.factor(0.95):.3f} of a known covariance)"),
        ("Inside", f"{percent(left.inside)} of the rows"),
    )
    return Block("Residual scatter", (Facts(facts),), "residual_region" if len(found.axes) > 1 else "")


def measures_blocks(found: Assessment) -> tuple[Block, Block]:
    """How many coordinates are far off, next to a normal distribution; errors in units of the instrument's σ."""
    share = f"{percent(found.calibrated.beyond3)} of the coordinates ({percent(NORMAL_TAIL)} of a normal distribution)"
    shape = Block("Distribution of the residuals", (Facts((("Beyond 3 σ", share),)),), "residual_shape")
    facts = [
        (words.capitalize(), f"{length(getattr(found, name).coordinate)}, {number(found.ratios[name], 2)} σ of it")
        for name, words in MODELS.items()
        if found.instrument
    ]
    return shape, Block("The instrument", (Facts(tuple(facts)),) if facts else ())


def repeats_block(found: Assessment) -> Block:
    """Accuracy and repeatability after ISO 9283 [mm, mrad], and the pooled scatter of repeats."""
    title, repeats = "Accuracy and repeatability (ISO 9283)", found.repeats
    if repeats is None:
        return Block(title, ())
    facts = [
        ("Repeated", f"{count(repeats.groups, 'posture')}, {count(repeats.rows, 'row')}"),
        ("Scatter", f"σ {length(repeats.sigma)} per coordinate (95 %: {lengths(repeats.interval, ' to ')})"),
        ("RP", length(repeats.repeatability)),
    ]
    if repeats.outlying:
        facts.append(("Left out", f"{count(len(repeats.outlying), 'posture')} with outlying repeats"))
    angles = [angle for pose in repeats.poses for angle in pose.orientation]
    if angles:
        facts.append(("Orientation RP", f"{angle_error(max(float(a.repeatability) for a in angles))}, worst pose"))
    if angles and repeats.oriented:
        facts.append(("Orientation AP", f"{angle_error(max(abs(float(a.accuracy)) for a in angles))}, worst pose"))
    if repeats.left_out:
        facts.append(("Not listed", f"{count(repeats.left_out, 'pose')} with as many repeats or fewer"))
    tables = [_performance_table(repeats)] if repeats.poses else []
    return Block(title, (Facts(tuple(facts)), *tables), "residual_repeats")


def _performance_table(repeats: Repeats) -> Table:
    """AP by model and RP [mm]: median pose, worst pose with its 95 % interval, and the line of its first repeat."""
    rows = []
    for what in (*MODELS, "RP"):
        values = []
        for pose in repeats.poses:
            one = getattr(pose, "nominal" if what == "RP" else what)
            sized = (one.repeatability, one.repeatability_interval), (one.accuracy, one.accuracy_interval)
            values.append((*sized[what != "RP"], pose.line))
        worst, (low, high), line = max(values)
        sizes = (float(np.median([value for value, _, _ in values])), worst)
        interval = " to ".join(fixed(1e3 * end, 3) for end in (low, high))
        name = "RP" if what == "RP" else f"AP, {MODELS[what]}"
        rows.append((name, *(fixed(1e3 * size, 3) for size in sizes), interval, str(line)))
    return Table(("[mm]", "median pose", "worst pose", "its 95 % interval", "line"), tuple(rows))


class AssessmentPresenter(Presenter[Assessment]):
    """What a model gets wrong, and whether what remains is scatter: one line of answer, then a block for each rule."""

    stem = "assessment"
    title = "Assessment"
    heading = "Assessment of a calibration"
    asked = "calibration.request"

    def facts(self) -> Iterable[tuple[str, str]]:
        found, left = self.result, self.result.residual_scatter
        yield "Rows", f"{found.rows} in {found.poses} poses"
        for name, words in MODELS.items():
            yield words.capitalize(), f"{length(getattr(found, name).coordinate)} a coordinate"
        if left is not None:
            yield "In its 95 % region", f"{percent(left.inside)} of the rows"

    def blocks(self) -> Iterable[Block]:
        return assessment_blocks(self.result)

    def drawings(self) -> Drawings:
        return assessment_drawings(self.result)

    def columns(self) -> Columns:
        found = self.result
        return {
            "model": ["nominal", "calibrated"],
            "error of a coordinate [m]": [found.nominal.coordinate, found.calibrated.coordinate],
        }


def assessment_drawings(found: Assessment) -> Drawings:
    """Residuals over everything that they may depend on."""
    rows = Shown.of(found.calibration)
    spatial = len(rows.data.kind.axis_names) == 3
    drawings: Drawings = {
        **({"residual_vectors": partial(plot_residual_vectors, rows)} if spatial else {}),
        "residual_joints": partial(plot_residuals_over_joints, rows),
        "residual_inputs": partial(plot_residuals_over_inputs, rows),
    }
    if found.residual_scatter is not None:
        if len(found.axes) > 1:
            drawings["residual_region"] = partial(plot_region, rows, found)
        drawings["residual_shape"] = partial(plot_shape, rows)
    if found.repeats is not None:
        drawings["residual_repeats"] = partial(plot_repeats, problem_of(found.calibration.request), rows, found)
    return drawings


_MAX_POSTURES = 8


def spread_check_blocks(found: SpreadCheck) -> tuple[Block, ...]:
    """Coverage of the predicted regions, repeats against the prediction, scatter of each joint where estimated."""
    noise = (joints_block(found),) if found.noise is not None else ()
    return coverage_block(found), predicted_repeats_block(found), *noise


def coverage_block(found: SpreadCheck) -> Block:
    """How much of what was measured the predicted regions hold.

    Columns, a row a model:
      contains: share of the measured points in their region, with its 95 % interval;
      if correct: range in which that share would lie if the prediction were true;
      scale by: factor on all standard deviations that would make it true, with its interval.
    """
    how = "Each row is compared with the region that a fit without it predicts for its posture, instrument included."
    rows = []
    for name, c in found.coverage.items():
        shares = (" to ".join(map(percent, ends)) for ends in (c.interval, c.expected))
        factors = number(c.factor), " to ".join(map(number, c.factor_interval))
        rows.append((MODEL_NAMES[name], percent(c.share), *shares, *factors))
    headers = ("95 % region", "contains", "95 % interval", "if correct", "scale by", "95 % interval")
    return Block("Coverage of the predicted spread", (how, Table(headers, tuple(rows))), "truth_coverage")


def predicted_repeats_block(found: SpreadCheck) -> Block:
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
    sigma, std, low, high = values
    # Less than 1e-3 of the upper end is zero.
    zero = 1e-3 * high
    interval = f"below {write(high)}" if low <= zero else f"{write(low)} to {write(high)}"
    return write(sigma) if sigma > zero else "0", write(std), interval


class SpreadCheckPresenter(Presenter[SpreadCheck]):
    """Predicted spread against measured errors."""

    stem = "spread_check"
    title = "Spread"
    heading = "Check of the predicted spread"
    asked = "calibration.request"

    def facts(self) -> Iterable[tuple[str, str]]:
        found = self.result
        for name, p in found.coverage95.items():
            yield f"In 95 % regions, {MODEL_NAMES[name]}", percent(p)
        if found.repeat_sigma:
            yield "Between repeats", length(found.repeat_sigma)
        yield "Left by the calibration", f"{length(found.residual_rms)} a coordinate (RMS)"

    def blocks(self) -> Iterable[Block]:
        return spread_check_blocks(self.result)

    def drawings(self) -> Drawings:
        return spread_check_drawings(self.result)

    def columns(self) -> Columns:
        shares = self.result.coverage95
        return {"model": list(shares), "share in the 95 % region": list(shares.values())}


def spread_check_drawings(found: SpreadCheck) -> Drawings:
    """Coverage of the predicted regions, and the scatter of the joints where it was estimated."""
    joints: Drawings = {} if found.noise is None else {"truth_joints": partial(plot_joint_scatter, found)}
    return {"truth_coverage": partial(plot_reliability, found), **joints}
