"""Sentences on what holds a geometry that the data leave open: the size of the arm, and tolerances of its parts."""

from __future__ import annotations

import math

import numpy as np

from posture_opt.calibration.estimation.fit import Fit
from posture_opt.calibration.estimation.fit_setup import FitSetup
from posture_opt.calibration.estimation.residuals import Residuals
from posture_opt.calibration.estimation.tolerances import TOLERANCES, sorts_of_parts
from posture_opt.errors import listed

_SIZE_NOTE = "{} alone do not determine the size of the arm: {}; {}"
_HELD_BY_LENGTHS = "the lengths in the file hold it, within their tolerance"
_TOLERANCE_NOTE = (
    "parts are taken to be within manufacturing tolerance of nominal, as wide as the data suggest (one σ: {})"
)
_STAY_NOTE = "the data hardly improve, so that they stay near nominal: {}"
_MAX_NAMED = 12
"""Parameters that a sentence names."""


def size_notes(residuals: Residuals, held: int | None) -> tuple[str, ...]:
    """A sentence on what holds the size of an arm that the data leave open, and what would determine it."""
    kind = residuals.data.kind
    if held is None and (kind.fixes_size or residuals.distances):
        return ()
    by = _HELD_BY_LENGTHS if held is None else f"{residuals.parameters[held].name} is held"
    return (_SIZE_NOTE.format(kind.noun, by, kind.remedy),)


def place_notes(residuals: Residuals, known: FitSetup, found: Fit) -> tuple[str, ...]:
    """Sentences on unknowns of planes, cameras and the like that stay open."""
    rows = zip(residuals.parameters, found.std, known.fixed, strict=True)
    errors = {p.name: float(std) if fixed else math.inf for p, std, fixed in rows if p.group == "place"}
    return residuals.data.kind.open_notes(errors)


def tolerance_notes(residuals: Residuals, known: FitSetup) -> tuple[str, ...]:
    """Sentences on tolerances by manufacturing, and on the parameters that the data do not improve."""
    own = np.flatnonzero(np.isfinite(known.assumed))
    if not len(own):
        return ()
    parameters = [residuals.parameters[i] for i in own]
    widths = zip(parameters, sorts_of_parts(residuals, own), known.assumed[own], strict=True)
    text = ", ".join(dict.fromkeys(f"{TOLERANCES[sort].noun} {1e3 * sigma:.2g} m{p.unit}" for p, sort, sigma in widths))
    names = [residuals.parameters[i].name for i in own if not known.fixed[i]]
    stay = (_STAY_NOTE.format(listed(names, _MAX_NAMED)),) if names else ()
    return (_TOLERANCE_NOTE.format(text), *stay)
