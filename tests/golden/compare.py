"""Two documents held against each other: words, counts and choices exactly, numbers to a relative tolerance."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

WORDS = frozenset({"notes", "words", "undetermined", "reason", "hint", "mend", "label"})
"""Keys whose text is for people: how a thing is said may change, what is found may not."""


_HALF_TURN = 1e-6  # of w: such a quaternion has no sign of its own
_ROUNDING = 1e-18  # rad, m: what is meant to be zero and is not, a thousandth of a proton


def differences(old: Any, new: Any, rtol: float, place: str = "") -> Iterator[str]:
    """A line for every value of ``old`` that ``new`` does not have; what is only in ``new`` is no difference.

    Lists of numbers are compared as vectors: each entry to ``rtol`` of the largest among them; p-values by their
    logarithm.
    """
    if isinstance(old, dict) and isinstance(new, dict):
        for key in old:
            if key in WORDS:
                continue
            if key not in new:
                yield f"{place}.{key}: gone"
            else:
                yield from differences(old[key], new[key], rtol, f"{place}.{key}")
    elif isinstance(old, list) and isinstance(new, list):
        if place.endswith("quaternion_wxyz") and abs(old[0]) < _HALF_TURN:
            new = [-v for v in new] if sum(a * b for a, b in zip(old, new, strict=True)) < 0 else new
        if len(old) != len(new):
            yield f"{place}: {len(old)} entries, now {len(new)}"
        elif numbers(old) and numbers(new):
            scale = max((abs(v) for v in flat(old) if math.isfinite(v)), default=0.0)
            for i, (a, b) in enumerate(zip(flat(old), flat(new), strict=True)):
                if not close(a, b, rtol, scale):
                    yield f"{place}[{i}]: {a!r}, now {b!r}"
        else:
            for i, (a, b) in enumerate(zip(old, new, strict=True)):
                yield from differences(a, b, rtol, f"{place}[{i}]")
    elif place.endswith("p_value") and number(old) and number(new):
        # Its logarithm is what a statistic moves: of a p-value of 1e-200 rounding changes some digits.
        a, b = (math.log(max(float(p), 1e-300)) for p in (old, new))
        if not close(a, b, rtol, max(abs(a), 1.0)):
            yield f"{place}: {old!r}, now {new!r}"
    elif number(old) and number(new):
        if not close(float(old), float(new), rtol, abs(float(old))):
            yield f"{place}: {old!r}, now {new!r}"
    elif old != new:
        yield f"{place}: {old!r}, now {new!r}"


def close(a: float, b: float, rtol: float, scale: float) -> bool:
    """Whether two numbers agree to ``rtol`` of a scale, and what is smaller than rounding of 1 in either."""
    return a == b or (math.isnan(a) and math.isnan(b)) or abs(a - b) <= rtol * max(scale, 1e-300) + _ROUNDING


def number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def numbers(values: list[Any]) -> bool:
    """Whether a list, of lists perhaps, holds numbers alone."""
    return bool(values) and all(numbers(v) if isinstance(v, list) else number(v) for v in values)


def flat(values: list[Any]) -> list[float]:
    """The numbers of nested lists in one."""
    return [x for v in values for x in (flat(v) if isinstance(v, list) else [float(v)])]
