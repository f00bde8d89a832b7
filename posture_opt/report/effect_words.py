"""Causes in the language of the shop floor: what they are, and how large, in units that an engineer uses."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from posture_opt.report.units_text import fixed, number

if TYPE_CHECKING:
    from posture_opt.diagnosis.causes import Finding

Estimate = Mapping[str, tuple[float, float, str]]

_WORDS = {
    "joint_scale": "{0} turns by a constant share more or less than commanded",
    "gear_eccentricity": "a wheel or the encoder of {0} runs out of centre: an error that comes back once a turn",
    "gear_second_harmonic": "an error of {0} that comes back twice a turn, as of an oval wheel",
    "gear_ripple": "the gear of {0} ripples in step with its input shaft",
    "cyclic_error": "an error of {0} that comes back {cycles} times a turn",
    "joint_compliance": "{0} gives way under the torque of gravity",
    "link_bending": "the link behind {0} bends under what it carries",
    "base_compliance": "the base tilts under the weight of the arm",
    "backlash": "{0} has play: it stands elsewhere by the side that it came from",
    "hysteresis": "{0} stays behind by the side that it came from, the more the longer it moved",
    "load_backlash": "{0} has play that grows with the torque on it",
    "joint_coupling": "{1} is taken along when {0} turns",
    "payload_error": "the arm sags in proportion to the payload otherwise than modelled",
    "thermal_growth": "{0} grows with the temperature",
    "thermal_offset": "the zero of {0} wanders with the temperature",
    "drift": "the measured point creeps with time, {0}",
    "slip": "from one moment on {0} stands elsewhere: something slipped",
    "instrument_scale": "the instrument reads all distances too long by one share",
    "instrument_field": "the instrument bends space: errors that are a smooth function of the place",
    "quantisation": "{0} moves in steps",
    "outliers": "single rows are grossly wrong",
    "joint_noise": "{0} scatters more than stated",
    "range_noise": "the instrument scatters more the farther away it measures",
    "stated_sigma": "the noise is not what the problem file states",
    "joint_offset": "the zero of {0} is off",
    "link_length": "the link behind {0} is not as long as the file says",
    "link_offset": "the offset along the axis of {0} is not what the file says",
    "link_twist": "the axis behind {0} is twisted otherwise than the file says",
    "axis_tilt": "the axis behind {0} is tilted against the one before it",
    "base_frame": "the base stands elsewhere than the file says",
    "tool_frame": "the tool point sits elsewhere than the file says",
    "correlated_lengths": "{0} are long or short together, from one robot to the next",
    "geometry": "many lengths and angles of the arm are off, each by a little",
}
_TARGETS = {
    ("thermal_growth", "all"): "the whole arm",
    ("drift", "exponential"): "less and less",
    ("drift", "linear"): "at an even pace",
}
_GEOMETRY = ("joint_offset", "link_length", "link_offset", "link_twist", "axis_tilt", "base_frame", "tool_frame")
_UMBRELLAS = {
    "curve": "a curve over {0}",
    "dent": "a dent in the error of {0}",
    "square wave": "a square wave over {0}",
    "product": "something that two joints do together ({0})",
    "side and posture": "the side from which {0} arrives, by posture",
    "side and load": "the side of approach by the load of another joint ({0})",
    "foreign side": "the side from which another joint arrives ({0})",
    "field": "a wave over the workspace",
    "course": "the course of time",
}
UNLIKELY = 0.05
"""Family-wise p-value below which chance is no explanation."""


def cause_words(kind: str, target: str, estimate: Estimate | None = None) -> str:
    """A cause in words, with the name that it has in the files."""
    cycles = (estimate or {}).get("cycles")
    parts = target.split("->") if "->" in target else [target, target]
    said = _TARGETS.get((kind, target), parts[0])
    words = _WORDS.get(kind, _UMBRELLAS.get(kind, f"{kind} of {{0}}"))
    return words.format(said, parts[-1], cycles="many" if cycles is None else number(cycles[0], 4))


def short_words(kind: str, target: str, estimate: Estimate | None = None) -> str:
    """Kind and target as they stand in the files, with the number of cycles: several may be of one joint."""
    cycles = (estimate or {}).get("cycles")
    more = "" if cycles is None else f", {number(cycles[0], 4)} a turn"
    return f"{kind.replace('_', ' ')} ({target}{more})" if target not in ("all", "data") else kind.replace("_", " ")


def chance_words(p: float) -> str:
    """A family-wise p-value in words."""
    if p < 1e-6:
        return "less than one in a million by chance"
    if p < 0.01:
        return f"one in {1 / p:,.0f} by chance".replace(",", " ")
    return f"{number(100 * p, 2)} in 100 by chance"


def odds(p: float) -> str:
    """The same for a table."""
    if p >= UNLIKELY:
        return "likely"
    return "below 1 in a million" if p < 1e-6 else f"1 in {1 / p:,.0f}".replace(",", " ")


def plus_minus(value: float, std: float, factor: float, unit: str) -> str:
    """A number with its standard error to two digits: 0.261 ± 0.012 mrad."""
    value, std = value * factor, std * factor
    gap = " " if unit else ""
    if not math.isfinite(std) or std <= 0:
        return f"{number(value)}{gap}{unit}"
    decimals = max(0, 1 - math.floor(math.log10(std)))
    return f"{fixed(value, decimals)} ± {fixed(std, decimals)}{gap}{unit}"


def angle_words(value: float, std: float) -> str:
    """0.261 ± 0.012 mrad (54 arcsec)."""
    return f"{plus_minus(value, std, 1e3, 'mrad')} ({number(math.degrees(value) * 3600, 2)} arcsec)"


def size_words(
    finding: Finding, amplitude: tuple[float, float] | None = None, timed: bool = True
) -> list[tuple[str, str]]:
    """Labels and sizes with their standard errors; ``amplitude`` of a sine and cosine with its error.

    Where rows are not ``timed``, what happens in time is counted in rows.
    """
    estimate = dict(finding.estimate)
    rows: list[tuple[str, str]] = []
    if amplitude is not None and {"sin", "cos"} <= set(estimate):
        phase = math.degrees(math.atan2(estimate.pop("cos")[0], estimate.pop("sin")[0]))
        rows.append(("amplitude", f"{angle_words(*amplitude)}, at phase {fixed(phase, 0)} deg"))
    if finding.kind in _GEOMETRY:
        return [("off by", _deviation(*entry)) for entry in estimate.values()]
    if finding.kind == "drift":
        value, std = _length([estimate.pop(axis)[:2] for axis in "xyz"])
        rows.append(("shift", f"{plus_minus(value, std, 1e6, 'µm')} in the end"))
        if finding.target == "linear":
            estimate.pop("constant", None)
    if finding.kind == "quantisation":
        estimate = {"lsb": estimate["lsb"], "share of it that shows": estimate["share"]}
    if finding.kind == "gear_ripple":
        effect: Any = finding.effect
        estimate |= {"cycles": (effect.harmonic * effect.ratio, math.nan, "")} if effect is not None else {}
    if finding.kind == "instrument_field":
        return [("size", f"{len(estimate)} coefficients, see the JSON document")]
    if not timed and "moment" in estimate:
        rows.append(("at", f"row {math.ceil(estimate.pop('moment')[0]) + 1}, as no times are logged"))
    if not timed and "constant" in estimate:
        value, std, _ = estimate.pop("constant")
        rows.append(("two thirds of it after", f"{plus_minus(value, std, 1.0, 'rows')}, as no times are logged"))
    return rows + [_SIZES.get(name, _by_unit)(name, *entry) for name, entry in estimate.items()]


def main_size(finding: Finding, amplitude: tuple[float, float] | None = None) -> str:
    """The first of the sizes without what explains it, or an empty text."""
    if (finding.kind, finding.target) == ("slip", "base"):  # a shift and a turn that only together mean anything
        return ""
    rows = size_words(finding, amplitude)
    return rows[0][1].partition(" (")[0].partition(": ")[0].partition(", ")[0] if rows and finding.estimate else ""


def _length(parts: list[tuple[float, float]]) -> tuple[float, float]:
    """Of a vector with standard errors of its components, as if they were independent."""
    size = math.hypot(*(value for value, _ in parts))
    return size, math.hypot(*(value * std for value, std in parts)) / size if size else math.nan


def _constant(name: str, value: float, std: float, unit: str) -> tuple[str, str]:
    return "two thirds of it after", plus_minus(value, std, 1 / 60, "min")


def _deviation(value: float, std: float, unit: str) -> str:
    """Of a length or an angle from the file."""
    return plus_minus(value, std, *((math.degrees(1.0), "deg") if unit == "rad" else (1e3, "mm")))


def _by_unit(name: str, value: float, std: float, unit: str) -> tuple[str, str]:
    label = name.replace("_", " ")
    if unit == "rad":
        return label, angle_words(value, std)
    if unit == "m":
        return label, plus_minus(value, std, 1e6, "µm") if abs(value) < 1e-3 else plus_minus(value, std, 1e3, "mm")
    if unit in _UNITS:
        return label, plus_minus(value, std, *_UNITS[unit])
    return label, plus_minus(value, std, 1.0, "" if unit in ("", "1") else unit)


_UNITS = {
    "rad/(N*m)": (1e6, "µrad/(N m)"),
    "rad*kg/(N*m)": (1e6, "µrad kg/(N m)"),
    "rad/K": (1e6, "µrad/K"),
    "m/K": (1e6, "µm/K"),
    "1/K": (1e6, "·10⁻⁶/K"),
    "1/m": (1e6, "·10⁻⁶/m"),
    "m/m": (1e6, "µm/m"),
    "s": (1 / 60, "min"),
}


def _compliance(name: str, value: float, std: float, unit: str) -> tuple[str, str]:
    c, k = plus_minus(value, std, 1e6, "µrad/(N m)"), 1e-3 / value if value else math.inf
    if value <= 0:
        return name, f"{c}: less than none, so it stands for something else"
    return name, f"{c}: a stiffness of {plus_minus(k, k * std / value, 1.0, 'N m/mrad')}"


def _ratio(name: str, value: float, std: float, unit: str) -> tuple[str, str]:
    return name, f"{plus_minus(value, std, 1e3, 'mrad')} per rad"


def _cycles(name: str, value: float, std: float, unit: str) -> tuple[str, str]:
    return "cycles a turn", plus_minus(value, std, 1.0, "") if math.isfinite(std) else number(value, 4)


def _travel(name: str, value: float, std: float, unit: str) -> tuple[str, str]:
    return "two thirds of it after", f"a move of {plus_minus(value, std, math.degrees(1.0), 'deg')}"


def _step(name: str, value: float, std: float, unit: str) -> tuple[str, str]:
    return "step", f"{number(math.degrees(value) * 3600)} arcsec"


def _moment(name: str, value: float, std: float, unit: str) -> tuple[str, str]:
    return "at", f"{number(value / 60)} min after the first row"


def _factor(name: str, value: float, std: float, unit: str) -> tuple[str, str]:
    return "noise", f"{plus_minus(value, std, 1.0, '')} times what is stated"


def _scatter(name: str, value: float, std: float, unit: str) -> tuple[str, str]:
    return "scatter", f"{_by_unit(name, value, std, unit)[1]}, one standard deviation"


def _growth(name: str, value: float, std: float, unit: str) -> tuple[str, str]:
    return "noise", f"{number(1 + value, 2)} times larger at the farthest point than at the nearest"


_SIZES: dict[str, Callable[[str, float, float, str], tuple[str, str]]] = {
    "compliance": _compliance,
    "scale": _ratio,
    "ratio": _ratio,
    "cycles": _cycles,
    "travel": _travel,
    "lsb": _step,
    "moment": _moment,
    "constant": _constant,
    "factor": _factor,
    "growth": _growth,
    "sigma": _scatter,
    "count": lambda name, value, std, unit: ("rows", number(value, 1)),
}


def amplitude(theta: Any, covariance: Any) -> tuple[float, float]:
    """Length of the vector (sin, cos) and its standard error from the covariance (2, 2)."""
    a = float(math.hypot(*theta))
    if a == 0:
        return 0.0, math.nan
    g = theta / a
    return a, math.sqrt(max(float(g @ covariance @ g), 0.0))
