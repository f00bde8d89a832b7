"""Which part of a joint turns as often as an error repeats: gear ratios that are common, and what errs so often."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from posture_opt.model.effects.base.multiples import cycles_text
from posture_opt.numerics import Json
from posture_opt.units import number

_STRAIN_WAVE = (30.0, 50.0, 80.0, 100.0, 120.0, 160.0)
"""Ratios of strain-wave gears with the circular spline at rest; one more where the flexspline is (Harmonic Drive)."""
_CYCLOIDAL = (57.0, 105.0, 129.0, 141.0, 145.0, 171.0, 185.0)
"""Ratios of cycloidal gears that no strain-wave gear has (Nabtesco, RV-E)."""
COMMON_RATIOS = tuple(sorted({*_STRAIN_WAVE, *(ratio + 1 for ratio in _STRAIN_WAVE), *_CYCLOIDAL}))
"""Motor turns per turn of the joint."""
_TOLERANCE = 0.4
"""Cycles per revolution by which a line may be off: neighbouring ratios are one apart."""
_OFTEN = {1: "once", 2: "twice", 3: "three times", 4: "four times"}
"""How often a part errs while the motor turns once; wave generators are oval, so that two is as usual as one."""
_PART = "wave generator or pinion, motor shaft and motor encoder"
"""What errs so often in a turn of the motor (Ghorbel, Gandhi, Alpeter 2001, on strain-wave gears)."""


@dataclass(frozen=True)
class RotatingPart:
    """A part that turns as often as an error repeats.

    Args:
        cycles: of the error, per revolution of the joint.
        ratio: motor turns per turn of the joint; ``stated`` whether it is that of the file.
        per_turn: how often the error repeats in a turn of the motor.
    """

    cycles: float
    ratio: float
    per_turn: int
    stated: bool

    @property
    def part(self) -> str:
        """What errs so often."""
        return _PART

    @property
    def words(self) -> str:
        """Why it is that part: "80.0 cycles per revolution is once per revolution of the motor"."""
        at = "" if self.stated else f" at a gear ratio of {number(self.ratio)}"
        often = (
            f"{cycles_text(self.cycles)} cycles per revolution is {_OFTEN[self.per_turn]} per revolution of the motor"
        )
        return f"{often}{at}"

    def to_json(self) -> dict[str, Json]:
        """Plain numbers."""
        return {"cycles": self.cycles, "part": self.part, "ratio": self.ratio, "per_motor_turn": self.per_turn}


def rotating_parts(lines: Sequence[float], stated: float) -> tuple[RotatingPart, ...]:
    """The parts that turn as often as lines of a joint repeat, one for each line that has some.

    Of the common ratios that explain the largest line, the one that explains most lines, with the fewest cycles per
    motor turn. A line alone may have several explanations; the simplest is named.

    Args:
        lines: cycles per revolution of the joint, the largest line first.
        stated: its gear ratio, NaN where the file has none; no other one is tried then.

    Example:
        >>> [(p.ratio, p.per_turn) for p in rotating_parts((80.1, 160.0, 240.2), float("nan"))]
        [(80.0, 1), (80.0, 2), (80.0, 3)]
        >>> rotating_parts((40.0, 80.0, 160.0), float("nan"))
        ()
    """
    known = math.isfinite(stated)
    ratios = (abs(stated),) if known else COMMON_RATIOS
    found = [tuple(p for k in lines if (p := _part_of(k, ratio, known)) is not None) for ratio in ratios]
    if not known:
        found = [parts for parts in found if parts and parts[0].cycles == lines[0]]
    return max(found, key=lambda parts: (len(parts), -sum(p.per_turn for p in parts)), default=())


def _part_of(cycles: float, ratio: float, stated: bool) -> RotatingPart | None:
    """The part that turns so often at one ratio; None where none does."""
    times = round(cycles / ratio)
    if times in _OFTEN and abs(cycles - times * ratio) <= _TOLERANCE:
        return RotatingPart(cycles, ratio, times, stated)
    return None
