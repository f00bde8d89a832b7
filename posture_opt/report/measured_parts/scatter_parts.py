"""The scatter of each joint in a report: estimated, as stated, and whether it predicts other postures."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from posture_opt.report.text.blocks import Block, Table
from posture_opt.statements.notation import angle_error, length, stated_length
from posture_opt.units import fixed, number

if TYPE_CHECKING:
    from posture_opt.validation.scatter_prediction import ScatterPrediction
    from posture_opt.validation.spread_check import SpreadCheck

_ZERO_SHARE = 1e-3  # of the upper end of an interval: less than that is zero


def joints_block(found: SpreadCheck) -> Block:
    """σ of each joint and of the instrument, and whether they predict other postures.

    Estimated by restricted likelihood from differences between repeats, or from the residuals where nothing was
    repeated. A joint that hardly moves the tool point in these data is "undetermined".
    """
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
    headers = ("scatter (standard deviation)", stated_words(found), "estimated", "std. error", "95 % interval")
    texts = [text for text in (_prediction_text(found.scatter_predictions, found.from_repeats),) if text]
    return Block("Scatter of each joint", (source, Table(headers, tuple(rows)), *texts), "truth_joints")


def stated_words(found: SpreadCheck) -> str:
    """What the σ's are that estimates are compared with: those of joints may be the data sheet's."""
    return "stated (joints: data sheet)" if found.calibration.request.problem.sources.assumed else "stated"


def _joint_row(name: str, stated: float, values: tuple[float, float, float, float], shown: bool) -> tuple[str, ...]:
    """Name, stated σ, estimate, standard error and 95 % interval of one joint.

    Args:
        stated: [rad or m], 0 where the file states none.
        values: σ, its standard error, lower and upper end of its interval [rad or m].
        shown: whether the data determine it.
    """
    sigma, std, low, high = values
    slide = name.endswith(".d")
    given = "" if not stated else stated_length(stated) if slide else angle_error(stated)
    if not shown:
        return name, given, "undetermined", "", "hardly moves the tool point"
    write = _small_length if slide else _small_angle
    interval = f"below {write(high)}" if low <= _ZERO_SHARE * high else f"{write(low)} to {write(high)}"
    return name, given, write(sigma) if sigma > _ZERO_SHARE * high else "0", write(std), interval


def _instrument_row(found: SpreadCheck) -> tuple[str, ...]:
    """The same of the instrument, per coordinate; "undetermined" where it cannot be separated from the joints."""
    noise, stated = found.noise, stated_length(found.instrument)
    assert noise is not None
    low, high = noise.instrument_interval
    if not math.isfinite(noise.instrument_std):
        return "instrument", stated, "undetermined", "", "not separable from the joints"
    size, error, least, most = (length(v, 2, [high]) for v in (noise.instrument, noise.instrument_std, low, high))
    interval = f"below {most}" if low <= _ZERO_SHARE * high else f"{least} to {most}"
    return "instrument", stated, size if noise.instrument > _ZERO_SHARE * high else "0", error, interval


def _small_length(metres: float) -> str:
    """A length to two digits."""
    return length(metres, 2)


def _small_angle(radians: float) -> str:
    """An angle [rad] in mrad, to two digits."""
    return angle_error(radians, 2)


def _prediction_text(models: tuple[ScatterPrediction, ...], repeats: bool) -> str:
    """Whether σ's learned at some postures predict the ellipses at others.

    The figure of merit is the log-likelihood of a row of postures that the fit had not seen, against one isotropic
    region for all postures: a gain of g makes a row ``e^g`` times as likely.
    """
    by = {model.model: model for model in models}
    best = max((by[name] for name in ("joints", "one_sigma") if name in by), key=lambda m: m.gain, default=None)
    if best is None:
        return ""
    words = "one σ for each joint" if best.model == "joints" else "one σ for all joints"
    row = "repeat" if repeats else "row"
    tried = f"Fitted to four fifths of the postures and tested on the others, {words}"
    size = f"{fixed(best.gain, 2)} ± {fixed(best.gain_std, 2)} in the log-likelihood of a {row}"
    if best.better is None:
        text = f"{tried} predicts the scatter no better than one isotropic region for all postures ({size})."
    elif best.better:
        likelier = number(math.exp(min(best.gain, 50.0)), 2)
        text = (
            f"{tried} predicts the scatter better than one isotropic region for all postures: by {size}, so that each "
            f"{row} is {likelier} times as likely."
        )
    else:
        text = f"{tried} predicts the scatter worse than one isotropic region for all postures ({size})."
    if "stated" not in by:
        return text
    gain = best.log_likelihood - by["stated"].log_likelihood
    return f"{text} Over the σ's stated in the file it gains {fixed(gain, 2)}."
