"""The report on what a model gets wrong: errors by direction, the rules of measuring, whether the rest is scatter.

A good calibration leaves errors whose mean is zero everywhere, that depend on no input, and that an instrument of
sufficient accuracy measured. Each block tests one of these and says whether it holds.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from posture_opt.errors import enumerated
from posture_opt.report.figures.residual_scatter import plot_region, plot_repeats, plot_shape
from posture_opt.report.figures.residual_trends import plot_residuals_over_inputs, plot_residuals_over_joints
from posture_opt.report.figures.residuals import Shown, plot_residual_vectors
from posture_opt.report.measured_parts.assessment_repeats import MODELS, goals_block, instrument_block, repeats_block
from posture_opt.report.measured_parts.residual_parts import scatter_block, shape_block
from posture_opt.report.page.presenter import Columns, Drawings, Presenter, problem_of
from posture_opt.report.parts.parts import sentence
from posture_opt.report.text.blocks import Block, Report, Summary, Table
from posture_opt.report.text.words import MODEL_NAMES, direction_words
from posture_opt.statements.notation import length, percent, shift
from posture_opt.units import fixed, number
from posture_opt.validation.assessment import Assessment

if TYPE_CHECKING:
    from posture_opt.selection.problem_data import ProblemData
    from posture_opt.validation.model_errors import BlockMean, Deviation, ModelErrors
    from posture_opt.validation.trends import Trend

_INPUTS = {
    # input of the data -> words, unit, factor from SI
    "row": ("the rows of the file", "", 1.0),
    "time": ("time", "h", 1 / 3600),
    "temperature": ("temperature", "degC", 1.0),
    "payload": ("payload", "kg", 1.0),
}
_MIN_HOURS_S = 2 * 3600.0  # s: shorter times are written in minutes
_TOTALS = {1: "in all", 2: "in the plane", 3: "in space"}
_ZERO_MEAN_SHARE = 0.1  # of its standard error: a mean that a fit has made zero, as chance hardly would on all axes
_UNDIVIDED_SHARE = 0.6  # of the whole range: a block as long was not cut along it


def assessment_blocks(found: Assessment) -> tuple[Block, ...]:
    """Every block on what a model gets wrong, the figures with them.

    Only the block on targets reached in several postures depends on the data; all others are always there and say so
    where the data cannot answer.
    """
    return (
        directions_block(found),
        *([goals_block(found)] if found.goals is not None else []),
        mean_block(found),
        inputs_block(found),
        scatter_block(found),
        shape_block(found),
        instrument_block(found),
        repeats_block(found),
    )


def directions_block(found: Assessment) -> Block:
    """Bias, RMS, mean, 95 % and maximum by axis and by the task's direction.

    A pair of rows for each direction (x, y, z, all measured axes together, along and across the task where it has a
    direction): the model before and after calibration. In mm, measured minus model, to three decimals, to four where
    the smallest RMS is below 10 µm.
    """
    models = {name: getattr(found, name) for name in MODELS}
    smallest = min(d.rms for model in models.values() for d in model.deviations)
    decimals = 3 if smallest >= 1e-5 or smallest <= 0 else 4
    rows = [
        (_direction_name(found, pair[0].name) if k == 0 else "", model, *_cells(d, decimals))
        for pair in zip(*(model.deviations for model in models.values()), strict=True)
        for k, (model, d) in enumerate(zip(MODELS.values(), pair, strict=True))
    ]
    headers = ("measured minus model [mm]", "model", "bias", "RMS", "mean", "95 % below", "max")
    how = "Bias keeps its sign; RMS, mean, 95 % and max are of the length of the error vector."
    notes = map(sentence, found.notes)
    figure = "residual_vectors" if len(found.calibration.request.data.kind.axis_names) == 3 else ""
    return Block("Errors by direction", (how, Table(headers, tuple(rows), text_columns=2), *notes), figure)


def _direction_name(found: Assessment, name: str) -> str:
    """Column header of a direction: the axis itself, the total, or along and across the task."""
    if name in ("along", "across"):
        assert found.direction is not None
        return f"along the task ({direction_words(found.direction)})" if name == "along" else "across the task"
    if name == "all":
        return _TOTALS[len(found.axes)]
    names = found.calibration.request.data.kind.axis_names
    return names["xyz".index(name)]


def _cells(d: Deviation, decimals: int) -> tuple[str, ...]:
    """Bias, RMS, mean, 95 % and maximum [mm] to so many decimals."""
    return tuple(fixed(1e3 * value, decimals) for value in (d.bias, d.rms, d.mean, d.p95, d.max))


def mean_block(found: Assessment) -> Block:
    """The first rule: after calibration the mean of the residuals is zero, everywhere.

    The test is one of all rows and one for every block of the workspace (of the joint values, for touched points).
    "Passed" needs both; "Failed" says that the parameters of the model do not explain all of the error.
    """
    rule = "After a good calibration the mean error is zero, over all rows and in every part of the workspace."
    texts = [_mean_text(found, name) for name in MODELS]
    if found.calibrated.zero and found.calibrated.blocks:
        verdict = "Passed: nothing speaks against treating the residuals as scatter."
    elif found.calibrated.zero:
        verdict = "There are too few poses to test parts of the workspace separately."
    else:
        verdict = "Failed: these parameters do not explain all of the error."
    return Block("Are the residuals pure scatter?", (rule, *texts, verdict), "residual_joints")


def _mean_text(found: Assessment, name: str) -> str:
    """What the means over all rows and over the blocks say of one model.

    A mean below a tenth of its standard error on all axes is one that the fit has made zero: then no test is quoted.
    """
    model: ModelErrors = getattr(found, name)
    blocks = _blocks_text(found, model.blocks) if model.blocks else ""
    if model.mean is None:
        one = found.calibration.request.data.kind.label
        overall = (
            f"the mean of every {one} is zero, since where it is follows from these rows only"
            if one
            else "the mean over all rows is not tested, as the mounting of the instrument follows from these rows"
        )
    elif np.all(np.abs(model.mean.mean) <= _ZERO_MEAN_SHARE * model.mean.error):
        overall = "the mean over all rows is zero, as the fit enforces"
    else:
        mean, error = model.mean.mean.tolist(), model.mean.error.tolist()
        verdict = "not significant" if model.mean.zero else "significantly different from zero"
        size = f"{shift(mean)} with standard errors {shift(error, among=mean)}"
        overall = f"the mean over all rows is {size}: {verdict} (p {p_value(model.mean.p_value)})"
    return f"{MODELS[name].capitalize()}, {overall}.{blocks}"


def _blocks_text(found: Assessment, blocks: tuple[BlockMean, ...]) -> str:
    """How many blocks have a mean that differs from zero, and where the largest of these means is."""
    off = [block for block in blocks if not block.zero]
    space = "workspace" if found.calibrated.mean is not None else "joint values"
    if not off:
        return f" In each of {len(blocks)} blocks of the {space} it does not differ significantly from zero either."
    worst = max(off, key=lambda block: float(np.linalg.norm(block.test.mean)))
    size, where = length(float(np.linalg.norm(worst.test.mean))), _box(found, blocks, worst)
    return (
        f" In {len(off)} of {len(blocks)} blocks of the {space} it is not zero; the largest, {size}, is where {where}."
    )


def _box(found: Assessment, blocks: tuple[BlockMean, ...], block: BlockMean) -> str:
    """The sides of a block that are shorter than those of the whole, the shortest three.

    A side is left out where the block is nearly as long as the whole range: the data were not divided along it.
    """
    whole = np.ptp([[b.lower, b.upper] for b in blocks], axis=(0, 1))
    part = (block.upper - block.lower) / np.maximum(whole, 1e-12)
    shown = sorted(k for k in np.argsort(part)[:3] if part[k] < _UNDIVIDED_SHARE and whole[k] > 0)
    return ", ".join(_side(found.block_axes[k], block.lower[k], block.upper[k]) for k in shown)


def _side(axis: tuple[str, str], low: float, high: float) -> str:
    """The range of a block along one axis: joint angles in deg, coordinates in m."""
    name, unit = axis
    if unit == "rad":
        return f"{name} is {fixed(np.degrees(low), 0)} to {fixed(np.degrees(high), 0)} deg"
    return f"{name} is {fixed(low)} to {fixed(high)} m"


def p_value(p: float) -> str:
    """= 0.23, = 0.004, below 0.001."""
    return "below 0.001" if p < 1e-3 else f"= {number(p, 2)}"


def inputs_block(found: Assessment) -> Block:
    """Drift, heat, load and backlash: what the errors that are left depend on.

    One sentence for each input with a significant trend, one for all inputs without, and one on the side from which
    joints arrive. A trend may also come from positions that changed along with the input, which a sentence says.
    """
    texts = [_trend_text(trend) for trend in found.trends if trend.found]
    if texts:
        texts.append("If the measured positions changed along with an input, they may be the actual cause.")
    calm = [_INPUTS[trend.name][0] for trend in found.trends if not trend.found]
    if calm:
        texts.append(f"No significant trend over {enumerated(calm, 'or')}.")
    off = sorted((sides for sides in found.sides if sides.found), key=lambda sides: -abs(sides.difference))
    if off:
        sizes = ", ".join(f"{sides.joint} by {length(abs(sides.difference))}" for sides in off)
        texts.append(f"The side from which a joint arrives changes the mean error along its motion: {sizes}.")
    elif found.sides:
        texts.append("The side from which a joint arrives has no significant influence.")
    first = "After calibration the errors should depend neither on time nor on other inputs."
    return Block("Errors over time and other inputs", (first, *texts), "residual_inputs")


def _trend_text(trend: Trend) -> str:
    """By how much the mean error changes over the range of an input, with its p-value; time in h, up to two hours in
    min.
    """
    words, unit, factor = _INPUTS[trend.name]
    if trend.name == "time" and trend.range[1] - trend.range[0] < _MIN_HOURS_S:
        unit, factor = "min", 1 / 60
    low, high = (f"{factor * value:.4g}" for value in trend.range)
    span = "from the first row to the last" if trend.name == "row" else f"from {low} to {high} {unit}"
    change = shift(trend.change.tolist())
    return f"Over {words}, {span}, the mean error changes by {change} (significant, p {p_value(trend.p_value)})."


def _answer(found: Assessment) -> str:
    """RMS error per coordinate before and after calibration."""
    before, after = (length(model.coordinate) for model in (found.nominal, found.calibrated))
    one = found.calibration.request.data.kind.number_words
    return f"RMS error per {one}: {before} before calibration, {after} calibrated."


class AssessmentPresenter(Presenter[Assessment]):
    """What a model gets wrong, and whether what remains is scatter: one line of answer, then a block for each rule."""

    stem = "assessment"

    @property
    def problem(self) -> ProblemData:
        """The problem whose arm was calibrated."""
        return problem_of(self.result.calibration.request)

    def summary(self) -> Summary:
        """Rows and poses, errors before and after, share of the rows in the 95 % region of the residuals."""
        found = self.result
        models = {"nominal": found.nominal, "calibrated": found.calibrated}
        errors = [
            (MODEL_NAMES[name].capitalize(), f"{length(m.coordinate)} a coordinate") for name, m in models.items()
        ]
        left = found.residual_scatter
        inside = [] if left is None else [("In its 95 % region", f"{percent(left.inside)} of the rows")]
        facts = (("Rows", f"{found.rows} in {found.poses} poses"), *errors, *inside)
        return Summary(f"Assessment of a calibration: {self.problem.name}", facts)

    def document(self) -> Report:
        return Report(self.problem.name or "Assessment", (_answer(self.result),), assessment_blocks(self.result))

    def drawings(self) -> Drawings:
        """Residuals over everything that they may depend on."""
        return assessment_drawings(self.result)

    def columns(self) -> Columns:
        """Standard deviation of an error coordinate [m], a row each for the nominal and the calibrated model."""
        found = self.result
        return {
            "model": ["nominal", "calibrated"],
            "error of a coordinate [m]": [found.nominal.coordinate, found.calibrated.coordinate],
        }


def assessment_drawings(found: Assessment) -> Drawings:
    """Residuals over everything that they may depend on.

    Region and distribution need enough poses for a covariance, the figure of repeats needs repeated postures; each is
    left out otherwise.
    """
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
