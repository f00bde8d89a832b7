"""``TaskPanel``: errors and numbers of the task on sliders, its criterion and its direction."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING, Any, get_args

from posture_opt.explore.drawing import on_user
from posture_opt.problem.problem import Problem
from posture_opt.problem.yaml_source import Plain
from posture_opt.statements.notation import stated
from posture_opt.units import parse_quantity

if TYPE_CHECKING:
    import viser


@dataclass(frozen=True)
class Setting:
    """A number of a problem file that a slider changes: by its decades about what is stated, or in degrees.

    Args:
        value: that is stated [SI].
        most: of an angle that is changed in degrees [deg]; None of what is changed by factors.
    """

    label: str
    key: str
    value: float
    unit: str
    most: float | None = None

    @property
    def range(self) -> tuple[float, float, float]:
        """Least, greatest and first position of its slider."""
        return (-1.0, 1.0, 0.0) if self.most is None else (0.0, self.most, math.degrees(self.value))

    def at(self, position: float) -> float:
        """The value [SI] at a position of its slider."""
        return float(f"{self.value * 10.0**position:.3g}") if self.most is None else math.radians(position)

    def words(self, position: float) -> str:
        """The value at a position of its slider, with its unit."""
        return stated(self.at(position), self.unit)


def settings_of(problem: Problem) -> Iterator[Setting]:
    """What sliders may change: the stated standard deviations, or the data sheet's; the clearance; the tilt."""
    stated_errors = problem.document.get("uncertainty") or {}
    for section, what in (("sigma", "σ"), ("scatter", "scatter")):
        for name, text in (stated_errors.get(section) or {}).items():
            factor = problem.robot.parameters.get(name)
            if factor is not None:
                dimension, unit = ("angle", "rad") if factor.kind == "rotate" else ("length", "m")
                value = parse_quantity(text, dimension)
                yield Setting(f"{what} {name}", f"uncertainty__{section}__{name}", value, unit)
    stated_sheet, own_sheet, task = stated_errors.get("repeatability"), problem.robot.repeatability, problem.task
    if stated_sheet is not None:
        yield Setting("repeatability", "uncertainty__repeatability", parse_quantity(stated_sheet, "length"), "m")
    elif not stated_errors and own_sheet is not None:
        yield Setting("repeatability", "uncertainty__repeatability", own_sheet.value, "m")
    if task is not None and task.clearance is not None:
        yield Setting("clearance", "task__clearance", task.clearance, "m")
    if task is not None and problem.robot.n > 3:  # fewer joints cannot lean the tool anywhere
        yield Setting("tilt", "task__tilt", task.tilt, "rad", most=45.0)


class TaskPanel:
    """What may be asked differently."""

    def __init__(self, gui: viser.GuiApi, problem: Problem, changed: Callable[[dict[str, Plain]], bool]) -> None:
        self._sliders: list[tuple[Setting, Any]] = []
        for setting in settings_of(problem):
            unit = ", log10 of the factor" if setting.most is None else " [deg]"
            low, high, first = setting.range
            slider = gui.add_slider(f"{setting.label}{unit}", low, high, 0.01, first)
            self._sliders.append((setting, slider))
        self._words = gui.add_html("")
        self._others = _others(gui, problem)
        self._stated = {key: field.value for key, field in self._others.items()}
        back = gui.add_button("As stated")
        for field in (*(slider for _, slider in self._sliders), *self._others.values()):
            on_user(field, lambda: changed(self.changes))

        @back.on_click
        def _(_event: Any) -> None:
            for setting, slider in self._sliders:
                slider.value = setting.range[2]
            for key, field in self._others.items():
                field.value = self._stated[key]
            changed({})

    @property
    def changes(self) -> dict[str, Plain]:
        """Key -> value of all that is not as stated."""
        found: dict[str, Plain] = {}
        for setting, slider in self._sliders:
            if slider.value != setting.range[2]:
                found[setting.key] = f"{setting.at(slider.value):.6g} {setting.unit}"
        for key, field in self._others.items():
            if field.value != self._stated[key]:
                found[key] = list(field.value) if isinstance(field.value, tuple) else field.value
        return found

    def show(self) -> None:
        """In words what every slider stands for."""
        rows = ""
        for setting, slider in self._sliders:
            first = setting.range[2]
            as_stated = "" if slider.value == first else escape(f"stated {setting.words(first)}")
            rows += f"<tr><td>{escape(setting.label)}</td><td>{escape(setting.words(slider.value))}</td>"
            rows += f"<td>{as_stated}</td></tr>"
        self._words.content = f'<table style="margin:4px 14px;font-size:12px">{rows}</table>'


def _others(gui: viser.GuiApi, problem: Problem) -> dict[str, Any]:
    """Key -> control of what is chosen or typed: the criterion, and the direction."""
    task = problem.task
    if task is None:
        return {}
    known = get_args(type(task).model_fields["criterion"].annotation)
    found: dict[str, Any] = {}
    if task.criterion in known:
        found["task__criterion"] = gui.add_dropdown("Criterion", known, initial_value=task.criterion)
    x, y, z = (float(v) for v in task.direction)
    field = gui.add_vector3("Direction", (x, y, z), step=0.01, hint="of the task, in the world frame")
    return {**found, "task__direction": field}
