"""What a report on a calibration says of the parameters: estimates, how certain they are, what is left open.

Angles are in deg, their errors in mrad, and lengths in mm, with as many decimals as the standard error supports.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from posture_opt.calibration.calibration_statements import CORRELATION_SHOWN
from posture_opt.numerics import Json
from posture_opt.report.text.blocks import Block, Facts, Table
from posture_opt.statements.notation import count, decimals_of, sentence
from posture_opt.units import ERROR_UNITS, fixed, number

if TYPE_CHECKING:
    from posture_opt.calibration.calibration import Calibration

_MAX_CORRELATIONS = 10
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
    return Block("Parameters", (table, *_correlations(found, shown)), brief=())


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


def determined_words(found: Calibration) -> str:
    """How many unknowns are determined by themselves, and how many together."""
    alone, rank, all_of = int(found.fixed.sum()), found.identifiability.rank, len(found.parameters)
    if alone == all_of:
        return f"all {all_of} unknowns are determined"
    more = f", {rank - alone} more in combination" if rank > alone else ""
    return f"{alone} of {all_of} unknowns are determined individually{more}"


def _correlations(found: Calibration, shown: list[int]) -> list[Table]:
    """Pairs of estimates that are strongly correlated, the strongest first."""
    known = [i for i in shown if found.fixed[i]]
    C, names = found.correlation, [p.name for p in found.parameters]
    pairs = [(i, j) for a, i in enumerate(known) for j in known[a + 1 :] if abs(C[i, j]) > CORRELATION_SHOWN]
    pairs.sort(key=lambda pair: -abs(C[pair]))
    rows = tuple((names[i], names[j], fixed(float(C[i, j]), 3)) for i, j in pairs[:_MAX_CORRELATIONS])
    return [Table(("estimate", "with", "correlation"), rows, 2)] if rows else []


def undetermined_block(found: Calibration) -> Block:
    """Condition number of the scaled Jacobian and observability indices; the statements name what is undetermined."""
    known = found.identifiability
    indices = ", ".join(f"{name} {value:.3g}" for name, value in known.observability.items())
    facts = (
        ("Determined", f"{known.rank} combinations of {count(len(found.parameters), 'unknown')}"),
        ("Condition", f"{number(known.condition)} (good below {_GOOD_CONDITION})"),
        ("Observability", indices),
    )
    return Block("What the data do not determine", (Facts(facts),))
