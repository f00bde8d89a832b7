"""``GivingScene``: the rows of a cell in which obstacles become smaller or move, and the clearance gives.

Inside of a solid the distance has no slope that leads out of it, and nothing says how deep a link is. So what gives is
the solid: every face recedes by a slack, or all of it moves by one. Both are exact, and both are what can be done.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product

import casadi as ca
import numpy as np

from posture_opt.collision.obstacles import Obstacle
from posture_opt.collision.scene import SELF_CLEARANCE_ROW, Scene, row_name
from posture_opt.numerics import Array, Mask
from posture_opt.selection.program.optimisation_problem import OptimisationProblem

CLEARANCE = "clearance of the cell"
"""The requirement that everything keeps the clearance of the cell."""
LEAST_THICKNESS_M = 1e-3
"""What is left of an obstacle that is made smaller [m], half of its least thickness; where it must give more, it has to
go."""
_ENDLESS_M = 1e3
_SHIFTS_TRIED_M = np.geomspace(2e-3, 4.0, 50)


def place_of(obstacle: str) -> str:
    """The requirement that an obstacle stands where it does."""
    return f"place of {obstacle}"


@dataclass(frozen=True)
class CellRow:
    """A row of the cell: ``margin ≥ 0`` where it is met [m]."""

    name: str
    margin: ca.SX


@dataclass(frozen=True)
class GivingScene:
    """The rows of a problem's cell, with the slacks of its obstacles as symbols [m].

    Args:
        problem: with a scene.
        less: how far the faces of each obstacle recede (k,); ``shifts`` (3, k) how far each moves, world.
        clearance: what is taken off the clearance of the cell.
    """

    problem: OptimisationProblem
    less: ca.SX
    shifts: ca.SX
    clearance: ca.SX

    @classmethod
    def of(cls, problem: OptimisationProblem) -> GivingScene:
        """The slacks of a problem's cell; none where it has no scene."""
        k = 0 if problem.scene is None else len(problem.scene.obstacles)
        return cls(problem, ca.SX.sym("less", k), ca.SX.sym("shift", 3, k), ca.SX.sym("clearance"))

    @property
    def scene(self) -> Scene:
        """What the arm keeps clear of."""
        assert self.problem.scene is not None
        return self.problem.scene

    @cached_property
    def rows(self) -> tuple[CellRow, ...]:
        """What each row has to spare [m], with the slacks in it."""
        if self.problem.scene is None:
            return ()
        if not self.scene.obstacles:  # of the arm to itself: the rows are there already
            given = (row for row in self.problem.nlp.rows if row.requirement == SELF_CLEARANCE_ROW)
            return tuple(CellRow(row.name, row.expression - row.lower + self.clearance) for row in given)
        beyond = {
            row_name(o.name): ca.fmax(self.less[k] - self._most(o), 0) for k, o in enumerate(self.scene.obstacles)
        }
        giving = [
            obstacle.smaller(ca.fmin(self.less[k], self._most(obstacle))).moved(ca.vertsplit(self.shifts[:, k]))
            for k, obstacle in enumerate(self.scene.obstacles)
        ]
        return tuple(
            CellRow(row.name, row.expression - row.lower + self.clearance + beyond.get(row.name, 0))
            for row in self.problem.clearance_rows(giving)
        )

    @cached_property
    def obstacles(self) -> dict[str, int]:
        """Name of the row -> number of its obstacle, of all that have a row."""
        if self.problem.scene is None:
            return {}
        numbers = {row_name(obstacle.name): k for k, obstacle in enumerate(self.scene.obstacles)}
        return {row.name: numbers[row.name] for row in self.rows if row.name in numbers}

    @cached_property
    def movable(self) -> dict[str, int]:
        """`place_of` -> number of the obstacle, of those that a move takes elsewhere: a wall does not end."""
        found = {k: self.scene.obstacles[k] for k in self.obstacles.values()}
        return {place_of(o.name): k for k, o in found.items() if np.isfinite(o.half_thickness)}

    def start_shift(self, k: int, q: Array) -> Array:
        """(3,) a short move [m] that takes obstacle k out of the way of the posture q (n,); zeros where none does."""
        scene, obstacle, chosen = self.scene, self.scene.obstacles[k], list(self.scene.against[k])
        start, end = (ends[0, chosen] for ends in scene.placed.segments(q[None]))
        ways = np.array([way for way in product((-1.0, 0.0, 1.0), repeat=3) if way != (0.0, 0.0, 0.0)])
        shifts = (ways / np.linalg.norm(ways, axis=1, keepdims=True))[:, None] * _SHIFTS_TRIED_M[:, None]
        back = shifts[:, :, None]
        away = obstacle.distance(start - back, end - back) - scene.placed.radii[chosen]
        clear: Mask = np.all(away >= scene.margin, axis=2)
        first = np.where(clear.any(axis=1), clear.argmax(axis=1), len(_SHIFTS_TRIED_M))
        way = int(np.argmin(first))
        return np.asarray(shifts[way, first[way]]) if first[way] < len(_SHIFTS_TRIED_M) else np.zeros(3)

    def _most(self, obstacle: Obstacle) -> float:
        """By how much an obstacle can be made smaller [m]; of one without end any length."""
        return min(max(obstacle.half_thickness - LEAST_THICKNESS_M, 0.0), _ENDLESS_M)


def gives_enough(obstacles: Sequence[Obstacle], name: str, by: float) -> Obstacle | None:
    """The obstacle of that name made smaller by so much [m]; None where too little of it would be left."""
    obstacle = next(o for o in obstacles if o.name == name)
    return obstacle.smaller(by) if by <= obstacle.half_thickness - LEAST_THICKNESS_M else None
