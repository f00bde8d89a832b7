"""``Heat``: the spread over a plane of targets, or of placements of the workpiece, as the page lays it on the bench."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from posture_opt.errors import InputError, Issue
from posture_opt.numerics import Array, Progress
from posture_opt.problem.problem import Problem
from posture_opt.selection.maps.target_map import map_targets
from posture_opt.selection.select_posture import select_posture

_FIRST, _COUNT = 5, 11  # targets along each side: of a first look, and of the map


@dataclass(frozen=True)
class Heat:
    """A standard deviation over a rectangle ``origin + u e1 + v e2``.

    Args:
        origin: (3,) [m], world; ``axes`` (2, 3) unit vectors e1 and e2.
        values: of u and of v [m], evenly spaced.
        sigma: (v, u) [m]; NaN where nothing is feasible.
        what: that is at these places.
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
        return np.asarray(
            self.origin + self.values[0][column] * self.axes[0] + self.values[1][row] * self.axes[1], dtype=float
        )


def passes_of(problem: Problem) -> tuple[int, ...]:
    """How many targets along each side maps have that follow each other, a first look before the whole one."""
    return (_COUNT,) if _has_features(problem) else (_FIRST, _COUNT)


def heat_of(problem: Problem, count: int, progress: Progress) -> Heat:
    """The spread over the targets about the one of a task; of features over the placements of their workpiece.

    Args:
        problem: what is asked.
        count: targets along each side.
        progress: called with (done, total) steps.

    Raises:
        InputError: features whose workpiece is not free along two axes; what `map_targets` refuses.
        NoSolutionError: nothing is feasible anywhere.
    """
    if _has_features(problem):
        return _of_placements(problem)
    found = map_targets(problem, counts=(count, count), progress=progress)
    u, v, w = found.grid.values
    origin = found.grid.origin + w[0] * found.grid.axes[2]
    return Heat(origin, found.grid.axes[:2], (u, v), found.sigma.reshape(len(w), len(v), len(u))[0], "target")


def _has_features(problem: Problem) -> bool:
    return problem.task is not None and bool(problem.task.features)


def _of_placements(problem: Problem) -> Heat:
    found = select_posture(problem)
    bench = None if found.placement is None else getattr(found.placement, "bench", lambda _: None)(found.postures)
    if bench is None or max(bench.axes) > 1:
        hint = "give x and y of the workpiece as ranges, [least, most]"
        raise InputError(Issue("the workpiece is not free along x and y: there is no bench to map", hint=hint))
    origin = np.array([0.0, 0.0, found.w[2]])
    return Heat(origin, np.eye(3)[list(bench.axes)], bench.values, bench.sigma.T, "workpiece")
