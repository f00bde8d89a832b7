"""``Setting``: one number of a problem that a slider changes: a standard deviation, the clearance, the tilt.

Each is a key of the problem file, so that what the page shows can be saved and solved again.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from posture_opt.problem.plain_data import Plain
from posture_opt.problem.problem import Problem
from posture_opt.statements.notation import stated
from posture_opt.units import parse_quantity

_DECADES = 1.0
"""A logarithmic slider goes so many decades to either side of what is stated."""
_MAX_TILT_DEG = 45.0  # deg


@dataclass(frozen=True)
class Setting:
    """A number of a problem file that may be changed.

    Args:
        label: what it is, with its name in the file.
        key: its place, ``uncertainty__sigma__elbow.theta``.
        value: that is stated [SI].
        unit: ``m`` or ``rad``.
        logarithmic: whether it changes by factors of what is stated, or else between zero and ``most``.
        most: of a setting that is not logarithmic [SI].
    """

    label: str
    key: str
    value: float
    unit: str
    logarithmic: bool = True
    most: float = 0.0

    @property
    def range(self) -> tuple[float, float, float]:
        """Least, greatest and first position of its slider: decades about the stated value, or degrees."""
        if self.logarithmic:
            return -_DECADES, _DECADES, 0.0
        return 0.0, math.degrees(self.most), math.degrees(self.value)

    def at(self, position: float) -> float:
        """The value [SI] at a position of its slider."""
        return float(f"{self.value * 10.0**position:.3g}") if self.logarithmic else math.radians(position)

    def words(self, position: float) -> str:
        """What it is at a position of its slider, with its unit."""
        return stated(self.at(position), self.unit)

    def change(self, position: float) -> dict[str, Plain]:
        """What to replace in the problem, by its key; nothing where it is as stated."""
        if position == self.range[2]:
            return {}
        return {self.key: f"{self.at(position):.6g} {self.unit}"}


def settings_of(problem: Problem) -> tuple[Setting, ...]:
    """What sliders may change: the stated standard deviations, or the data sheet's; the clearance; the tilt."""
    return (*_errors(problem), *_task(problem))


def _errors(problem: Problem) -> Iterator[Setting]:
    stated_errors = problem.document.get("uncertainty") or {}
    for section, what in (("sigma", "σ"), ("scatter", "scatter")):
        for name, text in (stated_errors.get(section) or {}).items():
            factor = problem.robot.parameters.get(name)
            if factor is not None:
                dimension, unit = ("angle", "rad") if factor.kind == "rotate" else ("length", "m")
                value = parse_quantity(text, dimension)
                yield Setting(f"{what} {name}", f"uncertainty__{section}__{name}", value, unit)
    sheet = stated_errors.get("repeatability")
    if sheet is not None:
        yield Setting("repeatability", "uncertainty__repeatability", parse_quantity(sheet, "length"), "m")
    elif not stated_errors and problem.robot.repeatability is not None:
        yield Setting("repeatability", "uncertainty__repeatability", problem.robot.repeatability.value, "m")


def _task(problem: Problem) -> Iterator[Setting]:
    task = problem.task
    if task is not None and task.clearance is not None:
        yield Setting("clearance", "task__clearance", task.clearance, "m")
    if task is not None and problem.robot.n > 3:  # fewer joints cannot lean the tool anywhere
        yield Setting("tilt", "task__tilt", task.tilt, "rad", logarithmic=False, most=math.radians(_MAX_TILT_DEG))
