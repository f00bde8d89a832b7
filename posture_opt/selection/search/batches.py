"""How long to search: until the best optimum has been found again, and again.

Agreement of independent batches is the stopping rule of an answer, agreement of local searches that of a repeated
solve (a cell of a map, a station of a path).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np

from posture_opt.numerics import Progress
from posture_opt.selection.program.task_target import TaskTarget
from posture_opt.selection.search.engine import Engine
from posture_opt.selection.search.multistart import MultistartResult, as_good, multistart, rank
from posture_opt.workers import Part, opened

S = TypeVar("S")
R = TypeVar("R")

STARTS_PER_BATCH = 32  # where two degrees of freedom are left or fewer; as many more for each further one
MAX_STARTS_PER_BATCH = 128
BATCHES_THAT_AGREE = 2  # that are to find the best optimum
MAX_BATCHES = 12  # batches
SEARCHES_IN_ALL = 6  # local searches of all batches that are to find it: one as easy to find is missed once in e⁶ = 400
SEARCHES_THAT_AGREE = 4  # local searches that are to find it, in a repeated solve
UNSEEN_PROBABILITY = 0.01  # probability that one more start leads to something better
MAX_PASSES = 6
EXPECTED_BETTER_OPTIMA = 0.05  # better optima that as many starts again may be expected to find, in a thorough search


def usual_starts(engine: Engine) -> int:
    """Starts of one batch: more where target and tool axis leave more freedom, and so more local optima."""
    return min(STARTS_PER_BATCH * max(engine.searched.freedom - 1, 1), MAX_STARTS_PER_BATCH)


def until_found_often(
    engine: Engine, target: TaskTarget, rng: np.random.Generator, starts: int | None = None
) -> MultistartResult:
    """Starts until some local searches have found the best optimum; all of them at once where ``starts`` is given.

    The stopping rule of a repeated solve: four searches agree, and the probability that one more start finds something
    better is below 1 %.
    """
    whole = multistart(engine, target, rng, starts or usual_starts(engine))
    for _ in range(1, 1 if starts else MAX_PASSES):
        if not any(c.feasible for c in whole.found) or (
            whole.hits >= SEARCHES_THAT_AGREE and whole.unseen_better <= UNSEEN_PROBABILITY
        ):
            break
        whole = whole.joined(multistart(engine, whole.target, rng, usual_starts(engine)), engine)
    if not whole.found or not whole.found[0].feasible:
        return whole
    best = engine.confirmed(whole.found[0], whole.target)
    return whole if best is whole.found[0] else replace(whole, found=tuple(sorted((best, *whole.found[1:]), key=rank)))


def until_recurrence(
    engine: Engine,
    target: TaskTarget,
    seed: int,
    starts: int | None = None,
    workers: int = 1,
    progress: Progress | None = None,
) -> MultistartResult:
    """Batches of starts, seeded by their number, until the best optimum has been found by two of them.

    By six, where fewer than `SEARCHES_IN_ALL` local searches found it, or so many optima were seen only once that
    better ones are likely. Independent batches that agree are evidence that a share of the starts cannot give: the
    starts of one batch are screened against each other.

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
    shared = engine, whole.target, seed, starts
    for batch in independent_batches(_batch, shared, range(1, MAX_BATCHES), workers):
        whole = whole.joined(batch, engine)
        values.append(_best(batch))
        if progress is not None:
            progress(len(values), MAX_BATCHES)
        if recurrences(values, as_good) >= _batches_wanted(whole):
            break
    return replace(whole, batches=len(values), recurred=recurrences(values, as_good))


def _batches_wanted(whole: MultistartResult) -> int:
    """How many batches are to find the best optimum, by how rare it is and how many others were seen only once."""
    expected = whole.unseen_better * whole.polished
    sure = whole.hits >= SEARCHES_IN_ALL and expected <= EXPECTED_BETTER_OPTIMA
    return BATCHES_THAT_AGREE if sure else 3 * BATCHES_THAT_AGREE


def recurrences(values: Sequence[float], limit: Callable[[float], float]) -> int:
    """How many batches found the best optimum.

    Args:
        values: the best objective of each batch, infinite where it found nothing feasible.
        limit: the objective up to which an optimum counts as one of the given objective.
    """
    best = min(values)
    return sum(value <= limit(best) for value in values) if np.isfinite(best) else 0


def independent_batches(part: Part[S, int, R], shared: S, numbers: range, workers: int) -> Iterator[R]:
    """``part(shared, k)`` of the batches k in their order, as many at a time as there are workers."""
    with opened(workers) as pool:
        for first in range(numbers.start, numbers.stop, workers):
            yield from pool.in_order(part, shared, range(first, min(first + workers, numbers.stop)))


def _best(found: MultistartResult) -> float:
    """The objective of the best feasible posture of a batch; infinite where there is none."""
    feasible = [candidate.objective for candidate in found.found if candidate.feasible]
    return min(feasible, default=float("inf"))


def _batch(shared: tuple[Engine, TaskTarget, int, int], k: int) -> MultistartResult:
    """Batch k: it depends on the seed and on k alone; what cannot be the best of it is not followed to its end."""
    engine, target, seed, starts = shared
    return multistart(engine, target, np.random.default_rng([seed, k]), starts)
