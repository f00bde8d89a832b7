"""What the postures of a compensation have to keep besides their poses: clearances, and the terms of the task."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from posture_opt.compensation.task_postures import selector_of, target_task
from posture_opt.numerics import Array, Codes, Mask
from posture_opt.selection.problem_data import ProblemData
from posture_opt.selection.program.nlp import Nlp, Row
from posture_opt.selection.search.inverse_kinematics import ROW_TOLERANCE
from posture_opt.selection.search.search_outcome import DISTANCE_ROUNDING
from posture_opt.units import number

_SMALL_CHANGE_RAD = math.radians(5.0)  # rad or m: a joint that compensation moves by more is in another posture
_MAX_OVERLAP_M = 1e-3  # that compensation may make of a contact


@dataclass(frozen=True)
class Requirements:
    """What the cell and the task of a problem require of a posture.

    A compensated posture differs by some milliradians from the one that was planned, or given. What that one kept, the
    compensated one may miss by what these are worth, as planned arms lean on their requirements; more is refused.
    """

    problem: ProblemData

    def broken(self, q: Array, kept: Array, rows: Codes) -> dict[int, str]:
        """Row -> the requirement that its posture breaks, in words.

        Args:
            q: (N, n) compensated postures; kept: (N, n) those that were planned or given [rad or m].
            rows: (k,) which of them are judged.
        """
        if not len(rows):
            return {}
        moved = np.abs(q - kept)[rows].max(axis=1) > _SMALL_CHANGE_RAD
        found = {**self._terms(q[rows], kept[rows], moved), **self._collisions(q[rows], kept[rows], moved)}
        return {int(rows[k]): reason for k, reason in found.items()}

    def _collisions(self, q: Array, kept: Array, moved: Mask) -> dict[int, str]:
        """Postures that come too near to something, each with what is nearest."""
        scene = self.problem.scene
        if not scene.active:
            return {}
        required = np.array(scene.required)
        least = required - DISTANCE_ROUNDING
        now, before = scene.distances(q), scene.distances(kept)
        bad = (now < least) & ((before < least) | moved[:, None] | (now < -_MAX_OVERLAP_M))
        reasons = {}
        for k in np.flatnonzero(bad.any(axis=1)):
            pair = int(np.argmin(np.where(bad[k], now[k] - required, np.inf)))
            reasons[int(k)] = _collision_words(float(now[k, pair]), scene.pairs[pair], float(required[pair]))
        return reasons

    def _terms(self, q: Array, kept: Array, moved: Mask) -> dict[int, str]:
        """Postures that break a term of ``subject_to``, each with the one that it breaks most."""
        task = self.problem.task
        if task is None or not any(not term.held(self.problem.robot) for term in task.subject_to):
            return {}
        asked = target_task(self.problem, kept[0], np.zeros(3), spun=False, free=True)
        selector = selector_of(self.problem, asked)
        nlp = selector.engine(selector.target, guarded=False).optimisation_problem.nlp
        p = selector.target.parameters
        now, before = (_lacking(nlp, postures, p) for postures in (q, kept))
        bad = (now > ROW_TOLERANCE) & ((before > ROW_TOLERANCE) | moved[:, None])
        reasons = {}
        for k in np.flatnonzero(bad.any(axis=1)):
            row = int(np.argmax(np.where(bad[k], now[k], 0.0)))
            value, bounds = nlp.row_values(q[k], p)[0, row], [bound[row] for bound in nlp.row_bounds(p)]
            reasons[int(k)] = _term_words(nlp.rows[row], float(value), *map(float, bounds))
        return reasons


def _lacking(nlp: Nlp, q: Array, p: Array) -> Array:
    """(N, m) by how much postures (N, n) break each row; rows of the target count for nothing."""
    low, high = nlp.row_bounds(p)
    values = nlp.row_values(q, p)
    counted = np.array([bool(row.term) for row in nlp.rows])
    return np.asarray(np.where(counted, np.maximum(np.maximum(low - values, values - high), 0.0), 0.0))


def _collision_words(distance: float, between: tuple[str, str], margin: float) -> str:
    """What comes too near to what."""
    a, b = between
    if distance <= 0:
        return f"{a} and {b} overlap"
    return f"{a} comes within {number(1e3 * distance, 3)} mm of {b}, and {number(1e3 * margin, 3)} mm are required"


def _term_words(row: Row, value: float, low: float, high: float) -> str:
    """Which term is broken, with the value and the bound that it is beyond."""
    bound, word = (low, "at least") if value < low else (high, "at most")
    factor, unit = {"m": (1e3, " mm"), "rad": (180 / math.pi, " deg"), "1": (1.0, "")}.get(
        row.unit, (1.0, f" {row.unit}")
    )
    is_, asked = (f"{number(factor * row.shown(v), 4)}{unit}" for v in (value, bound))
    return f"{row.name} is {is_}, and {word} {asked} is required"
