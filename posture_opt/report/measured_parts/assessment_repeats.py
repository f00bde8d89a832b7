"""What an assessment says of repeats and the instrument: ISO 9283, one tool pose in several postures.

Lengths of the tables are in mm with three decimals. Accuracy (AP) is the distance of the mean of a posture's repeats
from the prediction, repeatability (RP) the scatter about that mean.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from posture_opt.report.text.blocks import Block, Table
from posture_opt.report.text.words import MODEL_NAMES
from posture_opt.statements.notation import angle_error, count, length, lengths, stated_length
from posture_opt.units import fixed, number
from posture_opt.validation.assessment import MIN_INSTRUMENT_RATIO
from posture_opt.validation.repeatability_tests import ISO_CYCLES

if TYPE_CHECKING:
    from posture_opt.validation.assessment import Assessment
    from posture_opt.validation.repeatability_tests import Distances, PosePerformance, Repeats

_SIGMA_EXAMPLES = {"m": "0.05 mm", "rad": "0.002 deg", "px": "0.2 px"}
"""SI unit of a reading -> a standard deviation as a file may state it."""
MODELS = {name: MODEL_NAMES[name] for name in ("nominal", "calibrated")}


def goals_block(found: Assessment) -> Block:
    """How far apart the postures of one goal land.

    Rows: the measured distance between postures of one target, and by model how far the predicted vector between them
    is off; median, 95 % and maximum. An error that does not depend on the posture cancels here.
    """
    goals = found.goals
    assert goals is not None
    text = (
        f"{count(goals.goals, 'target was', 'targets were')} reached in two postures or more. The model before "
        f"calibration predicts that they land {length(goals.said['nominal'].median)} apart; "
        f"{length(goals.measured.median)} were measured (medians). The calibrated model predicts the vector between "
        f"them to {length(goals.missed['calibrated'].median)}, before calibration to "
        f"{length(goals.missed['nominal'].median)}."
    )
    rows = [("measured apart", *_distance_cells(goals.measured))]
    rows += [(f"prediction error, {words}", *_distance_cells(goals.missed[name])) for name, words in MODELS.items()]
    return Block("One target, several postures", (text, Table(("[mm]", "median", "95 % below", "max"), tuple(rows))))


def _distance_cells(d: Distances) -> tuple[str, ...]:
    """Median, 95 % and maximum [mm]."""
    return tuple(fixed(1e3 * value, 3) for value in (d.median, d.p95, d.max))


def repeats_block(found: Assessment) -> Block:
    """Accuracy and repeatability after ISO 9283, and the pooled scatter of visits.

    One sentence in place of the block where no position was measured or no posture repeated; without the table where
    no posture was measured three times.
    """
    title, repeats = "Accuracy and repeatability (ISO 9283)", found.repeats
    if repeats is None and found.calibrated.mean is None:
        seen = found.calibration.request.data.kind.noun.capitalize()
        return Block(title, (f"{seen} do not show repeatability: no position was measured.",))
    if repeats is None:
        return Block(title, ("No posture was repeated: repeatability is unknown.",))
    low, high = repeats.interval
    slipped = (
        f" {count(len(repeats.outlying), 'posture')} with outlying repeats left out, named below."
        if repeats.outlying
        else ""
    )
    pooled = (
        f"{count(repeats.groups, 'posture was', 'postures were')} measured more than once, {repeats.rows} rows in "
        f"all. The standard deviation of a coordinate about its posture mean is {length(repeats.sigma)} ("
        f"with 95 % confidence {lengths([low, high], ' to ')}), so RP is {length(repeats.repeatability)}.{slipped}"
    )
    if not repeats.poses:
        few = "No posture was measured three times or more: AP and RP of single postures are left out."
        return Block(title, (pooled, few), "residual_repeats")
    return Block(title, (pooled, _performance_table(repeats), *_performance_texts(repeats)), "residual_repeats")


def _performance_table(repeats: Repeats) -> Table:
    """AP by model and RP: median pose, worst pose with its 95 % interval, and its line in the file."""
    rows = [
        (f"AP, {MODELS['nominal']}", *_spread_cells([_interval(p, "nominal") for p in repeats.poses])),
        (f"AP, {MODELS['calibrated']}", *_spread_cells([_interval(p, "calibrated") for p in repeats.poses])),
        ("RP", *_spread_cells([_interval(p, "RP") for p in repeats.poses])),
    ]
    return Table(("[mm]", "median pose", "worst pose", "its 95 % interval", "line"), tuple(rows))


def _interval(pose: PosePerformance, what: str) -> tuple[float, tuple[float, float], int]:
    """AP of a model, or RP [m], of one pose, with its interval and its line in the file."""
    if what == "RP":
        return pose.nominal.repeatability, pose.nominal.repeatability_interval, pose.line
    performance = getattr(pose, what)
    return performance.accuracy, performance.accuracy_interval, pose.line


def _spread_cells(values: list[tuple[float, tuple[float, float], int]]) -> tuple[str, ...]:
    """Median, worst, interval of the worst [mm], and its line."""
    worst, (low, high), line = max(values)
    middle = float(np.median([value for value, _, _ in values]))
    return (
        fixed(1e3 * middle, 3),
        fixed(1e3 * worst, 3),
        f"{fixed(1e3 * low, 3)} to {fixed(1e3 * high, 3)}",
        str(line),
    )


def _performance_texts(repeats: Repeats) -> list[str]:
    """How often poses were repeated, whether ISO 9283 asks for more, and what the orientation does [mrad]."""
    repeated = [pose.nominal.n for pose in repeats.poses]
    size = f"{min(repeated)}" if min(repeated) == max(repeated) else f"{min(repeated)} to {max(repeated)}"
    texts = [f"{count(len(repeated), 'pose')} with {size} repeats; the line is that of the first one."]
    if min(repeated) < ISO_CYCLES:
        texts.append(f"ISO 9283 asks for {ISO_CYCLES} repeats; the intervals show the effect of fewer.")
    if repeats.left_out:
        texts.append(f"{count(repeats.left_out, 'pose')} more with as many repeats or fewer are not listed.")
    if repeats.poses[0].orientation:
        worst = max(angle.repeatability for pose in repeats.poses for angle in pose.orientation)
        texts.append(f"The orientation repeats within {angle_error(float(worst))} about any axis (RP, worst pose).")
        if repeats.oriented:
            off = max(abs(angle.accuracy) for pose in repeats.poses for angle in pose.orientation)
            texts.append(
                f"The calibrated model's orientation is off by up to {angle_error(float(off))} about an axis (AP)."
            )
    return texts


def instrument_block(found: Assessment) -> Block:
    """The third rule: an instrument ten times better than what it is used to assess.

    Compared are the RMS error per coordinate, before and after calibration, and the σ of the instrument. Below that
    ratio a warning says that part of the error is the instrument's; without a stated σ a hint says what to add.
    """
    rule = "An instrument should be ten times more accurate than the errors it measures."
    if not found.instrument:
        kind = found.calibration.request.data.kind
        key, example = kind.sigma_key, _SIGMA_EXAMPLES[kind.unit]
        hint = f"add uncertainty: {{measurement: {{{key}: {example}}}}} to the problem file."
        return Block("The instrument", (f"{rule} The accuracy of this one is not stated: {hint}",))
    one = found.calibration.request.data.kind.number_words
    texts = [f"{rule} The σ of this one is {stated_length(found.instrument)} per {one}."]
    for name, words in (("nominal", "The error before calibration"), ("calibrated", "The error after calibration")):
        ratio, size = found.ratios[name], length(getattr(found, name).coordinate)
        if ratio >= MIN_INSTRUMENT_RATIO:
            texts.append(f"{words} is {size} per {one}, {ratio:.0f} times that: good enough.")
        else:
            texts.append(
                f"Warning: {words[0].lower()}{words[1:]} is {size} per {one}, only {number(ratio, 2)} times that: "
                "part of it is the error of the instrument."
            )
    return Block("The instrument", tuple(texts))
