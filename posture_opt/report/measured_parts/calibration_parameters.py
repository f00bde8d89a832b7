"""What a report on a calibration says of the parameters: estimates, how certain they are, what is left open.

Angles are in deg, their errors in mrad, and lengths in mm, with as many decimals as the standard error supports.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from posture_opt.calibration.calibration import CORRELATION_SHOWN
from posture_opt.calibration.estimation.identifiability import ANGLE_TOLERANCE_RAD, LENGTH_TOLERANCE_M
from posture_opt.numerics import Json
from posture_opt.report.parts.parts import sentence
from posture_opt.report.text.blocks import Block, Facts, Table
from posture_opt.statements.notation import count, decimals_of
from posture_opt.units import ERROR_UNITS, fixed, number, plus_minus

if TYPE_CHECKING:
    from posture_opt.calibration.calibration import Calibration

_MAX_CORRELATIONS = 10
_SIGNIFICANCE_LEVEL = 0.05  # probability of a change of this size where nothing changed
_GOOD_CONDITION = 100  # condition below which estimates lose little to noise (Schröer, Albright, Grethlein 1997)


def parameters_block(found: Calibration) -> Block:
    """Every parameter of the arm: nominal value, estimate and standard error, prior, significance, correlations.

    "determined" is yes, no, or "by prior" where only the stated σ determines it; "change / std. error" beyond 1.96 is
    significant for one parameter. The column of priors is left out where none is stated, and touched points are
    counted, not listed.
    """
    shown = [i for i, p in enumerate(found.parameters) if p.group != "place"]
    headers = (
        "parameter",
        "determined",
        "nominal [deg, mm]",
        "estimate [deg, mm]",
        "change [mrad, mm]",
        "std. error [mrad, mm]",
        "change / std. error",
        "prior [mrad, mm]",
    )
    width = len(headers) - (not np.isfinite(found.prior).any())
    table = Table(headers[:width], tuple(_row(found, i)[:width] for i in shown), text_columns=2)
    data = found.request.data
    points = len(data.point_names) if data.touches else 0
    extra = [f"The positions of {count(points, 'touched point')} are fitted too."] if points else []
    priors = "; the prior is the stated σ" if width == len(headers) else "; no prior σ is stated"
    priors = "; the prior is a tolerance by manufacturing, or the stated σ" if found.assumed.any() else priors
    text = f"Estimates with one standard error, without bounds{priors}. "
    words = [*extra, *_significance(found), *_far(found, shown)]
    return Block("Parameters", (text, table, *words, *_correlations(found, shown)))


def places_blocks(found: Calibration) -> list[Block]:
    """What was found of planes and anchors, in the frame of the base, and what such data cannot show."""
    blocks = []
    for one in found.instruments.values():
        if not one.places or found.request.data.touches:
            continue
        places = _each_frame(one.places)
        names = list(dict.fromkeys(key for place in places.values() for key in place))
        rows = [(name, *(_place_cell(key, place.get(key)) for key in names)) for name, place in places.items()]
        headers = (one.kind, *(f"{key} [{_UNITS[key][1]}]" if key in _UNITS else key for key in names))
        blind = (f"{sentence(one.blind_spot)}",) if one.blind_spot else ()
        how = "In the world of the file; found together with the arm."
        blocks.append(Block(f"What the {one.noun} show", (how, Table(headers, tuple(rows)), *blind)))
    return blocks


def _each_frame(places: Mapping[str, Mapping[str, Json]]) -> dict[str, Mapping[str, Json]]:
    """The places by name; of a place with several frames, as a camera and its board, each of them."""
    found: dict[str, Mapping[str, Json]] = {}
    for name, place in places.items():
        inner = {f"{name}: {part}": own for part, own in place.items() if isinstance(own, Mapping)}
        found |= inner or {name: place}
    return found


_UNITS = {
    **dict.fromkeys(("x", "y", "z", "offset", "distance"), (1e3, "mm", 3)),
    **dict.fromkeys(("roll", "pitch", "yaw"), (math.degrees(1.0), "deg", 4)),
    **dict.fromkeys(("focal_length", "principal_point"), (1.0, "px", 2)),
}
"""Unknowns of places with a unit: factor from SI, unit and decimals in reports."""


def _place_cell(key: str, value: object) -> str:
    """One unknown of a place: lengths in mm, angles in deg, directions as they are."""
    if value is None:
        return ""
    factor, _, decimals = _UNITS.get(key, (1.0, "", 5))
    if isinstance(value, list):
        return "(" + ", ".join(f"{factor * v:.{decimals}f}" for v in value) + ")"
    return f"{factor * float(value):.{decimals}f}"  # type: ignore[arg-type]


def _row(found: Calibration, i: int) -> tuple[str, ...]:
    """One parameter as a row of the table: values in deg or mm, errors in mrad or mm.

    A parameter that the data do not determine has no estimate, except a frame, whose value goes with the others of
    this calibration only.
    """
    p, std, prior = found.parameters[i], float(found.std[i]), float(found.prior[i])
    of_value = math.degrees(1.0) if p.unit == "rad" else 1e3
    of_error, _ = ERROR_UNITS[p.unit]
    believed = "" if math.isnan(prior) else number(prior * of_error)
    if not found.fixed[i]:
        # A free frame needs some value; this one goes with the rest of the arm as it was drawn.
        some = fixed((p.nominal + float(found.x[i])) * of_value, 3) if p.group in ("base", "tool") else ""
        return p.name, "no", fixed(p.nominal * of_value, 3), some, "", "", "", believed
    nominal, estimate = (fixed(v * of_value, decimals_of(std * of_value)) for v in (p.nominal, p.nominal + found.x[i]))
    change, error = (fixed(v * of_error, decimals_of(std * of_error)) for v in (float(found.x[i]), std))
    how = "yes" if found.identifiability.determined[i] else "by prior"
    z = float(found.z[i])
    times = "" if math.isnan(z) else fixed(z, decimals_of(max(abs(z), 0.1)))
    return p.name, how, nominal, estimate, change, error, times, believed


def _significance(found: Calibration) -> list[str]:
    """How many determined parameters of the arm differ from nominal at a level of 5 % each.

    Of many parameters some differ by chance: the sentence counts, it does not correct for their number.
    """
    judged = _judged(found)
    if not judged:
        return []
    sure = [i for i in judged if found.p_values[i] < _SIGNIFICANCE_LEVEL]
    of = f"{len(sure)} of {count(len(judged), 'determined parameter')} of the arm"
    return [f"{of} differ significantly from nominal (individual p below 5 %, more than 1.96 standard errors)."]


def determined_words(found: Calibration) -> str:
    """How many unknowns are determined by themselves, and how many together."""
    alone, rank, all_of = int(found.fixed.sum()), found.identifiability.rank, len(found.parameters)
    if alone == all_of:
        return f"all {all_of} unknowns are determined"
    more = f", {rank - alone} more in combination" if rank > alone else ""
    return f"{alone} of {all_of} unknowns are determined individually{more}"


def differing(found: Calibration, most: int) -> str:
    """The parameters of the arm that differ significantly from the file, the most certain first; empty where none does.

    Args:
        most: how many are named.
    """
    sure = [i for i in _judged(found) if found.p_values[i] < _SIGNIFICANCE_LEVEL]
    if not sure:
        return ""
    sure.sort(key=lambda i: -abs(found.z[i]))
    named = ", ".join(_deviation(found, i) for i in sure[:most])
    if len(sure) == 1:
        return f"One of the arm differs from the file: {named}"
    return f"{len(sure)} of the arm differ from the file, {'most surely' if len(sure) > most else 'namely'} {named}"


def undetermined_names(found: Calibration, most: int) -> str:
    """The parameters that neither the data nor a prior determine by themselves.

    Args:
        most: how many are named; the others are counted.
    """
    names = [p.name for p, fixed in zip(found.parameters, found.fixed, strict=True) if not fixed and p.group != "place"]
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")


def _deviation(found: Calibration, i: int) -> str:
    """A parameter's deviation from the file with one standard error."""
    p = found.parameters[i]
    return f"{p.name} by {plus_minus(float(found.x[i]), float(found.std[i]), *ERROR_UNITS[p.unit])}"


