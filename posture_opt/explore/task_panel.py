"""``TaskPanel``: errors and numbers of the task on sliders, its criterion and its direction."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING, Any, get_args

from posture_opt.problem.plain_data import Plain
from posture_opt.problem.problem import Problem
from posture_opt.statements.notation import stated
from posture_opt.units import parse_quantity

if TYPE_CHECKING:
    import viser

_DECADES = 1.0  # A logarithmic slider goes so many decades to either side of what is stated
_MAX_TILT_DEG = 45.0  # deg


@dataclass(frozen=True)
class Setting:
    """A number of a problem file that may be changed.

    Args:
        value: that is stated [SI].
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
    return (*_error_settings(problem), *_task_settings(problem))


def _error_settings(problem: Problem) -> Iterator[Setting]:
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


def _task_settings(problem: Problem) -> Iterator[Setting]:
    task = problem.task
    if task is not None and task.clearance is not None:
        yield Setting("clearance", "task__clearance", task.clearance, "m")
    if task is not None and problem.robot.n > 3:  # fewer joints cannot lean the tool anywhere
        yield Setting("tilt", "task__tilt", task.tilt, "rad", logarithmic=False, most=math.radians(_MAX_TILT_DEG))


_DIRECTION_STEP = 0.01


class TaskPanel:
    """What may be asked differently."""

    def __init__(self, gui: viser.GuiApi, problem: Problem, changed: Callable[[dict[str, Plain]], bool]) -> None:
        self._sliders = [(setting, _slider(gui, setting)) for setting in settings_of(problem)]
        self._words = gui.add_html("")
        self._others = dict(_others(gui, problem))
        self._stated = {key: field.value for key, field in self._others.items()}
        back = gui.add_button("As stated")
        for field in (*(slider for _, slider in self._sliders), *self._others.values()):
            field.on_update(lambda event: changed(self.changes) if event.client is not None else None)

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
        found = {key: value for s, slider in self._sliders for key, value in s.change(slider.value).items()}
        for key, field in self._others.items():
            if field.value != self._stated[key]:
                found[key] = list(field.value) if isinstance(field.value, tuple) else field.value
        return found

    def show(self) -> None:
        """In words what every slider stands for."""
        self._words.content = _table([(setting, slider.value) for setting, slider in self._sliders])


def _others(gui: viser.GuiApi, problem: Problem) -> list[tuple[str, Any]]:
    task = problem.task
    if task is None:
        return []
    known = get_args(type(task).model_fields["criterion"].annotation)
    found: list[tuple[str, Any]] = []
    if task.criterion in known:
        found.append(("task__criterion", gui.add_dropdown("Criterion", known, initial_value=task.criterion)))
    x, y, z = (float(v) for v in task.direction)
    field = gui.add_vector3("Direction", (x, y, z), step=_DIRECTION_STEP, hint="of the task, in the world frame")
    return [*found, ("task__direction", field)]


def _slider(gui: viser.GuiApi, setting: Setting) -> Any:
    low, high, first = setting.range
    label = f"{setting.label}, log10 of the factor" if setting.logarithmic else f"{setting.label} [deg]"
    return gui.add_slider(label, low, high, 0.01, first)


def _table(settings: Sequence[tuple[Setting, float]]) -> str:
    rows = "".join(
        f"<tr><td>{escape(s.label)}</td><td>{escape(s.words(at))}</td><td>"
        f"{escape('stated ' + s.words(s.range[2])) if at != s.range[2] else ''}</td></tr>"
        for s, at in settings
    )
    return f'<table style="margin:4px 14px;font-size:12px">{rows}</table>'
