"""``Stations``: features or points of a path on the page: chosen, played back, and their workpiece dragged."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

from posture_opt.explore.drawing import add_handle, add_lines
from posture_opt.numerics import Array
from posture_opt.problem.plain_data import Plain
from posture_opt.problem.problem import Problem
from posture_opt.report.page.colours import GREY, mapped_colours
from posture_opt.report.scene.arm_geometry import ArmGeometry
from posture_opt.statements.notation import stated

if TYPE_CHECKING:
    import viser

    from posture_opt.selection.answer.solution import Solution

_PLAYED_S = 6.0  # [s] that a path without a time law is played in
_LEAST_STEP_S, _MOST_STEP_S = 0.04, 0.6
_POINT_SHARE = 0.02  # of the arm's extent: the mark at a station
_STEP_DEG = 0.1


class Stations:
    """The stations of an answer on the page, with their controls.

    Args:
        server: of the page; the controls are put where its panel is at the moment.
        problem: with features, or a path.
        geometry: of the arm: its size, and whether it is planar.
        changed: called with key -> value of the problem file where the workpiece is put somewhere; with none, for the
            best placement.
        redraw: called when another station is to be shown.
    """

    def __init__(
        self,
        server: viser.ViserServer,
        problem: Problem,
        geometry: ArmGeometry,
        changed: Callable[[dict[str, Plain]], bool],
        redraw: Callable[[], None],
    ) -> None:
        self._server, self._extent, self._changed, self._redraw = server, geometry.extent, changed, redraw
        self._found: Solution | None = None
        self._best: Solution | None = None
        self._playing = threading.Event()
        self._player: threading.Thread | None = None
        self._w: Array | None = None
        gui = server.gui
        self._which: Any = gui.add_slider("Station", 1, 2, 1, 1)
        self._words = gui.add_html("")
        self._play = gui.add_button("Play")
        self._which.on_update(lambda event: self._redraw() if event.client is not None else None)
        self._play.on_click(lambda _: self._start_or_stop())
        self.handle: Any = None
        if problem.task is not None and problem.task.workpiece is not None:
            self._add_workpiece(gui, geometry.planar)

    def _add_workpiece(self, gui: viser.GuiApi, planar: bool) -> None:
        """The handle of the workpiece, the slider of its yaw, and the way back to the best placement."""
        self._yaw: Any = gui.add_slider("Yaw of the workpiece [deg]", -180.0, 180.0, _STEP_DEG, 0.0)
        back = gui.add_button("Best placement of the workpiece")
        self.handle = add_handle(self._server, "/workpiece", planar)

        async def dragged(event: Any) -> None:
            self.place(np.array(event.target.position, dtype=float), math.radians(self._yaw.value))

        def turned(event: Any) -> None:
            if event.client is not None and self._w is not None:
                self.place(self._w[:3], math.radians(self._yaw.value))

        self.handle.on_update(dragged)
        self._yaw.on_update(turned)
        back.on_click(lambda _: self.place_best())

    def place(self, xyz: Array, yaw: float) -> None:
        """Have the workpiece somewhere: its origin (3,) [m] and its turn about the vertical [rad], world."""
        self._w = np.array([*xyz, yaw])
        lengths = {axis: f"{1e3 * v:.1f} mm" for axis, v in zip("xyz", xyz, strict=True)}
        self._changed({"task__workpiece": {**lengths, "yaw": f"{math.degrees(yaw):.2f} deg"}})

    def place_best(self) -> None:
        """Have the workpiece where it is best, within its ranges."""
        self._changed({})

    def show(self, found: Solution, own_place: bool) -> Solution:
        """The stations of an answer; the one that is to be shown.

        Args:
            own_place: whether the workpiece is where the user put it.
        """
        if found is not self._found:
            self._found = found
            self._best = self._best if own_place else found
            self._which.max = max(len(found.points), 2)
            self._which.value = min(int(self._which.value), len(found.points))
            self._draw(found)
            if self.handle is not None and found.w is not None and not own_place:
                self._w = np.array(found.w)
                self.handle.position = tuple(found.w[:3])
                self._yaw.value = round(math.degrees(found.w[3]), 1)
        k = int(self._which.value) - 1
        self._words.content = self._said(found, k)
        return found.points[k]

    def end(self) -> None:
        """Play nothing more; the page can go."""
        self._playing.clear()
        if self._player is not None:
            self._player.join(2.0 * _MOST_STEP_S)

    def _draw(self, found: Solution) -> None:
        """A mark at every station, coloured by its standard deviation; the line of a path."""
        places = np.array([point.spread.position for point in found.points])
        low, high = float(found.sigmas.min()), float(found.sigmas.max())
        colours = mapped_colours(found.sigmas, low, high if high > low else 2.0 * high).astype(np.uint8)
        size = _POINT_SHARE * self._extent * min(1.0, 12.0 / len(places) + 0.25)
        self._server.scene.add_point_cloud(
            "/stations/marks", places, colours, point_size=size, point_shape="circle", precision="float32"
        )
        if found.followed is not None:
            add_lines(self._server, "/stations/line", np.stack([places[:-1], places[1:]], axis=1), GREY, 2.0)

    def _said(self, found: Solution, k: int) -> str:
        sigma, high = float(found.sigmas[k]), float(found.sigmas.max())
        words = f"{found.names[k]}: standard deviation {stated(sigma, 'm')}; the worst is {found.worst_station} with "
        words += f"{stated(high, 'm')} (bright)."
        if self._best is not None and self._best is not found:
            words += f" {found.sigma / self._best.sigma:.3g} times that of the best placement."
        return f'<p style="margin:4px 14px;font-size:13px">{escape(words)}</p>'

    def _start_or_stop(self) -> None:
        if self._playing.is_set():
            self._playing.clear()
        elif self._found is not None:
            self._playing.set()
            self._player = threading.Thread(target=self._run, args=(self._found,), daemon=True)
            self._player.start()

    def _run(self, found: Solution) -> None:
        """Shows one station after the other, in the rhythm of the path's time law where it has one."""
        self._play.label = "Stop"
        count = len(found.points)
        law = found.times if found.times is not None and len(found.times) == count else None
        steps = np.diff(law) if law is not None else np.full(count - 1, _PLAYED_S / max(count - 1, 1))
        for k, pause in enumerate([*steps, 0.0]):
            if not self._playing.is_set() or self._found is not found:
                break
            self._which.value = k + 1
            self._redraw()
            threading.Event().wait(float(np.clip(pause, _LEAST_STEP_S, _MOST_STEP_S)))
        self._playing.clear()
        self._play.label = "Play"
