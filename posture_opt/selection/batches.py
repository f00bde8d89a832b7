"""A thorough search: independent batches of starts, until the best optimum has been found by two of them."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace

import numpy as np

from posture_opt.numerics import Array, Progress
from posture_opt.selection.engine import Engine, Recipe
from posture_opt.selection.multistart import MultistartResult, Sampled, multistart, rank
from posture_opt.selection.task_target import TaskTarget

SAME_OPTIMUM = 1e-4
"""Of the objective: two optima no further apart count as one, as the rounding of the criteria."""
_ENOUGH = 2  # batches that found the best optimum
_MOST = 12


def until_recurrence(
    engine: Engine, target: TaskTarget, seed: int, starts: int, workers: int = 1, progress: Progress | None = None
) -> MultistartResult:
    """Batches of ``starts`` local searches each, seeded by their number, until the best optimum recurs.

    Args:
        workers: processes that share the batches; the answer does not depend on it.
        progress: called with (done, total) batches.
    """
    whole = multistart(engine, target, np.random.default_rng([seed, 0]), starts)
    if not whole.found:
        return whole
    values = [_best(whole)]
    for batch in _batches(engine, whole.target, seed, starts, workers):
        whole = _joined(whole, batch)
        values.append(_best(batch))
        if progress is not None:
            progress(len(values), _MOST)
        if _recurred(values) >= _ENOUGH:
            break
    return replace(whole, batches=len(values), recurred=_recurred(values))


def as_good(best: float) -> float:
    """The objective up to which an optimum counts as the best one."""
    return best + SAME_OPTIMUM * max(abs(best), 1e-9)


def _recurred(values: list[float]) -> int:
    limit = as_good(min(values))
    return sum(value <= limit for value in values) if np.isfinite(limit) else 0


def _best(found: MultistartResult) -> float:
    feasible = [candidate.objective for candidate in found.found if candidate.feasible]
    return min(feasible, default=float("inf"))


def _batches(engine: Engine, target: TaskTarget, seed: int, starts: int, workers: int) -> Iterator[MultistartResult]:
    if workers == 1:
        for k in range(1, _MOST):
            yield multistart(engine, target, np.random.default_rng([seed, k]), starts)
        return
    with ProcessPoolExecutor(workers) as pool:
        for first in range(1, _MOST, workers):
            mine = range(first, min(first + workers, _MOST))
            yield from pool.map(
                _batch_there, *zip(*((engine.recipe, target, seed, k, starts) for k in mine), strict=True)
            )


def _batch_there(recipe: Recipe, target: TaskTarget, seed: int, k: int, starts: int) -> MultistartResult:
    return multistart(Engine.build(recipe), target, np.random.default_rng([seed, k]), starts)


def _joined(a: MultistartResult, b: MultistartResult) -> MultistartResult:
    sampled = Sampled(
        a.sampled.robot, np.vstack([a.sampled.Q, b.sampled.Q]), _stacked(a.sampled.sigma, b.sampled.sigma)
    )
    found = tuple(sorted((*a.found, *b.found), key=rank))
    return MultistartResult(a.target, found, sampled, a.arrived + b.arrived, a.tried + b.tried, a.polished + b.polished)


def _stacked(a: Array, b: Array) -> Array:
    return np.concatenate([a, b])
