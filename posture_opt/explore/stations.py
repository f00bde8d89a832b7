"""``Stations``: features or points of a path on the page: chosen, played back, and their workpiece dragged."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from posture_opt.explore.drawing import add_handle, add_lines, add_points, line, on_user
from posture_opt.numerics import Array
from posture_opt.problem.problem import Problem
from posture_opt.problem.yaml_source import Plain
from posture_opt.report.page.colours import GREY, mapped_colours
from posture_opt.report.scene.arm_geometry import ArmGeometry
from posture_opt.statements.notation import stated

if TYPE_CHECKING:
    import viser

    from posture_opt.selection.answer.solution import Solution

_LONGEST_STEP_S = 0.6  # between two stations that are played


class Stations:
    """The stations of an answer on the page, with their controls."""

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
        on_user(self._which, lambda: self._redraw())
        self._play.on_click(lambda _: self._start_or_stop())
        self.handle: Any = None
        if problem.task is not None and problem.task.workpiece is not None:
            self._add_workpiece(gui, geometry.planar)

    def _add_workpiece(self, gui: viser.GuiApi, planar: bool) -> None:
        self._yaw: Any = gui.add_slider("Yaw of the workpiece [deg]", -180.0, 180.0, 0.1, 0.0)
        back = gui.add_button("Best placement of the workpiece")
        self.handle = add_handle(self._server, "/workpiece", planar)

        async def dragged(event: Any) -> None:
            self.place(np.array(event.target.position, dtype=float), math.radians(self._yaw.value))

        def turned() -> None:
            if self._w is not None:
                self.place(self._w[:3], math.radians(self._yaw.value))

        self.handle.on_update(dragged)
        on_user(self._yaw, turned)
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
        """The stations of an answer; the one that is to be shown."""
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
        sigma, high = float(found.sigmas[k]), float(found.sigmas.max())
        words = f"{found.names[k]}: standard deviation {stated(sigma, 'm')}; the worst is {found.worst_station} with "
        words += f"{stated(high, 'm')} (bright)."
        if self._best is not None and self._best is not found:
            words += f" {found.sigma / self._best.sigma:.3g} times that of the best placement."
        self._words.content = line(words)
        return found.points[k]

    def end(self) -> None:
        """Play nothing more; the page can go."""
        self._playing.clear()
        if self._player is not None:
            self._player.join(2.0 * _LONGEST_STEP_S)

    def _draw(self, found: Solution) -> None:
        places = np.array([point.spread.position for point in found.points])
        low, high = float(found.sigmas.min()), float(found.sigmas.max())
        colours = mapped_colours(found.sigmas, low, high if high > low else 2.0 * high).astype(np.uint8)
        size = 0.02 * self._extent * min(1.0, 12.0 / len(places) + 0.25)
        add_points(self._server, "/stations/marks", places, colours, size)
        if found.followed is not None:
            add_lines(self._server, "/stations/line", np.stack([places[:-1], places[1:]], axis=1), GREY, 2.0)

    def _start_or_stop(self) -> None:
        if self._playing.is_set():
            self._playing.clear()
        elif self._found is not None:
            self._playing.set()
            self._player = threading.Thread(target=self._run, args=(self._found,), daemon=True)
            self._player.start()

    def _run(self, found: Solution) -> None:
        """Show one station after the other, in the rhythm of the path's time law where it has one, else in 6 s."""
        self._play.label = "Stop"
        count = len(found.points)
        law = found.times if found.times is not None and len(found.times) == count else None
        steps = np.diff(law) if law is not None else np.full(count - 1, 6.0 / max(count - 1, 1))
        for k, pause in enumerate([*steps, 0.0]):
            if not self._playing.is_set() or self._found is not found:
                break
            self._which.value = k + 1
            self._redraw()
            threading.Event().wait(float(np.clip(pause, 0.04, _LONGEST_STEP_S)))
        self._playing.clear()
        self._play.label = "Play"
