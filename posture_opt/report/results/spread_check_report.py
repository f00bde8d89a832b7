"""The report on whether the predicted spread is true, between repeats and over all postures."""

from __future__ import annotations

import math
from functools import partial
from typing import TYPE_CHECKING

from posture_opt.report.figures.spread_check import plot_joint_scatter, plot_reliability
from posture_opt.report.page.presenter import Columns, Drawings, Presenter, problem_of
from posture_opt.report.parts.assessment_repeats import MODELS
from posture_opt.report.parts.parts import sentence
from posture_opt.report.results.assessment_report import p_value
from posture_opt.report.text.blocks import Block, Report, Summary, Table
from posture_opt.report.text.units_text import angle, count, length, percent, stated_angle, stated_length
from posture_opt.report.text.words import MODEL_NAMES, REGIONS
from posture_opt.units import fixed, number
from posture_opt.validation.spread_check import SpreadCheck

if TYPE_CHECKING:
    from posture_opt.problem.problem import Problem
    from posture_opt.validation.coverage import Coverage
    from posture_opt.validation.repeat_scatter import ScatterTest
    from posture_opt.validation.scatter_prediction import ScatterPrediction

_LISTED = 8  # postures
_SURE = "with 95 % confidence"
_WIDE = 0.1  # of the rows: so far does one draw of what stays move the share, that it needs words
_NOTHING = 1e-3  # of the upper end of an interval: less than that is zero
_BENT = 0.05  # of the rows: less bends a curve that nobody sees
_MUCH = 2.0  # times the scatter between repeats: larger residuals than that are no scatter
_SCATTER = {
    "right": "the predicted scatter agrees with the data",
    "understated": "the predicted scatter is too small",
    "overstated": "the predicted scatter is too large",
}


def spread_check_blocks(found: SpreadCheck) -> tuple[Block, ...]:
    """Coverage of the predicted regions, repeats against the prediction, scatter of each joint."""
    noise = (joints_block(found),) if found.noise is not None else ()
    return coverage_block(found), repeats_block(found), *noise


def spread_check_lead(found: SpreadCheck) -> str:
    """The line for the top of the report."""
    return coverage_sentence("nominal" if found.stated else "calibrated", found)


def coverage_block(found: SpreadCheck) -> Block:
    """How much of what was measured the predicted regions hold."""
    how = (
        "Each row is compared with the region predicted for its posture by a fit without it: before calibration from "
        "the uncertainty in the file and the instrument; after it from the covariance of the parameters, the residual "
        "scatter and the instrument."
    )
    sentences = [coverage_sentence(name, found) for name in found.coverage]
    rows = tuple((MODELS[name], *_coverage_cells(c)) for name, c in found.coverage.items())
    headers = ("95 % region", "contains", _SURE, "if correct", "scale by", _SURE)
    tails = [text for name, c in found.coverage.items() if (text := _tails(MODELS[name], c))]
    after = (*tails, *_one_draw(found), *map(sentence, found.notes))
    return Block("Coverage of the predicted spread", (*sentences, how, Table(headers, rows), *after), "truth_coverage")


def _one_draw(found: SpreadCheck) -> list[str]:
    """How far errors that stay may move the share of one robot."""
    low, high = found.coverage["nominal"].expected
    if not found.stated or high - low <= _WIDE:
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
    low, high = (number(end, 2) for end in c.factor_interval)
    if c.verdict == "right":
        near = "" if float(low) <= 1 <= float(high) else " to within a tenth"
        return f"the spread agrees with the data{near} (factor {low} to {high})"
    if c.verdict == "understated":
        return f"the spread is understated by a factor of {number(c.factor, 2)} ({low} to {high})"
    return f"the spread is overstated: {number(c.factor, 2)} ({low} to {high}) of it would suffice"


def _tails(model: str, c: Coverage) -> str:
    """What a region of the right size says of the shape: long tails leave it too wide in the middle."""
    share, chance = c.held(0.5), 3 * math.sqrt(0.25 / c.poses)
    if c.verdict != "right" or abs(share - 0.5) < max(_BENT, chance):
        return ""
    more = "more" if share > 0.5 else "less"
    return f"The 50 % region, {model}, contains {percent(share)}: errors are {more} concentrated than predicted."


