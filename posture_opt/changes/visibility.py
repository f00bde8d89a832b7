"""How large a change must be to be seen on the measured postures."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from posture_opt.changes.hypotheses import Hypotheses
from posture_opt.experiments.possible_changes import change_name
from posture_opt.numerics import Array, Json, finite_or_none

POWER = 0.9
"""Probability of being detected from which on a change counts as visible."""
REFERENCE_M = 0.1e-3
"""The motion of the tool whose probability of being detected is reported [m]."""
_LEAST_M, _MOST_M = 1e-5, 0.05
"""Motions between which the visible one is searched, by halving their ratio so often:"""
_HALVINGS = 9
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

    @property
    def name(self) -> str:
        """The name of the change."""
        return change_name(self.kind, self.target)

    @property
    def seen(self) -> bool:
        """Whether there is a size from which on the change is detected: a turn of half a revolution is none."""
        return not (self.unit == "rad" and math.pi < self.size < math.inf)

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
    """Of one change, by its simplest form."""
    change, form = models.changes[index], models.forms[index][0]
    shift = _visible_motion(models, index, draws)
    single = len(change.parameters) == 1
    size = shift * abs(float(form.W[0, 0])) if single else math.nan
    unit = change.parameters[0].unit if single else "m"
    return Visibility(change.kind, change.target, models.power(index, REFERENCE_M, draws), shift, size, unit)


def _visible_motion(models: Hypotheses, index: int, draws: Array) -> float:
    """The motion [m] that is detected with the probability `POWER`; infinite where the largest is not."""
    if models.power(index, _MOST_M, draws) < POWER:
        return math.inf
    low, high = _LEAST_M, _MOST_M
    for _ in range(_HALVINGS):
        middle = math.sqrt(low * high)
        low, high = (low, middle) if models.power(index, middle, draws) >= POWER else (middle, high)
    return math.sqrt(low * high)