def _judged(found: Calibration) -> list[int]:
    """Parameters of the arm itself whose deviation can be separated from chance."""
    return [i for i, p in enumerate(found.parameters) if p.group == "geometry" and math.isfinite(found.z[i])]


def _far(found: Calibration, shown: list[int]) -> list[str]:
    """Parameters of the arm that deviate by more than usual manufacturing tolerances, in one sentence.

    A deviation of that size is mostly a wrong zero or length in the file; nothing where there is none.
    """
    far = []
    for i in shown:
        p = found.parameters[i]
        if (
            p.group == "geometry"
            and found.fixed[i]
            and abs(found.x[i]) > (LENGTH_TOLERANCE_M if p.unit == "m" else ANGLE_TOLERANCE_RAD)
        ):
            factor, unit = ERROR_UNITS[p.unit]
            far.append(f"{p.name} by {number(float(found.x[i]) * factor)} {unit}")
    if not far:
        return []
    usual = f"{LENGTH_TOLERANCE_M * 1e3:g} mm, {ANGLE_TOLERANCE_RAD * 1e3:.3g} mrad"
    return [f"Deviations beyond usual tolerances ({usual}): {', '.join(far)}. Is a zero or a length in the file wrong?"]


def _correlations(found: Calibration, shown: list[int]) -> list[str | Table]:
    """Pairs of estimates that are strongly correlated, the strongest first.

    Of correlated estimates only a combination is known well: neither value should be used alone.
    """
    known = [i for i in shown if found.fixed[i]]
    C = found.correlation
    pairs = [(i, j) for a, i in enumerate(known) for j in known[a + 1 :] if abs(C[i, j]) > CORRELATION_SHOWN]
    if not pairs:
        return [f"No two estimates have a correlation above {CORRELATION_SHOWN:g}."] if len(known) > 1 else []
    pairs.sort(key=lambda pair: -abs(C[pair]))
    names = [p.name for p in found.parameters]
    rows = tuple((names[i], names[j], fixed(float(C[i, j]), 3)) for i, j in pairs[:_MAX_CORRELATIONS])
    more = f", the closest {_MAX_CORRELATIONS} of {len(pairs)}" if len(pairs) > _MAX_CORRELATIONS else ""
    return [f"Correlations above {CORRELATION_SHOWN:g}{more}:", Table(("estimate", "with", "correlation"), rows, 2)]


