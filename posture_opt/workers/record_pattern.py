"""What the results of a part look like as JSON: what a checkpoint holds may have been written by anybody."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from posture_opt.workers import Part, R, S, T

Pattern = Any
FINITE = "finite"  # The pattern of a number that is neither NaN nor infinite
_ATTRIBUTE = "record_pattern"


@dataclass(frozen=True)
class Either:
    """One of two patterns."""

    one: Pattern
    other: Pattern


def matches(value: object, pattern: Pattern) -> bool:
    """Whether a value of JSON is as the pattern says."""
    if isinstance(pattern, Either):
        return matches(value, pattern.one) or matches(value, pattern.other)
    if isinstance(pattern, frozenset):
        return type(value) in (str, int) and value in pattern
    if isinstance(pattern, tuple):
        return isinstance(value, list) and len(value) == len(pattern) and all(map(matches, value, pattern))
    if isinstance(pattern, list):
        return isinstance(value, list) and all(matches(entry, pattern[0]) for entry in value)
    if isinstance(pattern, dict):
        return isinstance(value, dict) and all(k in value and matches(value[k], p) for k, p in pattern.items())
    if pattern in (float, FINITE):
        number = isinstance(value, int | float) and not isinstance(value, bool)
        return number and (pattern is float or math.isfinite(value))  # type: ignore[arg-type] # it is a number
    if pattern is None:
        return value is None
    return pattern is object or type(value) is pattern


def recorded(pattern_of: Callable[[Any, Any], Pattern]) -> Callable[[Part[S, T, R]], Part[S, T, R]]:
    """States the pattern of the results of a part, for what all parts share and its item."""

    def stated(part: Part[S, T, R]) -> Part[S, T, R]:
        setattr(part, _ATTRIBUTE, pattern_of)
        return part

    return stated


def is_result(part: Part[S, T, R], shared: S, item: T, result: object) -> bool:
    """Whether something can be a result of a part: anything, of a part without a pattern."""
    pattern_of = getattr(part, _ATTRIBUTE, None)
    return pattern_of is None or matches(result, pattern_of(shared, item))
