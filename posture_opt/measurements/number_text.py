"""Numbers as instruments write them: decimal commas, and marks between groups of three digits."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import islice

from posture_opt.errors import BadValueError

_MARKED_NUMBER = re.compile(r"[-+]?[\d.,]*[.,][\d.,]*(?:[eE][-+]?\d+)?")
"""A number with points or commas in it."""
_SPACED_NUMBER = re.compile(r"[-+]?\d{1,3}(?:['’ \u00a0\u202f]\d{3})+(?:[.,]\d*)?")
"""A number with blanks or apostrophes between groups of three digits."""
_MAX_SAMPLE_CELLS = 2000
"""Cells that decide on the marks; a file that changes its marks later has faults there."""


def _grouped_digits(mark: str) -> re.Pattern[str]:
    """Pattern of numbers without a fraction whose digits are in groups of three."""
    return re.compile(rf"[-+]?[1-9]\d{{0,2}}(?:{re.escape(mark)}\d{{3}})+")


@dataclass(frozen=True)
class NumberText:
    """The decimal mark of a file, and the mark between thousands where it has one.

    Example:
        >>> NumberText(",", ".").to_plain("1.234,5")
        '1234.5'
    """

    decimal: str = "."
    thousands: str = ""

    @classmethod
    def of(cls, cells: Iterable[str], decimal: str | None, thousands: str | None) -> NumberText:
        """The marks of a file by its cells; what the problem file states counts.

        Args:
            cells: of columns of numbers, in any order; the first `_MAX_SAMPLE_CELLS` are read.
            decimal, thousands: as stated; None where they are left open.

        Raises:
            BadValueError: cells that could be read in two ways, or in none.
        """
        if decimal is not None:
            return cls(decimal, thousands or "")
        if thousands in (".", ","):
            return cls("," if thousands == "." else ".", thousands)
        sample = islice(cells, _MAX_SAMPLE_CELLS)
        marked = [text for cell in sample if _MARKED_NUMBER.fullmatch(text := cell.strip())]
        if not any("," in text for text in marked):
            return cls(".", thousands or "")
        return _by_commas(marked)

    @property
    def plain(self) -> bool:
        """Whether numbers are written as programs write them."""
        return self.decimal == "." and not self.thousands

    def to_plain(self, text: str) -> str:
        """The number as programs write it; the text itself where it is none in these marks."""
        text = text.strip()
        if _SPACED_NUMBER.fullmatch(text):
            text = re.sub(r"['’ \u00a0\u202f]", "", text)
        if self.thousands and self.thousands in text:
            whole, mark, rest = text.partition(self.decimal)
            if not _grouped_digits(self.thousands).fullmatch(whole):
                return text
            text = whole.replace(self.thousands, "") + mark + rest
        return text.replace(",", ".") if self.decimal == "," and "." not in text else text


def _by_commas(marked: list[str]) -> NumberText:
    """The marks of cells of which some have commas.

    Raises:
        BadValueError: they contradict each other, or are all open to two readings.
    """
    both = [text for text in marked if "," in text and "." in text]
    if both:
        last = {"," if text.rfind(",") > text.rfind(".") else "." for text in both}
        if len(last) > 1:
            raise _ambiguous_marks(both[0], "points and commas mean different things in different rows")
        decimal = last.pop()
        return NumberText(decimal, "." if decimal == "," else ",")
    commas, points = [t for t in marked if "," in t], [t for t in marked if "." in t]
    fractions = [text for text in commas if not _grouped_digits(",").fullmatch(text)]
    broken = [text for text in points if not _grouped_digits(".").fullmatch(text)]
    if fractions and broken:
        raise _ambiguous_marks(broken[0], f"{fractions[0]} has a decimal comma, {broken[0]} a decimal point")
    if fractions:
        return NumberText(",")
    if broken:
        return NumberText(".", ",")
    raise _ambiguous_marks(
        commas[0], f"{commas[0]} may be {commas[0].replace(',', '.')} or {commas[0].replace(',', '')}"
    )


def _ambiguous_marks(text: str, why: str) -> BadValueError:
    """The error of cells that could be read in two ways."""
    return BadValueError(why, "say in the problem file which it is: data: {decimal: ','} or data: {decimal: '.'}")
