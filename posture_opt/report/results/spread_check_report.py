"""The report on whether the predicted spread is true, between repeats and over all postures.

Coverage tests regions against measured points: 95 % of them should lie in their 95 % regions. Repeats test scatter
alone, as systematic errors are the same in every repeat.
"""

from __future__ import annotations

import math
from functools import partial
from typing import TYPE_CHECKING

from posture_opt.report.figures.spread_check import plot_joint_scatter, plot_reliability
from posture_opt.report.measured_parts.assessment_repeats import MODELS
from posture_opt.report.measured_parts.scatter_parts import joints_block
from posture_opt.report.page.presenter import Columns, Drawings, Presenter, problem_of
from posture_opt.report.parts.parts import sentence
from posture_opt.report.results.assessment_report import p_value
from posture_opt.report.text.blocks import Block, Report, Summary, Table
from posture_opt.report.text.words import MODEL_NAMES, REGIONS
from posture_opt.statements.notation import count, length, percent
from posture_opt.units import number
from posture_opt.validation.spread_check import SpreadCheck

if TYPE_CHECKING:
    from posture_opt.selection.problem_data import ProblemData
    from posture_opt.validation.coverage import Coverage
    from posture_opt.validation.repeat_scatter import ScatterTest

_MAX_POSTURES = 8  # postures
_CONFIDENCE_HEADER = "with 95 % confidence"
_MIN_DRAW_SHARE = 0.1  # of the rows: so far does one draw of what stays move the share, that it needs words
_MIN_TAIL_SHARE = 0.05  # of the rows: less bends a curve that nobody sees
_MAX_SCATTER_RATIO = 2.0  # times the scatter between repeats: larger residuals than that are no scatter
_SCATTER_WORDS = {
    "right": "the predicted scatter agrees with the data",
    "understated": "the predicted scatter is too small",
    "overstated": "the predicted scatter is too large",
}


def spread_check_blocks(found: SpreadCheck) -> tuple[Block, ...]:
    """Coverage of the predicted regions, repeats against the prediction, scatter of each joint where estimated."""
    noise = (joints_block(found),) if found.noise is not None else ()
    return coverage_block(found), repeats_block(found), *noise


def spread_check_lead(found: SpreadCheck) -> str:
    """The line for the top of the report: coverage of the spread that is stated, else that of the calibrated arm."""
    return coverage_sentence("nominal" if found.stated else "calibrated", found)


def coverage_block(found: SpreadCheck) -> Block:
    """How much of what was measured the predicted regions hold.

    Columns, a row a model:
      contains: share of the measured points in their region, with its 95 % interval;
      if correct: range in which that share would lie if the prediction were true;
      scale by: factor on all standard deviations that would make it true, with its interval.
    """
    how = (
        "Each row is compared with the region predicted for its posture by a fit without it: before calibration from "
        "the uncertainty in the file and the instrument; after it from the covariance of the parameters, the residual "
        "scatter and the instrument."
    )
    sentences = [coverage_sentence(name, found) for name in found.coverage]
    rows = tuple((MODELS[name], *_coverage_cells(c)) for name, c in found.coverage.items())
    headers = ("95 % region", "contains", _CONFIDENCE_HEADER, "if correct", "scale by", _CONFIDENCE_HEADER)
    tails = [text for name, c in found.coverage.items() if (text := _tails(MODELS[name], c))]
    after = (*tails, *_one_draw(found), *map(sentence, found.notes))
    return Block("Coverage of the predicted spread", (*sentences, how, Table(headers, rows), *after), "truth_coverage")


def _one_draw(found: SpreadCheck) -> list[str]:
    """How far errors that stay may move the share of one robot; left out where it is less than a tenth of the rows."""
    low, high = found.coverage["nominal"].expected
    if not found.stated or high - low <= _MIN_DRAW_SHARE:
        return []
    one = (
        "Errors that are the same in every repeat are drawn once per robot: even if the spread in the file is correct,"
    )
    return [f"{one} the share may lie anywhere between {percent(low)} and {percent(high)}."]


def coverage_sentence(name: str, found: SpreadCheck) -> str:
    """``Before calibration, the predicted 95 % ellipse contains 71 % of the measured points: …``"""
    c = found.coverage[name]
    if name == "nominal" and not found.stated:
        return (
            f"The problem states no uncertainty of the arm: its predicted {REGIONS[c.dimension]} before calibration is "
            f"that of the instrument and contains {percent(c.share)} of the measured points."
        )
    arm = "Before calibration" if name == "nominal" else "After calibration"
    holds = f"{arm}, the predicted {REGIONS[c.dimension]} contains {percent(c.share)} of the measured points"
    return f"{holds}: {_verdict(c)}."


def _verdict(c: Coverage) -> str:
    """Whether the spread agrees, is understated or overstated, with the factor and its interval."""
    low, high = (number(end, 2) for end in c.factor_interval)
    if c.verdict == "right":
        near = "" if float(low) <= 1 <= float(high) else " to within a tenth"
        return f"the spread agrees with the data{near} (factor {low} to {high})"
    if c.verdict == "understated":
        return f"the spread is understated by a factor of {number(c.factor, 2)} ({low} to {high})"
    return f"the spread is overstated: {number(c.factor, 2)} ({low} to {high}) of it would suffice"


