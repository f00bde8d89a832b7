"""Which cases a run looks at, and what one process makes of one case."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Iterator

from benchmarks.fleet.cases import Setup, replayed
from benchmarks.fleet.outcome import Outcome, quick, run, thorough
from benchmarks.fleet.store import Store

Job = tuple[str, Namespace]


def plan(found: list[Setup], targets: int, seed: int) -> list[str]:
    """Keys of ``targets`` cases: every arm in turn, each time with its next task, another one first for each seed."""
    arms: dict[str, list[Setup]] = {}
    for setup in found:
        arms.setdefault(setup.arm.name, []).append(setup)

    def turns() -> Iterator[str]:
        turn = 0
        while True:
            for k, own in enumerate(arms.values()):
                # Five is coprime to the sixteen tasks, so that neighbours do not all have the same ones.
                place = turn + 5 * k + 3 * seed
                yield f"{own[place % len(own)].key}/{seed}/{turn // len(own)}"
            turn += 1

    cases = turns()
    return [next(cases) for _ in range(targets)]


def answered(job: Job) -> list[Outcome]:
    """What the ways make of one case."""
    key, options = job
    store = Store(options.cache)
    case = replayed(key)
    compiled = None if options.compiled else False
    outcomes = [] if options.no_solve else [run(case, "solve", quick(compiled), store, options.rounds)]
    if options.thorough:
        outcomes.append(run(case, "select_posture", thorough, store, options.rounds))
    return outcomes
