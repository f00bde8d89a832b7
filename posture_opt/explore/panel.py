"""``Panel``: what the answer says in numbers, where the target is, and what is taken away."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

from posture_opt.explore.answers import Answer, all_but_position, has_stations
from posture_opt.explore.drawing import line, on_user
from posture_opt.explore.live_map import LiveMap
from posture_opt.explore.live_scene import Layers
from posture_opt.explore.measured import Measured
from posture_opt.explore.obstacles_panel import ObstaclesPanel
from posture_opt.explore.stations import Stations
from posture_opt.explore.task_panel import TaskPanel
from posture_opt.numerics import Array
from posture_opt.problem.problem import Problem
from posture_opt.problem.yaml_source import Plain
from posture_opt.report.page.colours import BLUE, LIGHT
from posture_opt.statements.notation import length, sentence

if TYPE_CHECKING:
    import viser

    from posture_opt.report.scene.arm_geometry import ArmGeometry
    from posture_opt.selection.answer.solution import Solution
    from posture_opt.uncertainty.budget import ShareGroup
    from posture_opt.uncertainty.spread import Spread


@dataclass(frozen=True)
class Actions:
    """What the controls call.

    Args:
        moved: with the place (3,) [m] that the target was typed to.
        turned: with the posture (n,) [rad or m] that the joints were set to; with None, to go back to the best.
        chosen: with the place (3,) [m] of the obstacle that was chosen; None for none.
    """

    moved: Callable[[Array], None]
    changed: Callable[[str, dict[str, Plain]], bool]
    turned: Callable[[tuple[float, ...] | None], None]
    redraw: Callable[[], None]
    chosen: Callable[[Array | None], None]
    save: Callable[[], str]
    report: Callable[[], str]
    picture: Callable[[Any], str]
    asked: Callable[[], Problem]
    command: Callable[[], str]


_SAME = 5e-4  # of σ: places that differ by less are equally good in three digits


class Panel:
    """The controls beside the scene."""

    def __init__(
        self, server: viser.ViserServer, problem: Problem, geometry: ArmGeometry, actions: Actions, measured: bool
    ) -> None:
        gui, self._actions = server.gui, actions
        self._first: tuple[object, float] | None = None
        gui.set_panel_label(problem.name)
        self._state = gui.add_html(line("Searching …"))
        self._numbers = gui.add_html("")
        self._place: Any = gui.add_vector3("Target [mm]", (0.0, 0.0, 0.0), step=0.1, hint="in the world frame")
        self.stations: Stations | None = None
        if has_stations(problem):
            self._place.visible = False
            placed = partial(actions.changed, "placement")
            self.stations = Stations(server, problem, geometry, placed, actions.redraw)
        self._budget = gui.add_html("")
        self._cloud = gui.add_checkbox("Monte Carlo cloud", False, hint="draws of the errors through the full model")
        self._first_order = gui.add_checkbox("First order", False, hint="the 95 % region by the Jacobian alone")
        with gui.add_folder("Errors and task", expand_by_default=False):
            self._task = TaskPanel(gui, problem, partial(actions.changed, "task"))
        with gui.add_folder("Obstacles", expand_by_default=False):
            changed = partial(actions.changed, "obstacles")
            self.obstacles: ObstaclesPanel = ObstaclesPanel(
                gui, problem, changed, actions.chosen, lambda: self._target() + np.array([0.0, 0.0, 0.3])
            )
        with gui.add_folder("Joints", expand_by_default=False):
            self._joints: list[tuple[float, Any]] = []  # units of a slider in one rad or m, and the slider
            for joint in problem.robot.joints:
                scale, unit = (1e3, "mm") if joint.type == "prismatic" else (180.0 / np.pi, "deg")
                low, high = scale * joint.lower, scale * joint.upper
                slider = gui.add_slider(f"{joint.name} [{unit}]", low, high, 0.01, min(max(0.0, low), high))
                self._joints.append((scale, slider))
            back = gui.add_button("Back to the best posture")
        self.map: LiveMap = LiveMap(server, actions.asked, self._put)
        with gui.add_folder("Measurements", expand_by_default=measured):
            self.measured: Measured = Measured(server, actions.asked, geometry.extent, actions.turned)
        self._text: Any = gui.add_text("Command", "", multiline=True, hint="gives this answer on the command line")
        self._add_taken_away(gui)
        for box in (self._cloud, self._first_order):
            box.on_update(lambda _event: actions.redraw())
        on_user(self._place, lambda: actions.moved(self._target()))
        for _, slider in self._joints:
            on_user(slider, lambda: actions.turned(tuple(slider.value / scale for scale, slider in self._joints)))
        back.on_click(lambda _event: actions.turned(None))

    def _add_taken_away(self, gui: viser.GuiApi) -> None:
        problem = gui.add_button("Save problem", hint="as a file that the command line takes")
        report = gui.add_button("Save report", hint="figures, numbers and a page, as --out writes them")
        picture = gui.add_button("Save picture", hint="what this browser shows, as a PNG file")
        self._saved = gui.add_html("")

        def write(doing: str, done: Callable[[Any], str]) -> Callable[[Any], None]:
            def clicked(event: Any) -> None:
                self._saved.content = line(doing)
                self._saved.content = line(done(event.client))
                self._text.value = self._actions.command()  # names the file that was written

            return clicked

        problem.on_click(write("writing …", lambda _: self._actions.save()))
        report.on_click(write("writing the report …", lambda _: self._actions.report()))
        picture.on_click(write("taking the picture …", self._actions.picture))

    def _put(self, position: Array) -> None:
        """The target at a place [m]."""
        self.place(position)
        self._actions.moved(self._target())

    def _target(self) -> Array:
        """(3,) where the target is [m], world."""
        return np.array(self._place.value) / 1e3

    def say(self, words: str) -> None:
        """Why something cannot be done."""
        self._state.content = line(sentence(words), alarm=True)

    @property
    def layers(self) -> Layers:
        """What is to be laid over the error region."""
        return Layers(cloud=self._cloud.value, first_order=self._first_order.value)

    def show(self, answer: Answer) -> None:
        """An answer in numbers; of none, the reason."""
        self._text.value = self._actions.command()
        self._task.show()
        if answer.solution is None:
            for last in (self._numbers, self._budget):
                last.content = _greyed(last.content)
            waiting = "No posture found yet; the full search goes on …"
            self._state.content = line(sentence(answer.reason) if answer.reason else waiting, alarm=True)
            return
        if answer.own is not None:
            self._state.content = line(_compared(answer.solution, answer.own))
            self._numbers.content = _small(answer.own._repr_html_())
            self._budget.content = _bars(answer.own.budget_groups)
            return
        self._state.content = line(_status(answer) + self._beside_first(answer))
        typical = math.nan if answer.solution.points else answer.solution.statistics.typical
        gain = line(f"Typical feasible posture: {length(typical)}.") if math.isfinite(typical) else ""
        self._numbers.content = _small(answer.solution._repr_html_()) + gain
        self._budget.content = _bars(answer.solution.task_spread.budget_groups)
        for (factor, slider), value in zip(self._joints, answer.solution.q, strict=True):
            slider.value = round(float(value) * factor, 2)

    def _beside_first(self, answer: Answer) -> str:
        """How the target compares with the first one that was asked of the same arm, errors and cell."""
        found = answer.solution
        if found is None or found.points or not self._place.visible:
            return ""
        asked = all_but_position(answer.request.problem)
        if self._first is None or self._first[0] != asked:
            self._first = asked, found.sigma
        ratio = found.sigma / self._first[1]
        if abs(ratio - 1.0) < _SAME:
            return " Drag the arrows at the tool point to try another place."
        return f" {ratio:.3g} times the standard deviation at the first target."

    def place(self, position: Array) -> None:
        """Where the target is [m]."""
        x, y, z = (float(round(1e3 * v, 1)) for v in position)
        self._place.value = (x, y, z)


def _status(answer: Answer) -> str:
    if answer.reason:
        return f"Followed the target; no full search: {sentence(answer.reason)}"
    if not answer.whole and has_stations(answer.request.problem):
        return "Searching for all stations together …"
    if not answer.whole:
        return "Following the target; the full search runs once it rests."
    if answer.gain:
        return f"Full search: another branch is {100 * answer.gain:.2g} % better, and the arm has gone there."
    return "Best posture of the full search."


def _compared(best: Solution, own: Spread) -> str:
    if best.points:
        return "Posture of your own."
    ratio = best.sigma_at(best.target, np.array(own.q)) / best.sigma_max
    off = 1e3 * float(np.linalg.norm(own.position - best.spread.position))
    size = "the standard deviation" if abs(ratio - 1.0) < _SAME else f"{ratio:.3g} times the standard deviation"
    return f"Posture of your own: {size} of the best one; their tool points are {off:.1f} mm apart."


_GREYED = '<div style="opacity:0.4">'


def _greyed(html: str) -> str:
    """Numbers that hold no more, and stay in sight."""
    return html if not html or html.startswith(_GREYED) else f"{_GREYED}{html}</div>"


def _small(html: str) -> str:
    quiet = "<style>caption { display: none }</style>"  # the line above and the panel's title say it
    return f'<div style="margin:0 10px;font-size:13px;text-align:left">{quiet}{html}</div>'


def _bars(budget: Sequence[ShareGroup]) -> str:
    """A bar a source, or sources whose errors cancel, as long as their share of the variance."""
    rows = ""
    for group in budget[:6]:
        if group.share >= 0.005:  # else it reads 0 %
            more = len(group.parameters) - 2
            named = ", ".join(group.parameters[:2]) + (f" and {more} more together" if more > 0 else "")
            rows += (
                f'<div style="margin:3px 0"><div style="background:{LIGHT};height:6px">'
                f'<div style="background:{BLUE};height:6px;width:{100 * group.share:.1f}%"></div></div>'
                f"{escape(named)} {100 * group.share:.0f} %</div>"
            )
    return f'<div style="margin:4px 14px;font-size:12px"><b>Error budget</b>{rows}</div>'
