"""``LiveMap``: the spread over the bench as colours on it, computed while the page goes on."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from posture_opt.errors import InputError, Issue, PostureOptError
from posture_opt.explore.drawing import line, rgb, wxyz
from posture_opt.explore.other_process import OtherProcess
from posture_opt.numerics import Array, Progress
from posture_opt.problem.problem import Problem
from posture_opt.report.page.colours import VERMILLION, mapped_colours
from posture_opt.selection.maps.target_map import map_targets
from posture_opt.selection.select_posture import select_posture
from posture_opt.statements.notation import sentence, stated

if TYPE_CHECKING:
    import viser

_STOP, _AWAY = "Stop the map", "Take the map away"


@dataclass(frozen=True)
class Heat:
    """A standard deviation over a rectangle ``origin + u e1 + v e2``.

    Args:
        origin: (3,) [m], world; ``axes`` (2, 3) unit vectors e1 and e2.
        values: of u and of v [m], evenly spaced.
        sigma: (v, u) [m]; NaN where nothing is feasible.
    """

    origin: Array
    axes: Array
    values: tuple[Array, Array]
    sigma: Array
    what: str

    @property
    def middle(self) -> Array:
        """(3,) [m], world."""
        u, v = ((grid[0] + grid[-1]) / 2 for grid in self.values)
        return np.asarray(self.origin + u * self.axes[0] + v * self.axes[1])

    @property
    def size(self) -> tuple[float, float]:
        """Along u and v [m], half a step beyond the outermost places."""
        u, v = (float((grid[-1] - grid[0]) * len(grid) / max(len(grid) - 1, 1)) for grid in self.values)
        return u, v

    @property
    def best(self) -> Array:
        """(3,) where the standard deviation is least [m], world."""
        row, column = np.unravel_index(int(np.nanargmin(self.sigma)), self.sigma.shape)
        return np.asarray(self.origin + self.values[0][column] * self.axes[0] + self.values[1][row] * self.axes[1])


def passes_of(problem: Problem) -> tuple[int, ...]:
    """How many targets along each side maps have that follow each other, a first look before the whole one."""
    return (11,) if _has_features(problem) else (5, 11)


def heat_of(problem: Problem, count: int, progress: Progress) -> Heat:
    """The spread over the targets about the one of a task; of features over the placements of their workpiece.

    Args:
        progress: called with (done, total) steps.
    """
    if _has_features(problem):
        return _heat_of_placements(problem)
    found = map_targets(problem, counts=(count, count), progress=progress)
    u, v, w = found.grid.values
    origin = found.grid.origin + w[0] * found.grid.axes[2]
    return Heat(origin, found.grid.axes[:2], (u, v), found.sigma.reshape(len(w), len(v), len(u))[0], "target")


def _has_features(problem: Problem) -> bool:
    return problem.task is not None and bool(problem.task.features)


def _heat_of_placements(problem: Problem) -> Heat:
    found = select_posture(problem)
    bench = None if found.placement is None else getattr(found.placement, "bench", lambda _: None)(found.postures)
    if bench is None or max(bench.axes) > 1:
        hint = "give x and y of the workpiece as ranges, [least, most]"
        raise InputError(Issue("the workpiece is not free along x and y: there is no bench to map", hint=hint))
    origin = np.array([0.0, 0.0, found.w[2]])
    return Heat(origin, np.eye(3)[list(bench.axes)], bench.values, bench.sigma.T, "workpiece")


class LiveMap:
    """The map, its button and its progress.

    Args:
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
        self._wanted.clear()
        self._process.stop_if_busy()

    def end(self) -> None:
        """Compute nothing more."""
        self._wanted.clear()
        self._process.end()

    def _run(self, problem: Problem) -> None:
        def progress(done: int, most: int) -> None:
            self._bar.value = 100.0 * min(done / max(most, 1), 1.0)

        with self._running:
            self.clear()
            self._wanted.set()
            self._bar.animated, self._bar.visible, self._off.visible, self._off.label = True, True, True, _STOP
            for count in passes_of(problem):
                self._bar.value = 0.0
                found = self._process.call(heat_of, problem, count, progress=progress)
                if isinstance(found, PostureOptError):
                    self._words.content = line(sentence(str(found)))
                elif found is not None:
                    self._show(found)
                if not self._wanted.is_set():
                    break
            self._bar.visible, self._off.label = False, _AWAY
            self._off.visible = self._heat is not None

    def _show(self, heat: Heat) -> None:
        self._heat = heat
        low, high = float(np.nanmin(heat.sigma)), float(np.nanquantile(heat.sigma, 0.95))  # single peaks do not count
        width, height = heat.size
        R = np.column_stack([heat.axes[0], -heat.axes[1], np.cross(heat.axes[0], -heat.axes[1])])  # rows run down
        lifted = heat.middle + np.array([0.0, 0.0, 2e-3])  # what lies in the plane does not shine through
        self._server.scene.add_image(
            "/map/heat", picture(heat.sigma, low, high), width, height, format="png", cast_shadow=False,
            receive_shadow=False, wxyz=wxyz(R), position=tuple(lifted),
        )  # fmt: skip
        best = self._server.scene.add_icosphere("/map/best", 0.012 * max(width, height), rgb(VERMILLION))
        best.position = tuple(heat.best)
        x, y, z = 1e3 * heat.best
        rows, columns = heat.sigma.shape
        self._words.content = line(
            f"Standard deviation at {columns} by {rows} places from {stated(low, 'm')} (dark) "
            f"to {stated(high, 'm')} (bright); the least, at the red ball, with the {heat.what} at "
            f"({x:.1f}, {y:.1f}, {z:.1f}) mm."
            + " Places in white: no posture does the task."
            * bool(np.isnan(heat.sigma).any())
        )
        self._there.visible = heat.what == "target"


def picture(sigma: Array, low: float, high: float) -> Array:
    """The colours (p, q, 4) of a map (v, u), a cell 16 by 16 pixels, the last row at the top; NaN is seen through."""
    there = np.isfinite(sigma)
    colours = mapped_colours(np.where(there, sigma, low), low, high)
    pixels = np.concatenate([colours, np.where(there, 215, 0)[..., None]], axis=-1).astype(np.uint8)[::-1]
    return np.asarray(np.repeat(np.repeat(pixels, 16, axis=0), 16, axis=1))
