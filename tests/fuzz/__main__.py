"""Random input against the command line: ``python -m tests.fuzz --cases 100000``; ``--times 1`` is what the tests run.

Every case has a name, ``yaml:1203``: ``--case yaml:1203`` runs it again and shows what it says; with ``--keep DIR`` its
files are left there. A hit belongs into ``tests/corpus``, as small as it can be made, with what it must get.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator
from pathlib import Path

from tests.fuzz.campaign import Hit, Tally, campaign
from tests.fuzz.case import Case
from tests.fuzz.child import Server
from tests.fuzz.kinds import COUNTS, case
from tests.fuzz.rules import faults
from tests.fuzz.shrink import shrunk

_EVERY = 30  # s between two accounts
_TURN = 250  # cases of all kinds, before the first one has its turn again


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("--times", type=float, default=1, help="how many times the cases of the tests (default: 1)")
    parser.add_argument("--cases", type=int, help="so many cases in all, in place of --times")
    parser.add_argument("--only", nargs="+", choices=list(COUNTS), default=list(COUNTS), help="kinds of cases")
    parser.add_argument("--seed", type=int, default=0, help="another seed has other cases")
    parser.add_argument("--share", default="1/1", help="of several processes this one: 1/2, 2/2")
    parser.add_argument("--minutes", type=float, default=float("inf"), help="stop after so long")
    parser.add_argument("--report", type=Path, help="write the figures to this file as they come")
    parser.add_argument("--case", help="run this one alone and show what it says: yaml:1203")
    parser.add_argument("--shrink", action="store_true", help="make --case as small as it breaks the rule")
    parser.add_argument("--keep", type=Path, help="leave the files of --case here")
    options = parser.parse_args()
    if options.cases:
        options.times = options.cases / sum(COUNTS[kind] for kind in options.only)
    with Server() as server:
        if options.case:
            return _one(server, options)
        return _many(server, options)


def _one(server: Server, options: argparse.Namespace) -> int:
    kind, number = options.case.split(":")
    one = case(kind, int(number), options.seed)
    if options.shrink:
        one = shrunk(server, one)
    if options.keep:
        options.keep.mkdir(parents=True, exist_ok=True)
        one.write(options.keep)
    run = server.run(one)
    print("words:", *map(repr, one.words))
    print(f"exit {run.code}, {run.cpu:.2f} s, {run.memory:.0f} MB\n--- standard output\n{run.out[:2000]}")
    print(f"--- standard error\n{run.err[:4000]}")
    wrong = list(faults(one, run))
    print(*(f"FAULT: {fault}" for fault in wrong), sep="\n")
    return bool(wrong)


def _many(server: Server, options: argparse.Namespace) -> int:
    last = start = time.perf_counter()

    def told(tally: Tally, hit: Hit | None) -> None:
        nonlocal last
        if hit is not None:
            print(hit, flush=True)
        if time.perf_counter() - last > _EVERY:
            last = time.perf_counter()
            print(f"{tally.cases} cases, {len(tally.hits)} hits", file=sys.stderr, flush=True)
            _write(options.report, tally)

    def wanted() -> Iterator[Case]:
        for one in _cases(options):
            if time.perf_counter() - start > 60 * options.minutes:
                return
            yield one

    tally = campaign(server, wanted(), told)
    _write(options.report, tally)
    print(tally.text())
    return bool(tally.hits)


def _cases(options: argparse.Namespace) -> Iterator[Case]:
    """The kinds take turns, so that a campaign which is stopped has seen all of them."""
    first, of = map(int, options.share.split("/"))
    counts = {kind: round(COUNTS[kind] * options.times) for kind in options.only}
    rounds = 1 + sum(counts.values()) // _TURN
    for turn in range(rounds):
        for kind, count in counts.items():
            for number in range(count * turn // rounds, count * (turn + 1) // rounds):
                if number % of == first - 1:
                    yield case(kind, number, options.seed)


def _write(file: Path | None, tally: Tally) -> None:
    if file is not None:
        file.write_text("\n".join([tally.text(), "", *map(str, tally.hits)]) + "\n", encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main())