def undetermined_block(found: Calibration) -> Block:
    """The combinations of parameters that no fit to these data can determine.

    Below them: parameters that only a prior determines, the condition number of the scaled Jacobian and its
    observability indices. A condition below 100 loses little to noise (Schröer, Albright, Grethlein 1997).
    """
    known = found.identifiability
    size = f"The data determine {known.rank} combinations of {count(len(found.parameters), 'unknown')}"
    words = [sentence(text) for text in known.words]
    helped = [p.name for p, k, d in zip(found.parameters, found.fixed, known.determined, strict=True) if k and not d]
    by_prior = [f"Determined only with the stated σ's as priors: {', '.join(helped)}."] if helped else []
    left = [f"{size}; undetermined combinations:" if words else f"{size}: all are determined."]
    hint = ["'optimize-posture plan-measurements' proposes more informative postures."] if words else []
    indices = ", ".join(f"{name} {value:.3g}" for name, value in known.observability.items())
    good = f"below {_GOOD_CONDITION} is good" if known.condition > _GOOD_CONDITION else "good"
    facts = Facts(
        (
            ("Condition", f"{number(known.condition)} (largest over smallest singular value; {good})"),
            ("Observability", indices),
        )
    )
    return Block("What the data do not determine", (*left, *words, *by_prior, *hint, facts))
