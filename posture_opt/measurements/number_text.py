"""Numbers as instruments write them: decimal commas, and marks between groups of three digits."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass

from posture_opt.errors import BadValueError

_MARKED = re.compile(r"[-+]?[\d.,]*[.,][\d.,]*(?:[eE][-+]?\d+)?")
_SPACED = re.compile(r"[-+]?\d{1,3}(?:['’ \u00a0\u202f]\d{3})+(?:[.,]\d*)?")
_LOOKED_AT = 2000  # cells; a file that changes its marks later has faults there


def _grouped(mark: str) -> re.Pattern[str]:
    """Numbers without a fraction whose digits stand in groups of three."""
    return re.compile(rf"[-+]?[1-9]\d{{0,2}}(?:{re.escape(mark)}\d{{3}})+")


@dataclass(frozen=True)
class NumberText:
    """The decimal mark of a file, and the mark between thousands where it has one."""

    decimal: str = "."
    thousands: str = ""

    @classmethod
    def of(cls, cells: Iterable[str], decimal: str | None, thousands: str | None) -> NumberText:
        """The marks of a file by its cells; what the problem file states counts.

        Raises:
            BadValueError: cells that could be read in two ways, or in none.
        """
        if decimal is not None:
            return cls(decimal, thousands or "")
        if thousands in (".", ","):
            return cls("," if thousands == "." else ".", thousands)
        marked = [text for _, cell in zip(range(_LOOKED_AT), cells) if _MARKED.fullmatch(text := cell.strip())]  # noqa: B905
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
        if _SPACED.fullmatch(text):
            text = re.sub(r"['’ \u00a0\u202f]", "", text)
        if self.thousands and self.thousands in text:
            whole, mark, rest = text.partition(self.decimal)
            if not _grouped(self.thousands).fullmatch(whole):
                return text
            text = whole.replace(self.thousands, "") + mark + rest
        return text.replace(",", ".") if self.decimal == "," and "." not in text else text


def _by_commas(marked: list[str]) -> NumberText:
    """The marks of cells of which some have commas."""
    both = [text for text in marked if "," in text and "." in text]
    if both:
        last = {"," if text.rfind(",") > text.rfind(".") else "." for text in both}
        if len(last) > 1:
            raise _unclear(both[0], "points and commas stand for different things in different rows")
        decimal = last.pop()
        return NumberText(decimal, "." if decimal == "," else ",")
    commas, points = [t for t in marked if "," in t], [t for t in marked if "." in t]
    fractions = [text for text in commas if not _grouped(",").fullmatch(text)]
    broken = [text for text in points if not _grouped(".").fullmatch(text)]
    if fractions and broken:
        raise _unclear(broken[0], f"{fractions[0]} has a decimal comma, {broken[0]} a decimal point")
    if fractions:
        return NumberText(",")
    if broken:
        return NumberText(".", ",")
    raise _unclear(commas[0], f"{commas[0]} may be {commas[0].replace(',', '.')} or {commas[0].replace(',', '')}")


def _unclear(text: str, why: str) -> BadValueError:
    return BadValueError(why, "say in the problem file which it is: data: {decimal: ','} or data: {decimal: '.'}")
