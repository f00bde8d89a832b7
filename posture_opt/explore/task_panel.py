"""``TaskPanel``: errors and numbers of the task on sliders, its criterion and its direction."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from html import escape
from typing import TYPE_CHECKING, Any, get_args

from posture_opt.explore.settings import Setting, settings_of
from posture_opt.problem.plain_data import Plain
from posture_opt.problem.problem import Problem

if TYPE_CHECKING:
    import viser

_DIRECTION_STEP = 0.01


class TaskPanel:
    """What may be asked differently.

    Args:
        gui: inside the folder that the controls are in.
        problem: as stated.
        changed: called with key -> value of all that is not as stated; returns whether they fit.
    """

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
    """Key -> control of what is chosen or typed: the criterion, and the direction."""
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
    """A slider of a setting; of a logarithmic one it shows the decades from what is stated."""
    low, high, first = setting.range
    label = f"{setting.label}, log10 of the factor" if setting.logarithmic else f"{setting.label} [deg]"
    return gui.add_slider(label, low, high, 0.01, first)


def _table(settings: Sequence[tuple[Setting, float]]) -> str:
    """What each setting is now, and what the file states where that is something else."""
    rows = "".join(
        f"<tr><td>{escape(s.label)}</td><td>{escape(s.words(at))}</td><td>"
        f"{escape('stated ' + s.words(s.range[2])) if at != s.range[2] else ''}</td></tr>"
        for s, at in settings
    )
    return f'<table style="margin:4px 14px;font-size:12px">{rows}</table>'
