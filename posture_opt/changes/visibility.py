"""How large a change must be to be seen on the measured postures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from posture_opt.changes.hypotheses import Hypotheses
from posture_opt.numerics import Array, Json, finite_or_none

POWER = 0.9
"""Probability of being detected from which on a change counts as visible."""
REFERENCE_M = 0.1e-3
"""The motion of the tool whose probability of being detected is reported [m]."""
_SHIFTS_M = 1e-5 * 2.0 ** np.arange(0, 12.01, 0.5)
_DRAWS = 400


@dataclass(frozen=True)
class Visibility:
    """What can be seen of one possible change, in the direction in which least is seen.

    Args:
        kind, target: of the change.
        power: probability that it is detected where it moves the tool by 0.1 mm, root mean square over the rows.
        shift: the motion of the tool [m] that is detected with a probability of 90 %; infinite where none is.
        size, unit: the same as a deviation of the parameter [SI]; NaN for frames, where it is the shift.
    """

    kind: str
    target: str
    power: float
    shift: float
    size: float
    unit: str

    def to_json(self) -> dict[str, Json]:
        """The entry of the document."""
        return {
            "kind": self.kind, "target": self.target, "power": self.power, "shift": finite_or_none(self.shift),
            "size": finite_or_none(self.size), "unit": self.unit,
        }  # fmt: skip


def visibilities(models: Hypotheses) -> tuple[Visibility, ...]:
    """Of every change, by the same random draws."""
    draws = np.random.default_rng(0).standard_normal((_DRAWS, 6))
    return tuple(_visibility(models, index, draws) for index in range(len(models.changes)))


def _visibility(models: Hypotheses, index: int, draws: Array) -> Visibility:
    change, form = models.changes[index], models.forms[index][0]
    powers = np.array([models.power(index, float(shift), draws) for shift in _SHIFTS_M])
    seen = np.flatnonzero(powers >= POWER)
    shift = float("inf")
    if len(seen):
        k = int(seen[0])
        shift = float(_SHIFTS_M[k])
        if k:
            step = (POWER - powers[k - 1]) / (powers[k] - powers[k - 1])
            shift = float(_SHIFTS_M[k - 1] * (_SHIFTS_M[k] / _SHIFTS_M[k - 1]) ** step)
    single = len(change.parameters) == 1
    size = shift * abs(float(form.W[0, 0])) if single else float("nan")
    unit = change.parameters[0].unit if single else "m"
    return Visibility(change.kind, change.target, models.power(index, REFERENCE_M, draws), shift, size, unit)
