"""``postures_together``: the postures in which all features of a workpiece that stands still succeed most likely."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from posture_opt.numerics import Array
from posture_opt.selection.answer.placement import PlacementRange
from posture_opt.selection.answer.solution import Solution
from posture_opt.selection.search.search_outcome import is_clear
from posture_opt.selection.stations.placed_stations import PlacedStations
from posture_opt.selection.stations.stations_problem import StationsPoint
from posture_opt.uncertainty.spread.success_of_all import PlaceErrors, success_of_all

_MOST_SEEN = 12  # postures of a search for one feature that are tried beside its optima
_DRAWS = 8192  # of the errors that stay: combinations that differ by less are as good


def postures_together(
    stations: PlacedStations, w: Array, solved: Sequence[Solution], known: Array | None = None
) -> Sequence[Solution]:
    """The answers for each feature with the postures that are best for all; as they are where features share no errors.

    Of the optima of each feature and of other postures that do it, the best combination; where the arm has freedom
    left, all of them improved together; of both, and of the optima, what is most likely to succeed.

    Args:
        w: (4,) the placement [m, rad].
        solved: the answer at each of the K features alone.
        known: (K, n) postures of a joint answer.
    """
    if stations.shared is None:
        return solved
    precise, still = replace(stations, draws=_DRAWS), replace(stations, placement=PlacementRange(w, w))
    given = [_postures(s, None if known is None else known[k]) for k, s in enumerate(solved)]
    found = precise.among(w, given)
    options = [np.array([s.q for s in solved]), *([] if known is None or not np.isfinite(known).all() else [known])]
    options += [found.Q[0]] if np.isfinite(found.loss[0]) else []
    if any(engine.optimisation_problem.freedom for engine in stations.engines):
        end = still.joint.solve(StationsPoint(w, options[-1]))
        improved = precise.among(w, list(end.point.Q[:, None]))
        options += [improved.Q[0]] if np.isfinite(improved.loss[0]) else []
    scene = solved[0].problem.scene
    clear = [Q for Q in options if is_clear(scene, Q).all()] or options[:1]
    answers = [_with_postures(solved, _tidied(stations, w, Q)) for Q in clear]
    return max(answers, key=_success)


def _tidied(stations: PlacedStations, w: Array, Q: Array) -> Array:
    """(K, n) the same postures, joints that do not matter at zero and whole turns taken off."""
    each = zip(stations.engines, stations.at(w), Q, strict=True)
    return np.array([engine.tidied(engine.candidates(q[None], target), target)[0].q for engine, target, q in each])


def _postures(solved: Solution, known: Array | None) -> Array:
    """(B, n) what one feature may do: its optima, some of the postures that were seen, and one that is known."""
    seen = solved.feasible[:: max(len(solved.feasible) // _MOST_SEEN, 1)]
    rows = [solved.ranked, seen] if len(seen) else [solved.ranked]
    Q = np.vstack([solved.q[None], *rows, *([] if known is None else [known[None]])])
    return np.asarray(Q[is_clear(solved.problem.scene, Q)])


def _with_postures(solved: Sequence[Solution], Q: Array) -> list[Solution]:
    """The same answers with the postures Q (K, n), which come first among the alternatives."""
    return [
        one if np.array_equal(one.q, q) else replace(one, q=q, ended=np.vstack([q, _others(one.ended, q)]))
        for one, q in zip(solved, Q, strict=True)
    ]


def _others(ended: Array, q: Array) -> Array:
    """The optima without the one that q (n,) is."""
    return np.asarray(ended[np.abs(ended - q).max(axis=1) > 1e-6])


def _success(solved: Sequence[Solution]) -> float:
    """The probability that all succeed."""
    return success_of_all([PlaceErrors.of(s.spread, s.basis, s.target.clearance) for s in solved]).probability