def _coverage_cells(c: Coverage) -> tuple[str, ...]:
    return (
        percent(c.share),
        f"{percent(c.interval[0])} to {percent(c.interval[1])}",
        f"{percent(c.expected[0])} to {percent(c.expected[1])}",
        number(c.factor),
        f"{number(c.factor_interval[0])} to {number(c.factor_interval[1])}",
    )


def repeats_block(found: SpreadCheck) -> Block:
    """Scatter between repeats, beside the residuals and what the file states of scatter."""
    title = "Repeats against the predicted scatter"
    if not found.repeat_sigma:
        told = "No posture was repeated: these data cannot separate scatter from systematic errors."
        return Block(title, (told, "Repeat about ten postures five times each to find out."))
    test = found.repeats
    texts = [_between_text(found)]
    if found.outlying:
        lines = ", ".join(map(str, found.outlying[:_LISTED])) + (" …" if len(found.outlying) > _LISTED else "")
        where = "posture first measured in line" if len(found.outlying) == 1 else "postures first measured in lines"
        texts.append(f"Left out: the {where} {lines}, whose repeats differ far more than any others: outliers.")
    if test is None:
        return Block(title, (*texts, "The file states no scatter to compare with."))
    return Block(title, (*texts, *_test_texts(test, found.repeats_by), _poses_table(test), *_more(test)))


def _between_text(found: SpreadCheck) -> str:
    size = f"Standard deviation between repeats of one posture: {length(found.repeat_sigma)} per coordinate"
    ratio = found.residual_rms / found.repeat_sigma
    left = f"{size}; the calibrated model has an RMS error of {length(found.residual_rms)} per coordinate."
    if ratio < _MUCH:
        return f"{left} Most of that is scatter."
    same = percent(1 - 1 / ratio**2)
    return f"{left} So {same} of the residual variance is the same in every repeat: systematic errors, not scatter."


def _test_texts(test: ScatterTest, by: str) -> list[str]:
    what = {
        "visit": "the scatter in the file and the instrument",
        "joints": "the σ's of joint values in the file, taken as scatter, and the instrument",
    }[by]
    how = f"Predicted from {what}. Systematic errors, such as wrong lengths, do not show between repeats."
    low, high = (number(end) for end in test.interval)
    size = f"The measured standard deviation is {number(test.factor)} times the predicted one ({low} to {high})"
    shape = "" if math.isnan(test.p_shape) else f", of size and shape together {p_value(test.p_shape)}"
    pooled = f"{size}: {_SCATTER[test.verdict]} (p of the size {p_value(test.p_size)}{shape})."
    off = sum(not pose.true for pose in test.poses)
    many = count(test.groups, "posture")
    single = f"Tested one by one, {off} of {many} scatter{'s' * (off == 1)} differently than predicted."
    return [how, pooled, single if off else f"Tested one by one, none of {many} scatters differently than predicted."]


def _poses_table(test: ScatterTest) -> Table:
    headers = ("line", "repeats", "measured [mm]", "predicted [mm]", "ratio", "p, size", "p, shape", "as predicted")
    rows = tuple(
        (
            str(pose.line), str(pose.n), number(1e3 * pose.measured), number(1e3 * pose.predicted),
            number(pose.factor), _short(pose.p_size), "" if math.isnan(pose.p_shape) else _short(pose.p_shape),
            "yes" if pose.true else "no",
        )
        for pose in test.poses[:_LISTED]
    )  # fmt: skip
    return Table(headers, rows, text_columns=0)


def _short(p: float) -> str:
    return "< 0.001" if p < 1e-3 else number(p, 2)


def _more(test: ScatterTest) -> list[str]:
    more = test.groups - _LISTED
    return [f"and {more} more; the family-wise level of all tests is 5 %."] if more > 0 else []


def joints_block(found: SpreadCheck) -> Block:
    """σ of each joint and of the instrument, and whether they predict other postures."""
    noise = found.noise
    assert noise is not None
    source = (
        "Estimated from the differences between repeats (restricted likelihood)."
        if found.from_repeats
        else "Estimated from the residuals of the calibration, which contain model errors too: nothing was repeated."
    )
    rows = [
        _joint_row(name, float(given), (float(s), float(e), float(low), float(high)), moved)
        for name, given, s, e, (low, high), moved in zip(
            noise.names, found.stated_sigma, noise.sigma, noise.std, noise.interval, found.shown, strict=True
        )
    ]
    rows.append(_instrument_row(found))
    headers = ("scatter (standard deviation)", "stated", "estimated", "std. error", "95 % interval")
    texts = [text for text in (_prediction_text(found.scatter_predictions, found.from_repeats),) if text]
    return Block("Scatter of each joint", (source, Table(headers, tuple(rows)), *texts), "truth_joints")


