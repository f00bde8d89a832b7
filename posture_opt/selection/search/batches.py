"""How long to search: until the best optimum has been found again, and again."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from posture_opt.numerics import Progress
from posture_opt.selection.program.task_target import TaskTarget
from posture_opt.selection.search.engine import Engine
from posture_opt.selection.search.multistart import MultistartResult, as_good, multistart
from posture_opt.workers import opened

_STARTS = 32  # of a batch where two degrees of freedom are left or fewer, and so many more for each further one
_MOST_STARTS = 128
_BATCHES = 2  # that are to find the best optimum
_MOST = 12  # batches
_HITS = 4  # local searches that are to find it, in a repeated solve
_UNSEEN = 0.01  # probability that one more start leads to something better
_PASSES = 6
_STILL_BETTER = 0.2  # better optima that as many starts again may be expected to find, in a thorough search


def usual_starts(engine: Engine) -> int:
    """Starts of one batch: more where target and tool axis leave more freedom, and so more local optima."""
    return min(_STARTS * max(engine.optimisation_problem.freedom - 1, 1), _MOST_STARTS)


def until_found_often(
    engine: Engine, target: TaskTarget, rng: np.random.Generator, starts: int | None = None
) -> MultistartResult:
    """Starts until some local searches have found the best optimum; all of them at once where ``starts`` is given."""
    whole = multistart(engine, target, rng, starts or usual_starts(engine))
    for _ in range(1, 1 if starts else _PASSES):
        if not any(c.feasible for c in whole.found) or (whole.hits >= _HITS and whole.unseen_better <= _UNSEEN):
            break
        whole = whole.joined(multistart(engine, whole.target, rng, usual_starts(engine)), engine)
    return whole


def until_recurrence(
    engine: Engine,
    target: TaskTarget,
    seed: int,
    starts: int | None = None,
    workers: int = 1,
    progress: Progress | None = None,
) -> MultistartResult:
    """Batches of starts, seeded by their number, until the best optimum has been found by two of them.

    By six, where so many optima were seen only once that better ones are likely.

    Args:
        starts: of each batch; default: by the freedom that is left.
        workers: processes that share the batches; the answer does not depend on it.
        progress: called with (done, total) batches.
    """
    starts = starts or usual_starts(engine)
    whole = multistart(engine, target, np.random.default_rng([seed, 0]), starts, every=True)
    if not any(candidate.feasible for candidate in whole.found):
        return whole  # requirements that cannot be met are not met by more starts either
    values = [_best(whole)]
    for batch in _batches(engine, whole.target, seed, starts, workers):
        whole = whole.joined(batch, engine)
        values.append(_best(batch))
        if progress is not None:
            progress(len(values), _MOST)
        enough = _BATCHES if whole.unseen_better * whole.polished <= _STILL_BETTER else 3 * _BATCHES
        if _recurred(values) >= enough:
            break
    return replace(whole, batches=len(values), recurred=_recurred(values))


def _recurred(values: list[float]) -> int:
    limit = as_good(min(values))
    return sum(value <= limit for value in values) if np.isfinite(limit) else 0


def _best(found: MultistartResult) -> float:
    feasible = [candidate.objective for candidate in found.found if candidate.feasible]
    return min(feasible, default=float("inf"))


def _batches(engine: Engine, target: TaskTarget, seed: int, starts: int, workers: int) -> Iterator[MultistartResult]:
    with opened(workers) as pool:
        for first in range(1, _MOST, workers):
            mine = range(first, min(first + workers, _MOST))
            yield from pool.in_order(_batch, (engine, target, seed, starts), mine)


def _batch(shared: tuple[Engine, TaskTarget, int, int], k: int) -> MultistartResult:
    engine, target, seed, starts = shared
    return multistart(engine, target, np.random.default_rng([seed, k]), starts, every=True)
