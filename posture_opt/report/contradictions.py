"""The first lines of a report where the data refute what the problem file states as known."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from posture_opt.report.error_table import mm
from posture_opt.units import plus_minus, shown

if TYPE_CHECKING:
    from posture_opt.calibration.stated_knowledge import Contradiction

_DIMENSIONS = {"m": "length", "rad": "angle"}
_TURNED = math.radians(0.01)  # less is no turn that anyone would mend


def contradiction_lead(contradictions: Sequence[Contradiction]) -> tuple[str, ...]:
    """What differs from the file and by how much, what was done about it, and the mend; one line each."""
    return tuple(_line(found) for found in contradictions)


def _line(found: Contradiction) -> str:
    if found.sigma:
        ((name, (value, std, unit)),) = found.estimate.items()
        dimension = _DIMENSIONS[unit]
        text = f"The data contradict the standard deviation of {shown(found.sigma, dimension)} that the file states of "
        text += f"{found.cause.target}.{name}: it is off by {shown(value, dimension, std)}. "
        return f"{text}The stated value is set aside here: that {gain_words(found)}."
    frame = found.cause.target
    text = f"The data contradict the {frame} frame that the file states: the {frame} is off by {_off(found)}. "
    return f"{text}It is taken as free here: that {gain_words(found)}. Correct the file, or write '{frame}: free'."


def gain_words(found: Contradiction) -> str:
    """What setting all contradictions aside brings."""
    return f"reduces the RMS error of the calibrated arm from {mm(found.rms_stated)} mm to {mm(found.rms)} mm"


def _off(found: Contradiction) -> str:
    """How far a frame is off, and how far it is turned where that is told."""
    shift = [(v, s) for v, s, unit in found.estimate.values() if unit == "m"]
    turn = [(v, s) for v, s, unit in found.estimate.values() if unit == "rad"]
    length, std = _length(shift)
    texts = [plus_minus(length, std, 1e3, "mm")] if shift else []
    angle, error = _length(turn)
    if angle > max(_TURNED, 3 * error):
        texts.append(plus_minus(angle, error, math.degrees(1.0), "deg"))
    return " and ".join(texts)


def _length(parts: Sequence[tuple[float, float]]) -> tuple[float, float]:
    """Length of a vector of (value, standard error), and its own to first order."""
    length = math.sqrt(sum(v**2 for v, _ in parts))
    return length, math.sqrt(sum((v * s) ** 2 for v, s in parts)) / length if length else 0.0