def _tails(model: str, c: Coverage) -> str:
    """What a region of the right size says of the shape: long tails leave it too wide in the middle.

    Reported where the share in the 50 % region is off by more than 5 % and more than three standard errors, ``3
    sqrt(0.25 / poses)``.
    """
    share, chance = c.held(0.5), 3 * math.sqrt(0.25 / c.poses)
    if c.verdict != "right" or abs(share - 0.5) < max(_MIN_TAIL_SHARE, chance):
        return ""
    more = "more" if share > 0.5 else "less"
    return f"The 50 % region, {model}, contains {percent(share)}: errors are {more} concentrated than predicted."


def _coverage_cells(c: Coverage) -> tuple[str, ...]:
    """The numbers of one model: share, interval, share if correct, factor, interval."""
    return (
        percent(c.share),
        f"{percent(c.interval[0])} to {percent(c.interval[1])}",
        f"{percent(c.expected[0])} to {percent(c.expected[1])}",
        number(c.factor),
        f"{number(c.factor_interval[0])} to {number(c.factor_interval[1])}",
    )


def repeats_block(found: SpreadCheck) -> Block:
    """Scatter between repeats, next to the residuals and what the file states of scatter.

    Without repeated postures the block says what to measure; without a stated scatter it has no test and no table.
    """
    title = "Repeats against the predicted scatter"
    if not found.repeat_sigma:
        text = "No posture was repeated: these data cannot separate scatter from systematic errors."
        return Block(title, (text, "Repeat about ten postures five times each to find out."))
    test = found.repeats
    texts = [_between_text(found)]
    if found.outlying:
        lines = ", ".join(map(str, found.outlying[:_MAX_POSTURES])) + (
            " …" if len(found.outlying) > _MAX_POSTURES else ""
        )
        where = "posture first measured in line" if len(found.outlying) == 1 else "postures first measured in lines"
        texts.append(f"Left out: the {where} {lines}, whose repeats differ far more than any others: outliers.")
    if test is None:
        return Block(title, (*texts, "The file states no scatter to compare with."))
    return Block(title, (*texts, *_test_texts(test, found.repeats_by), _poses_table(test), *_more(test)))


def _between_text(found: SpreadCheck) -> str:
    """Standard deviation between repeats against the residuals.

    Of residuals more than twice as large, the share ``1 − (σ_repeat / rms)²`` of the variance is systematic.
    """
    size = f"Standard deviation between repeats of one posture: {length(found.repeat_sigma)} per coordinate"
    ratio = found.residual_rms / found.repeat_sigma
    left = f"{size}; the calibrated model has an RMS error of {length(found.residual_rms)} per coordinate."
    if ratio < _MAX_SCATTER_RATIO:
        return f"{left} Most of that is scatter."
    same = percent(1 - 1 / ratio**2)
    return f"{left} So {same} of the residual variance is the same in every repeat: systematic errors, not scatter."


def _test_texts(test: ScatterTest, by: str) -> list[str]:
    """What was predicted from which source, measured over predicted standard deviation, and tests one by one."""
    what = {
        "visit": "the scatter in the file and the instrument",
        "joints": "the σ's of joint values in the file, taken as scatter, and the instrument",
    }[by]
    how = f"Predicted from {what}. Systematic errors, such as wrong lengths, do not show between repeats."
    low, high = (number(end) for end in test.interval)
    size = f"The measured standard deviation is {number(test.factor)} times the predicted one ({low} to {high})"
    shape = "" if math.isnan(test.p_shape) else f", of size and shape together {p_value(test.p_shape)}"
    pooled = f"{size}: {_SCATTER_WORDS[test.verdict]} (p of the size {p_value(test.p_size)}{shape})."
    off = sum(not pose.true for pose in test.poses)
    many = count(test.groups, "posture")
    single = f"Tested one by one, {off} of {many} scatter{'s' * (off == 1)} differently than predicted."
    return [how, pooled, single if off else f"Tested one by one, none of {many} scatters differently than predicted."]


def _poses_table(test: ScatterTest) -> Table:
    """One row a posture, the least probable first: measured and predicted size [mm], their ratio, p of size and of
    shape.
    """
    headers = ("line", "repeats", "measured [mm]", "predicted [mm]", "ratio", "p, size", "p, shape", "as predicted")
    rows = tuple(
        (
            str(pose.line), str(pose.n), number(1e3 * pose.measured), number(1e3 * pose.predicted),
            number(pose.factor), _short(pose.p_size), "" if math.isnan(pose.p_shape) else _short(pose.p_shape),
            "yes" if pose.true else "no",
        )
        for pose in test.poses[:_MAX_POSTURES]
    )  # fmt: skip
    return Table(headers, rows, text_columns=0)


def _short(p: float) -> str:
    """A p-value of a table."""
    return "< 0.001" if p < 1e-3 else number(p, 2)


def _more(test: ScatterTest) -> list[str]:
    """How many postures the table leaves out."""
    more = test.groups - _MAX_POSTURES
    return [f"and {more} more; the family-wise level of all tests is 5 %."] if more > 0 else []


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

    def document(self) -> Report:
        """One line of answer and the blocks."""
        return Report(
            self.problem.name or "Spread", (spread_check_lead(self.result),), spread_check_blocks(self.result)
        )

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
