"""The report on what a model gets wrong: errors by direction, the rules of measuring, whether the rest is scatter."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from posture_opt.report.figures.residual_scatter import plot_region, plot_repeats, plot_shape
from posture_opt.report.figures.residual_trends import plot_residuals_over_inputs, plot_residuals_over_joints
from posture_opt.report.figures.residuals import Shown, plot_residual_vectors
from posture_opt.report.page.presenter import Columns, Drawings, Presenter, problem_of
from posture_opt.report.text.blocks import Block, Document, Facts, Summary, Table
from posture_opt.report.text.words import MODEL_NAMES, direction_words, line_words
from posture_opt.statements import p_value
from posture_opt.statements.notation import angle_error, count, length, lengths, percent, shift
from posture_opt.units import fixed, number
from posture_opt.validation.assessment import NORMAL_TAIL, Assessment

if TYPE_CHECKING:
    from posture_opt.selection.problem_data import ProblemData
    from posture_opt.validation.model_errors import ModelErrors
    from posture_opt.validation.repeatability_tests import Distances, Repeats

_TOTALS = {1: "in all", 2: "in the plane", 3: "in space"}
_ZERO_MEAN_SHARE = 0.1  # of its standard error: a mean that a fit has made zero, as chance hardly would on all axes
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
    rows = tuple(
        (
            _direction_name(found, pair[0].name) if k == 0 else "",
            model,
            *(fixed(1e3 * value, decimals) for value in (d.bias, d.rms, d.mean, d.p95, d.max)),
        )
        for pair in zip(*(model.deviations for model in models.values()), strict=True)
        for k, (model, d) in enumerate(zip(MODELS.values(), pair, strict=True))
    )
    headers = ("measured minus model [mm]", "model", "bias", "RMS", "mean", "95 % below", "max")
    how = "Bias keeps its sign; RMS, mean, 95 % and max are of the length of the error vector."
    figure = "residual_vectors" if len(found.calibration.request.data.kind.axis_names) == 3 else ""
    return Block("Errors by direction", (how, Table(headers, rows, text_columns=2)), figure)


def _direction_name(found: Assessment, name: str) -> str:
    """The axis itself, the total, or along and across the task."""
    if name in ("along", "across"):
        assert found.direction is not None
        return f"along the task ({direction_words(found.direction)})" if name == "along" else "across the task"
    names = found.calibration.request.data.kind.axis_names
    return _TOTALS[len(found.axes)] if name == "all" else names["xyz".index(name)]


def goals_block(found: Assessment) -> Block:
    """How far apart the postures of one target land: an error that does not depend on the posture cancels here."""
    goals = found.goals
    assert goals is not None
    rows = [("measured apart", *_distance_cells(goals.measured))]
    rows += [(f"predicted apart, {words}", *_distance_cells(goals.said[name])) for name, words in MODELS.items()]
    rows += [(f"prediction error, {words}", *_distance_cells(goals.missed[name])) for name, words in MODELS.items()]
    text = f"{count(goals.goals, 'target')} with two postures or more, {count(goals.pairs, 'pair')} of postures."
    return Block("One target, several postures", (text, Table(("[mm]", "median", "95 % below", "max"), tuple(rows))))


def _distance_cells(d: Distances) -> tuple[str, ...]:
    return tuple(fixed(1e3 * value, 3) for value in (d.median, d.p95, d.max))


def mean_block(found: Assessment) -> Block:
    """The test of the mean over all rows, and of those in parts of the workspace (of joint values, of touches)."""
    rows = tuple((words, *_mean_cells(getattr(found, name))) for name, words in MODELS.items())
    headers = ("model", "mean error", "standard error", "p-value", "parts off zero")
    return Block("Are the residuals pure scatter?", (Table(headers, rows, text_columns=5),), "residual_joints")


def _mean_cells(model: ModelErrors) -> tuple[str, ...]:
    """Mean, standard error and p-value over all rows, and how many parts have a mean that is not zero.

    A mean below a tenth of its standard error on all axes is one that the fit has made zero.
    """
    off = f"{sum(not block.zero for block in model.blocks)} of {len(model.blocks)}" if model.blocks else "not tested"
    test = model.mean
    if test is None:
        return "fitted", "", "", off
    if np.all(np.abs(test.mean) <= _ZERO_MEAN_SHARE * test.error):
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

    @property
    def problem(self) -> ProblemData:
        """The problem whose arm was calibrated."""
        return problem_of(self.result.calibration.request)

    def summary(self) -> Summary:
        """Rows and poses, errors before and after, share of the rows in the 95 % region of the residuals."""
        found = self.result
        errors = [
            (words.capitalize(), f"{length(getattr(found, name).coordinate)} a coordinate")
            for name, words in MODELS.items()
        ]
        left = found.residual_scatter
        inside = [] if left is None else [("In its 95 % region", f"{percent(left.inside)} of the rows")]
        facts = (("Rows", f"{found.rows} in {found.poses} poses"), *errors, *inside)
        return Summary(f"Assessment of a calibration: {self.problem.name}", facts)

    def document(self) -> Document:
        """Errors by direction, and a block for each rule of measuring."""
        return Document(self.problem.name or "Assessment", self.result.statements, assessment_blocks(self.result))

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
