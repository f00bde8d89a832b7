"""What a report says of effects that are known only where they were measured."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from posture_opt.statements.notation import angle
from posture_opt.units import number

if TYPE_CHECKING:
    from posture_opt.model.acting_effects import MeasuredRange
    from posture_opt.model.arm import Arm
    from posture_opt.numerics import Array


def range_facts(arm: Arm) -> list[tuple[str, str]]:
    """The joints that may leave the range in which an effect of them was measured; nothing where none may."""
    if not arm.measured_ranges:
        return []
    texts = [f"{_effect_words(found)} for {found.effect.target} {_range_words(found)}" for found in arm.measured_ranges]
    return [("Known", f"{', '.join(texts)}; beyond, it counts as an error")]


def beyond_lead(arm: Arm, Q: Array) -> tuple[str, ...]:
    """A sentence for each effect that postures Q (N, n) [rad or m] leave the measured range of."""
    sentences = []
    for found in arm.beyond_measured(Q):
        values = np.atleast_2d(Q)[:, found.joint]
        worst = float(values[int(np.argmax(np.maximum(found.low - values, values - found.high)))])
        sentences.append(
            f"{found.effect.target} is at {number(math.degrees(worst), 4)} deg, outside the {_range_words(found)} in "
            f"which its {found.effect.title} was measured: it is not corrected there, and counts as an unknown error "
            f"of {angle(found.effect.unmeasured_size)}."
        )
    return tuple(sentences)


def _effect_words(found: MeasuredRange) -> str:
    """The effect by its title."""
    return found.effect.title


def _range_words(found: MeasuredRange) -> str:
    """The range in degrees."""
    return f"{number(math.degrees(found.low), 3)} to {number(math.degrees(found.high), 3)} deg"
