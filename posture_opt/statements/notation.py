"""How numbers are written: lengths in mm (µm below 10 µm), angles in deg, errors of angles in mrad, shares in percent.

Inside the program everything is SI and radians; here, and only here, it becomes what people read.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

from posture_opt.units import ERROR_UNITS, UNKNOWN, fixed, number

CERTAINTY_SHOWN = 0.999
"""Probabilities above this are printed as more than it: what is left out of a model is likelier than the rest."""
_SHOWN_UNITS = ("N m",)  # units that are written after a number; ratios and lengths per radian have none
_MAX_LISTED_LINES = 10  # of a file
_ROUNDING_M = 1e-12  # m: below this it is rounding
_COARSE_RAD = math.radians(0.5) * (1 - 1e-9)  # a σ from this one on is written as people state it, in deg


def length(metres: float, digits: int = 3, among: Iterable[float] = ()) -> str:
    """A length with its unit: 12.3 mm, 4.56 µm; in the unit of the lengths that it is listed with.

    Args:
        metres: [m]; not finite ones are written as unknown.
        digits: significant ones of the largest of ``among``.
        among: other lengths of the same table or sentence: all are written in one unit, to the same decimal.

    >>> length(0.0123), length(4.56e-6), length(4.56e-6, among=[0.0123])
    ('12.3 mm', '4.56 µm', '0.005 mm')
    """
    every = list(among) or [metres]
    unit, factor = length_unit(every)
    if not math.isfinite(metres):
        return UNKNOWN
    return f"{number(metres * factor, digits, factor * largest_of(every)) if abs(metres) > _ROUNDING_M else '0'} {unit}"


def stated_length(metres: float) -> str:
    """A length that somebody stated, as it was: 10 mm, 0.05 mm, 5 µm; any other number to three digits.

    >>> stated_length(5e-5), stated_length(0.01)
    ('0.05 mm', '10 mm')
    """
    unit, factor = length_unit([metres])
    value = float(f"{metres * factor:.9g}")
    return f"{value:g} {unit}" if float(f"{value:.5g}") == value else f"{number(value)} {unit}"


def stated_angle(radians: float) -> str:
    """An angle that somebody stated, as it was: 1 deg, 0.02 deg; any other number to three digits."""
    degrees = float(f"{math.degrees(radians):.9g}")
    return f"{degrees:g} deg" if float(f"{degrees:.4g}") == degrees else f"{number(degrees)} deg"


def angle_error(radians: float, digits: int = 3) -> str:
    """An error of an angle, its σ, or what is left of it: 0.349 mrad."""
    factor, unit = ERROR_UNITS["rad"]
    return f"{number(radians * factor, digits)} {unit}"


def stated_sigma(value: float, unit: str) -> str:
    """A σ that a file states or a data sheet gives: an angle in mrad, a coarse one as it was, 1 deg.

    >>> stated_sigma(math.radians(0.02), "rad"), stated_sigma(math.radians(3), "rad"), stated_sigma(5e-5, "m")
    ('0.349 mrad', '3 deg', '0.05 mm')
    """
    if unit == "rad":
        return stated_angle(value) if value >= _COARSE_RAD else angle_error(value)
    return stated_length(value)


def stated(value: float, unit: str) -> str:
    """A stated number of any SI unit."""
    if unit == "rad":
        return stated_angle(value)
    if unit == "m/rad":
        return f"{stated_length(value)} per rad"
    if unit == "probability":
        return share(value)
    return stated_length(value) if unit == "m" else f"{value:g}{f' {unit}' * (unit != '1')}"


def share(p: float) -> str:
    """A probability as a share, with as many digits as its nines ask for: 95 %, 99.99 %."""
    return f"{100 * p:.12g} %"


def length_unit(metres: Iterable[float]) -> tuple[str, float]:
    """The unit that suits lengths which are listed together, and the factor from m to it."""
    largest = largest_of(metres)
    return ("µm", 1e6) if _ROUNDING_M < largest < 1e-5 else ("mm", 1e3)


def largest_of(values: Iterable[float]) -> float:
    """The largest of some numbers, without their signs; zero of none."""
    return max((abs(value) for value in values if math.isfinite(value)), default=0.0)


def lengths(metres: Sequence[float], separator: str = " x ", digits: int = 3, among: Iterable[float] = ()) -> str:
    """Lengths that belong together, in one unit: 30.1 x 12.2 mm."""
    every = list(among) or metres
    unit, factor = length_unit(every)
    beside = factor * largest_of(every)
    texts = [number(value * factor, digits, beside) if abs(value) > _ROUNDING_M else "0" for value in metres]
    return f"{separator.join(texts)} {unit}"


def place(point: Iterable[float]) -> str:
    """A point in space, to 0.01 mm: (900.00, 400.00, 0.00) mm."""
    return f"({', '.join(fixed(value * 1e3) for value in point)}) mm"


def shift(vector: Sequence[float], among: Iterable[float] = ()) -> str:
    """A small vector with its unit: (0.12, 0, -0.05) mm."""
    unit, factor = length_unit(among or vector)
    size = max(map(abs, vector), default=0.0)
    # Digits are counted at the longest component: the others to the same place.
    decimals = max(0, 2 - math.floor(math.log10(size * factor))) if size > _ROUNDING_M else 0
    return f"({', '.join(fixed(value * factor, decimals) for value in vector)}) {unit}"


def angle(radians: float) -> str:
    """An angle to 0.01 deg, or three digits where it is smaller: 12.34 deg, 0.00123 deg."""
    degrees = math.degrees(radians)
    if not math.isfinite(degrees):
        return UNKNOWN
    return f"{fixed(degrees)} deg" if degrees == 0 or abs(degrees) >= 0.1 else f"{number(degrees)} deg"


def joint_unit(kind: str) -> tuple[str, float]:
    """The unit that joint values are written in, deg or mm, and the factor from rad or m to it."""
    return ("deg", math.degrees(1.0)) if kind == "revolute" else ("mm", 1e3)


def joint_value(value: float, kind: str) -> str:
    """A joint value with its unit: 12.34 deg or 120.00 mm."""
    unit, factor = joint_unit(kind)
    return f"{fixed(value * factor)} {unit}"


def quantity(value: float, unit: str) -> str:
    """A number of any SI unit, as people write it; infinite bounds are ``none``."""
    if math.isinf(value):
        return "none"
    if unit == "rad":
        return f"{fixed(math.degrees(value), 3)} deg"
    if unit == "probability":
        return f"{100 * value:.7g} %"
    if unit == "m":
        return f"{fixed(value * 1e3, 4)} mm"
    return f"{0.0 if abs(value) < 1e-12 else value:.5g}{f' {unit}' * (unit in _SHOWN_UNITS)}"


def percent(share: float) -> str:
    """A share in percent: 97 %, 5.6 %, 0.02 %; one that is not whole is not 100 %.

    >>> percent(0.97), percent(0.056), percent(0.0002), percent(0.9996)
    ('97 %', '5.6 %', '0.02 %', '99.96 %')
    """
    if not math.isfinite(share):
        return UNKNOWN
    value = 100 * share
    if value != 0 and abs(value) < 0.005:
        return "0.00 %"
    if 99.5 <= value < 100:
        return f"{math.floor(100 * value) / 100:.4g} %"
    decimals = 0 if abs(value) >= 9.95 else 1 if abs(value) >= 0.95 else 2 if value else 0
    return f"{value:.{decimals}f} %"


def probability(p: float) -> str:
    """A probability of success to three digits, up to 99.9 %: what a model leaves out is likelier than the rest.

    >>> probability(0.9375), probability(0.9986), probability(0.99995), probability(1e-16)
    ('93.8 %', '99.9 %', '> 99.9 %', '< 0.1 %')
    """
    if p > CERTAINTY_SHOWN:
        return f"> {100 * CERTAINTY_SHOWN:.1f} %"
    return "< 0.1 %" if 0 < p < 1e-3 else f"{100 * p:.3g} %"


def sentence(text: str) -> str:
    """A note with a capital at its start and a full stop at its end; names of joints stay as they are.

    >>> sentence("the arm is checked against itself"), sentence("joint_1 is exact")
    ('The arm is checked against itself.', 'joint_1 is exact.')
    """
    text = text.strip()
    first = text.split(" ", 1)[0]
    if first.isalpha():
        text = text[0].upper() + text[1:]
    return text if text.endswith((".", "!", "?", ")")) else text + "."


def decimals_of(value: float, digits: int = 2) -> int:
    """So many decimals that this many digits of ``value`` are shown."""
    return min(max(digits - 1 - math.floor(math.log10(value)), 0), 7) if value > 0 else 3


def listed_lines(numbers: Sequence[int]) -> str:
    """Lines of a file by their numbers, the first ten of many.

    >>> listed_lines([534]), listed_lines([3, 7])
    ('line 534', 'lines 3, 7')
    """
    shown = ", ".join(map(str, numbers[:_MAX_LISTED_LINES]))
    return f"{'line' if len(numbers) == 1 else 'lines'} {shown}{' …' if len(numbers) > _MAX_LISTED_LINES else ''}"


def count(number_of: int, singular: str, plural: str = "") -> str:
    """A number of things in words: 1 posture, 12 postures, 8,281 postures.

    >>> count(1, "posture"), count(8281, "posture"), count(2, "axis", "axes")
    ('1 posture', '8,281 postures', '2 axes')
    """
    return f"{number_of:,} {singular if number_of == 1 else plural or singular + 's'}"
