"""``Panel``: what the answer says in numbers, where the target is, and what is taken away."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

from posture_opt.explore.answers import Answer
from posture_opt.explore.live_scene import Layers
from posture_opt.explore.settings import Setting
from posture_opt.numerics import Array
from posture_opt.problem.plain_data import Plain
from posture_opt.report.page.colours import BLUE, LIGHT
from posture_opt.report.parts.parts import sentence

if TYPE_CHECKING:
    import viser

    from posture_opt.robot.robot import Joint
    from posture_opt.selection.answer.solution import Solution
    from posture_opt.uncertainty.spread.spread import Spread

_BARS = 6  # of the error budget
_STEP_MM = 0.1
_DIGITS = 2  # of joint values, in degrees and mm


class Panel:
    """The controls beside the scene.

    Args:
        server: of the page.
        moved: called with the place (3,) [m] that was typed.
        changed: called with key -> value of the problem file when a setting is changed.
        turned: called with the posture (n,) [rad or m] that the joints were set to; with None, to go back to the best.
        redraw: called when other layers are asked for.
        save: writes the problem, returns what to say of it; ``report`` the report of the answer.
        command: the command line that gives the answer.
        joints: those of the arm; ``settings`` what else has a slider.
    """

    def __init__(
        self,
        server: viser.ViserServer,
        title: str,
        moved: Callable[[Array], None],
        changed: Callable[[dict[str, Plain]], None],
        turned: Callable[[tuple[float, ...] | None], None],
        redraw: Callable[[], None],
        save: Callable[[], str],
        report: Callable[[], str],
        command: Callable[[], str],
        joints: Sequence[Joint],
        settings: Sequence[Setting],
    ) -> None:
        gui, self._command = server.gui, command
        gui.set_panel_label(title)
        self._state = gui.add_html(_line("searching …"))
        self._numbers = gui.add_html("")
        self._place: Any = gui.add_vector3("Target [mm]", (0.0, 0.0, 0.0), step=_STEP_MM, hint="in the world frame")
        self._budget = gui.add_html("")
        self._cloud = gui.add_checkbox("Monte Carlo cloud", False, hint="draws of the errors through the full model")
        self._first_order = gui.add_checkbox("First order", False, hint="the 95 % region by the Jacobian alone")
        for box in (self._cloud, self._first_order):
            box.on_update(lambda _event: redraw())
        with gui.add_folder("Errors and task", expand_by_default=False):
            self._settings = [(setting, _setting_slider(gui, setting)) for setting in settings]
            self._stated = gui.add_html("")
            as_stated = gui.add_button("As stated")
        with gui.add_folder("Joints", expand_by_default=False):
            self._joints = [_slider(gui, joint) for joint in joints]
            back = gui.add_button("Back to the best posture")
        self._text: Any = gui.add_text("Command", "", multiline=True, hint="gives this answer on the command line")
        button = gui.add_button("Save problem", hint="as a file that the command line takes")
        told = gui.add_button("Save report", hint="figures, numbers and a page, as --out writes them")
        self._saved = gui.add_html("")

        @self._place.on_update
        def _(event: Any) -> None:
            if event.client is not None:  # what the program sets itself is no request
                moved(np.array(self._place.value) / 1e3)

        @back.on_click
        def _(_event: Any) -> None:
            turned(None)

        for _setting, slider in self._settings:
            slider.on_update(lambda event: changed(self._changes()) if event.client is not None else None)

        @as_stated.on_click
        def _(_event: Any) -> None:
            for setting, slider in self._settings:
                slider.value = setting.range[2]
            changed({})

        for _scale, slider in self._joints:
            slider.on_update(lambda event: turned(self._posture()) if event.client is not None else None)

        @button.on_click
        def _(_event: Any) -> None:
            self._saved.content = _line(save())

        @told.on_click
        def _(_event: Any) -> None:
            self._saved.content = _line("writing the report …")
            self._saved.content = _line(report())

    @property
    def layers(self) -> Layers:
        """What is to be laid over the error region."""
        return Layers(cloud=self._cloud.value, first_order=self._first_order.value)

    def show(self, answer: Answer) -> None:
        """An answer in numbers; of none, the reason."""
        self._text.value = self._command()
        self._stated.content = _settings_table([(s, slider.value) for s, slider in self._settings])
        if answer.solution is None:
            self._numbers.content = self._budget.content = ""
            self._state.content = _line(
                sentence(answer.reason) if answer.reason else "No posture found here; looking for the reason …",
                alarm=True,
            )
            return
        if answer.own is not None:
            self._state.content = _line(_compared(answer.solution, answer.own))
            self._numbers.content = _small(answer.own._repr_html_())
            return
        self._state.content = _line(_status(answer))
        self._numbers.content = _small(answer.solution._repr_html_())
        self._budget.content = _bars(answer.solution)
        for (factor, slider), value in zip(self._joints, answer.solution.q, strict=True):
            slider.value = round(float(value) * factor, _DIGITS)

    def _changes(self) -> dict[str, Plain]:
        """Key -> value of all that is not as stated."""
        return {key: value for s, slider in self._settings for key, value in s.change(slider.value).items()}

    def _posture(self) -> tuple[float, ...]:
        """(n,) what the joints are set to [rad or m]."""
        return tuple(slider.value / scale for scale, slider in self._joints)

    def place(self, position: Array) -> None:
        """Where the target is [m]."""
        x, y, z = (float(round(1e3 * v, 1)) for v in position)
        self._place.value = (x, y, z)


def _status(answer: Answer) -> str:
    """How final an answer is, in words."""
    if not answer.whole:
        return "Following the target; the full search runs once it rests."
    if answer.gain:
        return f"Full search: another branch is {100 * answer.gain:.2g} % better, and the arm has gone there."
    return "Best posture of the full search."


def _compared(best: Solution, own: Spread) -> str:
    """How a posture of the user's own compares with the best one, which the task asks for."""
    ratio = best.sigma_at(best.target, np.array(own.q)) / best.sigma_max
    off = 1e3 * float(np.linalg.norm(own.position - best.spread.position))
    return f"Posture of your own: {ratio:.3g} times the deviation of the best one; tool point {off:.1f} mm from its."


