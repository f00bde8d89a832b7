"""``BetterReading``: another reading of the columns, named beside the one given."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from posture_opt.statements import Quantity, Statement, state


@dataclass(frozen=True)
class ReadingWords:
    """One reading in words.

    Args:
        id: of the statement, as ``reading.joint-zero``.
        message: what is assumed, after ``if``; hint: the line to paste, or what to write.
        column: that it speaks of.
    """

    id: str
    message: str
    hint: str
    column: str


@dataclass(frozen=True)
class BetterReading:
    """The reading that explains the data to their noise, where the one given does not.

    Args:
        reading: what is read otherwise; alike: others that explain the data as well.
        left: median error of the positions as given, and so read [m].
        turned: of the orientations [rad]; None where none were measured.
        usable: whether the data can be used as given.
    """

    reading: ReadingWords
    alike: Sequence[ReadingWords]
    left: tuple[float, float]
    turned: tuple[float, float] | None
    usable: bool

    @property
    def sentence(self) -> str:
        """What fits, and how well."""
        given, found = (f"{value * 1e3:.3g} mm" for value in self.left)
        said = f"the data fit the arm to {found}"
        if self.turned is not None:
            turns = [f"{math.degrees(value):.2g} deg" for value in self.turned]
            said, given = f"{said} and {turns[1]}", f"{given} and {turns[0]}"
        return f"{said} if {self.reading.message}, as given only to {given}"

    @property
    def statement(self) -> Statement:
        """The reading as a caution, with the line to paste."""
        read, given = (Quantity(value) for value in (self.left[1], self.left[0]))
        assumed, hint = self.reading.message, self.reading.hint
        return state(self.reading.id, self.reading.column, assumed=assumed, hint=hint, read=read, given=given)