def _joint_row(name: str, stated: float, values: tuple[float, float, float, float], shown: bool) -> tuple[str, ...]:
    sigma, std, low, high = values
    slide = name.endswith(".d")
    given = "" if not stated else stated_length(stated) if slide else stated_angle(stated)
    if not shown:
        return name, given, "undetermined", "", "hardly moves the tool point"
    write = _small_length if slide else _small_angle
    interval = f"below {write(high)}" if low <= _NOTHING * high else f"{write(low)} to {write(high)}"
    return name, given, write(sigma) if sigma > _NOTHING * high else "0", write(std), interval


def _instrument_row(found: SpreadCheck) -> tuple[str, ...]:
    noise, stated = found.noise, stated_length(found.instrument)
    assert noise is not None
    low, high = noise.instrument_interval
    if not math.isfinite(noise.instrument_std):
        return "instrument", stated, "undetermined", "", "not separable from the joints"
    size, error, least, most = (length(v, 2, [high]) for v in (noise.instrument, noise.instrument_std, low, high))
    interval = f"below {most}" if low <= _NOTHING * high else f"{least} to {most}"
    return "instrument", stated, size if noise.instrument > _NOTHING * high else "0", error, interval


def _small_length(metres: float) -> str:
    return length(metres, 2)


def _small_angle(radians: float) -> str:
    return angle(radians) if abs(radians) >= 1e-2 else f"{number(math.degrees(radians), 2)} deg"


def _prediction_text(models: tuple[ScatterPrediction, ...], repeats: bool) -> str:
    """Whether σ's learned at some postures predict the ellipses at others."""
    by = {model.model: model for model in models}
    best = max((by[name] for name in ("joints", "one_sigma") if name in by), key=lambda m: m.gain, default=None)
    if best is None:
        return ""
    words = "one σ for each joint" if best.model == "joints" else "one σ for all joints"
    row = "repeat" if repeats else "row"
    tried = f"Fitted to four fifths of the postures and tested on the others, {words}"
    size = f"{fixed(best.gain, 2)} ± {fixed(best.gain_std, 2)} in the log-likelihood of a {row}"
    if best.better is None:
        told = f"{tried} predicts the scatter no better than one isotropic region for all postures ({size})."
    elif best.better:
        likelier = number(math.exp(min(best.gain, 50.0)), 2)
        told = (
            f"{tried} predicts the scatter better than one isotropic region for all postures: by {size}, so that each "
            f"{row} is {likelier} times as likely."
        )
    else:
        told = f"{tried} predicts the scatter worse than one isotropic region for all postures ({size})."
    if "stated" not in by:
        return told
    gain = best.log_likelihood - by["stated"].log_likelihood
    return f"{told} Over the σ's stated in the file it gains {fixed(gain, 2)}."


class SpreadCheckPresenter(Presenter[SpreadCheck]):
    """Predicted spread against measured errors."""

    document = "spread_check"

    @property
    def problem(self) -> Problem:
        return problem_of(self.result.calibration.request)

    def summary(self) -> Summary:
        found = self.result
        shares = [(f"In 95 % regions, {MODEL_NAMES[name]}", percent(p)) for name, p in found.coverage95.items()]
        repeats = [("Between repeats", length(found.repeat_sigma))] if found.repeat_sigma else []
        facts = (*shares, *repeats, ("Left by the calibration", f"{length(found.residual_rms)} a coordinate (RMS)"))
        return Summary(f"Check of the predicted spread: {self.problem.name}", facts)

    def report(self) -> Report:
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
    """Coverage of the predicted regions, and the scatter of the joints."""
    joints: Drawings = {} if found.noise is None else {"truth_joints": partial(plot_joint_scatter, found)}
    return {"truth_coverage": partial(plot_reliability, found), **joints}
