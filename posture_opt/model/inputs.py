"""``Inputs``: what besides the commanded joints decides where the tool point is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from posture_opt.model.chain import Scalar
from posture_opt.numerics import Codes

REFERENCE_TEMPERATURE = 20.0
"""degC at which the lengths of a model hold (ISO 1); a task without a temperature is done there."""


@dataclass(frozen=True, eq=False)
class Inputs:
    """Inputs of effects at one posture, or at N of them as arrays (N,).

    Args:
        payload: mass at the tool point [kg].
        approach: (n,) side from which each joint arrived, -1 or +1; 0 where it is not known. Empty: all unknown.
        approach_length: (n,) length of that last move [rad or m]; empty: long moves.
        temperature: above the reference temperature [K].
        time: since the first measurement [s]; rows are counted where no time is given.
        stated: names of the joints whose side is known.
    """

    payload: Scalar = 0.0
    approach: Sequence[Scalar] = ()
    approach_length: Sequence[Scalar] = ()
    temperature: Scalar = 0.0
    time: Scalar = 0.0
    stated: tuple[str, ...] = ()

    def take(self, rows: Codes) -> Inputs:
        """The inputs of some of N postures; the time stays the one since the first measurement of all."""
        return Inputs(
            self.payload[rows], [side[rows] for side in self.approach], [way[rows] for way in self.approach_length],
            self.temperature[rows], self.time[rows], self.stated,
        )  # fmt: skip

    def side(self, joint: int) -> Scalar:
        """The side from which a joint arrived."""
        return self.approach[joint] if len(self.approach) else 0.0

    def travel(self, joint: int) -> Scalar:
        """The length of the last move of a joint, endless where nobody says [rad or m]."""
        return self.approach_length[joint] if len(self.approach_length) else 1e6
