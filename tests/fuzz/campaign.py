"""Runs cases and counts: exit codes, CPU, memory, faults."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence

from tests.fuzz.case import Case
from tests.fuzz.child import Server
from tests.fuzz.relations import unrelated
from tests.fuzz.rules import faults, same
from tests.fuzz.run import Run
from tests.fuzz.tally import Hit, Tally

_TOGETHER = 25  # cases in one child
_AGAIN = 40  # every so many is run once more, alone: its answer must be the same


def campaign(server: Server, cases: Iterable[Case], tally: Tally, told: Callable[[Tally, Hit | None], None]) -> None:
    """Runs all cases and adds them to a tally; ``told`` hears of every hit, and after every few cases."""
    for together in _chunks(cases):
        for case, run in zip(together, server.run_all(together), strict=True):
            tally.add(case, run)
            hit = _judged(server, case, run, tally) or _related(server, case, run, tally)
            if hit is not None:
                tally.hits.append(hit)
                told(tally, hit)
        tally.done += len(together)
        told(tally, None)


def _related(server: Server, case: Case, run: Run, tally: Tally) -> Hit | None:
    """What is wrong with the twin of a case, or between the two."""
    if case.twin is None:
        return None
    other = next(server.run_all([case.twin]))
    tally.pairs += 1
    wrong = (*faults(case.twin, other), *unrelated(case, run, other))
    return Hit.of(case, other, wrong) if wrong else None


def _judged(server: Server, case: Case, run: Run, tally: Tally) -> Hit | None:
    """What is wrong with a run; where anything is, or now and then, the case is run alone too."""
    found = list(faults(case, run))
    if not found and case.number % _AGAIN:
        return None
    alone = server.run(case)
    tally.again += 1
    wrong = (
        list(faults(case, alone)) or [f"only after other cases: {fault}" for fault in found] or list(same(run, alone))
    )
    return Hit.of(case, alone, tuple(wrong)) if wrong else None


def _chunks(cases: Iterable[Case]) -> Iterator[Sequence[Case]]:
    chunk: list[Case] = []
    for case in cases:
        chunk.append(case)
        if len(chunk) == _TOGETHER:
            yield chunk
            chunk = []
    if chunk:
        yield chunk