def _slider(gui: viser.GuiApi, joint: Joint) -> tuple[float, Any]:
    """A slider over the range of a joint, in degrees or mm, and how many of these make one rad or m."""
    scale, unit = (1e3, "mm") if joint.type == "prismatic" else (180.0 / np.pi, "deg")
    low, high = scale * joint.lower, scale * joint.upper
    step = 10.0**-_DIGITS
    return scale, gui.add_slider(f"{joint.name} [{unit}]", low, high, step, min(max(0.0, low), high))


def _setting_slider(gui: viser.GuiApi, setting: Setting) -> Any:
    """A slider of a setting; of a logarithmic one it shows the decades from what is stated."""
    low, high, first = setting.range
    label = f"{setting.label}, log10 of the factor" if setting.logarithmic else f"{setting.label} [deg]"
    return gui.add_slider(label, low, high, 0.01, first)


def _settings_table(settings: Sequence[tuple[Setting, float]]) -> str:
    """What each setting is now, and what the file states where that is something else."""
    rows = "".join(
        f"<tr><td>{escape(s.label)}</td><td>{escape(s.words(at))}</td><td>"
        f"{escape('stated ' + s.words(s.range[2])) if at != s.range[2] else ''}</td></tr>"
        for s, at in settings
    )
    return f'<table style="margin:4px 14px;font-size:12px">{rows}</table>'


def _small(html: str) -> str:
    return f'<div style="margin:0 10px;font-size:13px;text-align:left">{html}</div>'


def _line(text: str, alarm: bool = False) -> str:
    weight = "600" if alarm else "400"
    return f'<p style="margin:4px 14px;font-size:13px;font-weight:{weight}" role="status">{escape(text)}</p>'


def _bars(solution: Solution) -> str:
    """The error budget: a bar a source, as long as its share of the variance."""
    rows = "".join(
        f'<div style="margin:3px 0"><div style="background:{LIGHT};height:6px">'
        f'<div style="background:{BLUE};height:6px;width:{100 * share.share:.1f}%"></div></div>'
        f"{escape(share.parameter)} {100 * share.share:.0f} %</div>"
        for share in solution.budget[:_BARS]
        if share.share > 0
    )
    return f'<div style="margin:4px 14px;font-size:12px"><b>Error budget</b>{rows}</div>'
