"""How lecture.md writes numbers and tables."""

from __future__ import annotations

import math
from collections.abc import Iterable

MINUS = "\u2212"


def number(value: float, digits: int = 3) -> str:
    """Fixed decimals with a real minus sign, and no minus before a zero."""
    text = f"{value:.{digits}f}"
    return text.replace("-", MINUS) if float(text) else text.replace("-", "")


def e4(value: float, digits: int = 4) -> str:
    """A variance in 10⁻⁴ m²."""
    return number(value * 1e4, digits)


def mm(value: float, digits: int = 3) -> str:
    return number(value * 1e3, digits)


def percent(value: float, digits: int = 2) -> str:
    return number(value * 100, digits)


def probability(p: float) -> str:
    """Three decimals, or a power of ten where that is zero."""
    return number(p) if p >= 5e-4 else "0" if p == 0 else f"10{superscript(math.floor(math.log10(p)))}"


def superscript(power: int) -> str:
    return str(power).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))


def sci(value: float, digits: int = 2) -> str:
    """``4.6·10⁻⁶``."""
    power = math.floor(math.log10(abs(value)))
    return f"{number(value / 10**power, digits)}·10{superscript(power)}"


def thousands(value: float) -> str:
    """``15 000`` from a hundred on, to two digits, as a ratio of times deserves; one decimal below."""
    if value < 100:
        return number(value, 1)
    scale = 10 ** (math.floor(math.log10(value)) - 1)
    return f"{round(value / scale) * scale:,}".replace(",", " ")


def two_digits(value: float) -> str:
    return f"{float(f'{value:.1e}'):g}"


def vector(v: Iterable[float], digits: int = 3) -> str:
    return "[" + ", ".join(number(float(x), digits) for x in v) + "]"


def table(header: list[str], rows: Iterable[list[str]]) -> str:
    lines = [header, ["---"] + ["--:"] * (len(header) - 1), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)
