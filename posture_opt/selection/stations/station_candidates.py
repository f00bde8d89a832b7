"""``StationCandidates``: postures of one station at many placements, improved each on its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from posture_opt.numerics import Array, Codes
from posture_opt.selection.program.task_target import TaskTarget
from posture_opt.selection.search.engine import STEPS, Engine
from posture_opt.selection.search.inverse_kinematics import PARTS, ROW_TOLERANCE, TOLERANCE, PoseRequest
from posture_opt.selection.search.inverse_kinematics import STEPS as IK_STEPS


@dataclass(frozen=True)
class StationCandidates:
    """R postures of one station at M placements."""

    of: Codes  # (R,) placement of each
    Q: Array  # (R, n) postures
    main: Array  # (R,) first term of the objective
    extra: Array  # (R,) further terms
    sigma: Array  # (R,) largest standard deviation of the part that counts [m]
    excess: Array  # (R,) violation of the rows, zero where they are met
    gap: Array  # (M,) least error of the inverse kinematics, and how far the target is off the plane of the arm

    def at(self, m: int) -> Codes:
        """Feasible ones at placement m."""
        return np.flatnonzero((self.of == m) & (self.excess == 0))

    def best(self) -> tuple[Array, Array, Array, Array, Array]:
        """Best at each placement: posture (M, n); first term, further terms, σ, gap (M,) each."""
        M, n = len(self.gap), self.Q.shape[1]
        main, extra, sigma, best = np.full(M, np.inf), np.zeros(M), np.full(M, np.inf), np.full((M, n), np.nan)
        gap = self.gap.copy()
        for r in np.lexsort((self.main + self.extra, self.excess))[::-1]:  # the best one is written last
            m, met = self.of[r], self.excess[r] == 0
            gap[m], best[m] = (0.0 if met else self.excess[r]), self.Q[r]
            main[m], extra[m] = (self.main[r], self.extra[r]) if met else (np.inf, 0.0)
            sigma[m] = self.sigma[r]
        return best, main, extra, sigma, gap


def station_candidates(
    engine: Engine, targets: Sequence[TaskTarget], starts: int, known: Array, rng: np.random.Generator,
    branches: int = 0,
) -> StationCandidates:  # fmt: skip
    """Postures at M targets, random starts and ``known`` (J, n); ``branches`` distinct ones of each, 0: best."""
    count, M = starts + len(known), len(targets)
    drawn = engine.ik.random_postures(starts * M, rng).reshape(M, starts, engine.robot.n)
    begun = np.concatenate([drawn, np.broadcast_to(known, (M, *known.shape))], axis=1)
    Q, error = engine.ik.solve(begun.reshape(M * count, -1), _requests(engine, targets, count, rng), steps=IK_STEPS)
    of = np.repeat(np.arange(M), count)
    off = _off_plane(engine, targets)
    gap = np.maximum(error.reshape(M, count).min(axis=1), off)
    arrived = (error < TOLERANCE) & (off[of] == 0)
    several = _distinct(engine, Q, of, arrived) if branches else arrived
    rows = _promising(engine, targets, Q, of, several, branches or max(2, count // 8))
    ends, placements = np.zeros((0, engine.robot.n)), of[rows]
    if len(rows):
        steps = STEPS if M == 1 else 20  # more are taken by searches that end nowhere
        ends = engine.descended_each(Q[rows], targets, placements, steps).q
    if branches and len(known):
        # What the errors that stay make of a posture is not in its own optimum.
        kept = np.flatnonzero(arrived & np.tile(np.arange(count) >= starts, M))
        ends, placements = np.vstack([ends, Q[kept]]), np.concatenate([placements, of[kept]])
    return given_candidates(engine, targets, ends, placements, gap)


def given_candidates(
    engine: Engine, targets: Sequence[TaskTarget], Q: Array, of: Codes, gap: Array
) -> StationCandidates:
    """Postures Q (R, n) as they are, each at its target ``of`` (R,)."""
    objective, main, violation, sigma = _values(engine, targets, Q, of).T
    excess = np.where(violation <= ROW_TOLERANCE, 0.0, violation)
    return StationCandidates(of, Q, main, objective - main, sigma, excess, gap)


def _requests(engine: Engine, targets: Sequence[TaskTarget], count: int, rng: np.random.Generator) -> PoseRequest:
    rows = np.vstack([np.broadcast_to(engine.request(t, count, rng).rows, (count, PARTS[-1])) for t in targets])
    weights = engine.request(targets[0], 1, rng).weights
    position, axis, spin, _, slack, cone = np.split(rows, PARTS[1:-1], axis=1)
    return PoseRequest(position, axis, spin, weights, slack, cone)


def _off_plane(engine: Engine, targets: Sequence[TaskTarget]) -> Array:
    """(M,) distance [m] of targets from the plane, or line, that the tool point cannot leave; mostly zero."""
    reach = engine.optimisation_problem.reach
    if not reach.normals.shape[1]:
        return np.zeros(len(targets))
    shifts = [reach.outside(t.lower, t.upper) if reach.misses(t.lower, t.upper) else np.zeros(3) for t in targets]
    return np.asarray(np.linalg.norm(shifts, axis=1))


def _distinct(engine: Engine, Q: Array, of: Codes, arrived: Array) -> Array:
    """(N,) the arrived postures that differ from each other at their placement."""
    kept = np.zeros(len(Q), dtype=bool)
    rows = np.flatnonzero(arrived)
    for own in np.split(rows, np.flatnonzero(np.diff(of[rows])) + 1) if len(rows) else ():
        kept[own[engine.clusters(Q[own])[0]]] = True
    return kept


def _promising(engine: Engine, targets: Sequence[TaskTarget], Q: Array, of: Codes, arrived: Array, most: int) -> Codes:
    rows = np.flatnonzero(arrived)
    if not len(rows):
        return rows
    objective, violation = _values(engine, targets, Q[rows], of[rows])[:, [0, 2]].T
    excess = np.where(violation <= ROW_TOLERANCE, 0.0, violation)
    order = np.lexsort((objective, excess, of[rows]))
    sorted_of = of[rows][order]
    rank = np.arange(len(order)) - np.searchsorted(sorted_of, sorted_of)
    return np.asarray(rows[order[rank < most]])


def _values(engine: Engine, targets: Sequence[TaskTarget], Q: Array, of: Codes) -> Array:
    """(N, 4) objective, first term, worst violation of a row, and σ [m], of each posture at its target."""
    if not len(Q):
        return np.zeros((0, 4))
    parameters = np.array([target.parameters for target in targets])[of]
    objective, violation, main, variance = (column[:, 0] for column in engine.screen(Q, parameters))
    return np.column_stack([objective, main, violation, np.sqrt(np.maximum(variance, 0.0))])
