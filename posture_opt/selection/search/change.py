"""``Change``: another value at one key of the problem file, as a user would write it, and the problem with it.

What is offered is written first, with the digits that are printed, and solved after that: the value of a change is that
of its text.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from posture_opt.numerics import Json
from posture_opt.robot.robot import Robot
from posture_opt.selection.problem_data import ProblemData
from posture_opt.units import JointQuantity

_FILE_UNITS = {"m": (1e3, "mm"), "rad": (math.degrees(1.0), "deg"), "m/rad": (1e3, "mm")}
"""SI unit -> factor to the unit of files, and its name; a Jacobian's are lengths there, others are as they are."""
_ROUNDING = 1e-3
"""Of the last digit: what is nearer to it than that is rounded to it."""


@dataclass(frozen=True)
class ChangedValue:
    """A number with as many digits as are printed.

    Args:
        value: [SI], of exactly those digits; ``text`` as the file states it.
    """

    value: float
    text: str


@dataclass(frozen=True)
class Change:
    """Another value at a key of the problem file.

    Args:
        key: parts of the key; entries of a list by their name or number.
        value: in SI units and radians, as the section holds it; None removes the entry.
        text: as the file states it.
        words: what to do.
        looser: 1 where a larger value asks for less, −1 where a smaller one does, 0 for a pair of limits and for a
            place, of which no other asks for less.
    """

    key: tuple[str | int, ...]
    value: Any
    text: Json
    words: str
    looser: int = 0

    @property
    def path(self) -> str:
        """The key in one word: ``task.tilt``."""
        return ".".join(map(str, self.key))

    def with_room_for(self, other: Change) -> Change:
        """The looser one of two changes at one key; of limits both."""
        if self.value is None or other.value is None:
            return self if self.value is None else other
        if self.key[0] == "robot":
            (low, high), (other_low, other_high) = self.value, other.value
            lower, upper = (self if low <= other_low else other), (self if high >= other_high else other)
            if lower is upper:
                return lower
            text = [_pair(lower.text)[0], _pair(upper.text)[1]]
            words = f"{lower.words} and {upper.words}"
            return replace(lower, value=(lower.value[0], upper.value[1]), text=text, words=words)
        return max(self, other, key=lambda change: change.looser * float(np.sum(change.value)))


def _pair(text: Json) -> Sequence[Json]:
    """The two texts of a pair of limits."""
    assert isinstance(text, list)
    return text


def rounded(value: float, unit: str, decimals: int, side: int = 0) -> ChangedValue:
    """A value [SI] with so many decimals in the unit of files, rounded up (side 1), down (−1) or to the nearest (0).

    >>> rounded(0.00683201, "m", 1, 1)
    ChangedValue(value=0.0069, text='6.9 mm')
    """
    factor, name = _FILE_UNITS.get(unit, (1.0, "" if unit in ("1", "probability") else unit))
    scaled = value * factor * 10**decimals
    whole = round(scaled) if abs(scaled - round(scaled)) <= _ROUNDING or not side else None
    if whole is None:
        whole = math.ceil(scaled) if side > 0 else math.floor(scaled)
    number = whole / 10**decimals
    text = f"{number:.{max(decimals, 0)}f}"
    text = text.rstrip("0").rstrip(".") if "." in text else text
    return ChangedValue(float(f"{number / factor:.15g}"), f"{'0' if text == '-0' else text} {name}".strip())


def decimals_for(value: float, unit: str, digits: int) -> int:
    """Decimals in the unit of files that show so many digits of a value [SI]."""
    size = abs(value) * _FILE_UNITS.get(unit, (1.0, ""))[0]
    return digits - 1 - math.floor(math.log10(max(size, 1e-9)))


def exact_text(value: float, unit: str) -> str:
    """A value [SI] as the file states it, to twelve digits.

    >>> exact_text(0.6931, "m")
    '693.1 mm'
    """
    factor, name = _FILE_UNITS.get(unit, (1.0, unit))
    return f"{value * factor + 0.0:.12g} {name}"


def with_changes(problem: ProblemData, changes: Sequence[Change]) -> ProblemData:
    """The problem with other values at some keys of its task, its cell and the joints of its robot."""
    for change in changes:
        section, *key = change.key
        if section == "robot":
            robot = _with_limits(problem.robot, str(key[1]), change.value)
            problem = replace(problem, arm=replace(problem.arm, robot=robot))
        else:
            problem = replace(problem, **{str(section): _with_value(getattr(problem, str(section)), key, change.value)})
    return problem


def _with_limits(robot: Robot, name: str, limits: tuple[float, float]) -> Robot:
    """The robot with other limits [rad or m] of one joint."""
    lower, upper = limits
    joints = tuple(replace(j, lower=lower, upper=upper) if j.name == name else j for j in robot.joints)
    return replace(robot, joints=joints)


def _with_value(section: Any, key: Sequence[str | int], value: Any) -> Any:
    """A section, or a list or mapping in it, with another value at a key; None removes an entry of a list."""
    head, *rest = key
    if isinstance(section, tuple):
        names = [k if isinstance(head, int) else entry.name for k, entry in enumerate(section)]
        at = names.index(head)
        if value is None and not rest:
            return section[:at] + section[at + 1 :]
        return (*section[:at], _with_value(section[at], rest, value) if rest else value, *section[at + 1 :])
    before = section.get(head) if isinstance(section, dict) else getattr(section, str(head))
    after = _with_value(before, rest, value) if rest else value
    if isinstance(before, JointQuantity) and isinstance(after, float):
        after = replace(before, value=after)
    return {**section, head: after} if isinstance(section, dict) else section.model_copy(update={str(head): after})
