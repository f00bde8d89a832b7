"""``LiveMap``: the spread over the bench as colours on it, computed while the page goes on."""

from __future__ import annotations

import threading
from collections.abc import Callable
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

from posture_opt.errors import PostureOptError
from posture_opt.explore.drawing import rgb, wxyz
from posture_opt.explore.heat import Heat, heat_of, passes_of
from posture_opt.explore.other_process import OtherProcess
from posture_opt.numerics import Array
from posture_opt.problem.problem import Problem
from posture_opt.report.page.colours import VERMILLION, mapped_colours
from posture_opt.statements.notation import sentence, stated

if TYPE_CHECKING:
    import viser

_PIXELS = 16  # along the side of a cell
_OPACITY = 215  # of 255
_LIFT_M = 2e-3  # over the plane of the targets: what lies in it does not shine through
_HIGH_QUANTILE = 0.95  # places beyond it do not widen the scale of colours
_BALL_SHARE = 0.012  # of the map's side: the best place
_STOP, _AWAY = "Stop the map", "Take the map away"


class LiveMap:
    """The map, its button and its progress.

    Args:
        server: of the page; the controls are put where its panel is at the moment.
        asked: what is asked at the moment.
        moved: called with the place (3,) [m] that the target is to be at.
    """

    def __init__(self, server: viser.ViserServer, asked: Callable[[], Problem], moved: Callable[[Array], None]) -> None:
        self._server, self._asked = server, asked
        self._heat: Heat | None = None
        self._process = OtherProcess()
        self._running, self._wanted = threading.Lock(), threading.Event()
        gui = server.gui
        self._button = gui.add_button("Map of the bench", hint="the spread over the targets around this one")
        self._bar: Any = gui.add_progress_bar(0.0, visible=False)
        self._words = gui.add_html("")
        self._there = gui.add_button("Put the target at the red ball", visible=False)
        self._off: Any = gui.add_button(_AWAY, visible=False)
        self._button.on_click(lambda _: self.start())
        self._there.on_click(lambda _: moved(self._heat.best) if self._heat is not None else None)
        self._off.on_click(lambda _: self._stop() if self._off.label == _STOP else self.clear())

    def start(self) -> None:
        """Compute the map of what is asked now; one that is under way is ended."""
        self._wanted.clear()
        self._process.stop_if_busy()
        threading.Thread(target=self._run, args=(self._asked(),), daemon=True).start()

    def clear(self) -> None:
        """No map."""
        self._stop()
        self._server.scene.remove_by_name("/map")
        self._heat, self._words.content = None, ""
        self._there.visible = self._off.visible = self._bar.visible = False

    def _stop(self) -> None:
        """Compute no finer map than the one that is shown."""
        self._wanted.clear()
        self._process.stop_if_busy()

    def end(self) -> None:
        """Compute nothing more."""
        self._wanted.clear()
        self._process.stop()

    def _run(self, problem: Problem) -> None:
        with self._running:
            self.clear()
            self._wanted.set()
            self._bar.animated, self._bar.visible, self._off.visible, self._off.label = True, True, True, _STOP
            for count in passes_of(problem):
                self._bar.value = 0.0
                found = self._process.call(heat_of, problem, count, progress=self._progress)
                if isinstance(found, PostureOptError):
                    self._words.content = _line(sentence(str(found)))
                elif found is not None:
                    self._show(found)
                if not self._wanted.is_set():
                    break
            self._bar.visible, self._off.label = False, _AWAY
            self._off.visible = self._heat is not None

    def _progress(self, done: int, most: int) -> None:
        self._bar.value = 100.0 * min(done / max(most, 1), 1.0)

    def _show(self, heat: Heat) -> None:
        self._heat = heat
        low, high = float(np.nanmin(heat.sigma)), float(np.nanquantile(heat.sigma, _HIGH_QUANTILE))
        width, height = heat.size
        R = np.column_stack([heat.axes[0], -heat.axes[1], np.cross(heat.axes[0], -heat.axes[1])])  # rows run down
        self._server.scene.add_image(
            "/map/heat", picture(heat.sigma, low, high), width, height, format="png", cast_shadow=False,
            receive_shadow=False, wxyz=wxyz(R), position=tuple(heat.middle + np.array([0.0, 0.0, _LIFT_M])),
        )  # fmt: skip
        best = self._server.scene.add_icosphere("/map/best", _BALL_SHARE * max(width, height), rgb(VERMILLION))
        best.position = tuple(heat.best)
        x, y, z = 1e3 * heat.best
        rows, columns = heat.sigma.shape
        self._words.content = _line(
            f"Standard deviation at {columns} by {rows} places from {stated(low, 'm')} (dark) "
            f"to {stated(high, 'm')} (bright); the least, at the red ball, with the {heat.what} at "
            f"({x:.1f}, {y:.1f}, {z:.1f}) mm."
            + (" Places in white: no posture does the task." if np.isnan(heat.sigma).any() else "")
        )
        self._there.visible = heat.what == "target"


def picture(sigma: Array, low: float, high: float) -> Array:
    """The colours (p, q, 4) of a map (v, u), each cell as many pixels, the last row at the top; NaN is seen through."""
    there = np.isfinite(sigma)
    colours = mapped_colours(np.where(there, sigma, low), low, high)
    pixels = np.concatenate([colours, np.where(there, _OPACITY, 0)[..., None]], axis=-1).astype(np.uint8)[::-1]
    return np.asarray(np.repeat(np.repeat(pixels, _PIXELS, axis=0), _PIXELS, axis=1))


def _line(words: str) -> str:
    return f'<p style="margin:4px 14px;font-size:13px" role="status">{escape(words)}</p>'
