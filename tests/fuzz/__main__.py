"""Random input against the command line: ``python -m tests.fuzz --cases 100000 --jobs 2 --folder DIR``.

``--times 1`` is what the tests run. What was counted is kept in the folder: the same call goes on where it was ended,
and the sum of all processes is printed in the end.

Every case has a name, ``yaml:1203``: ``--case yaml:1203`` runs it again and shows what it says; with ``--keep DIR`` its
files are left there. A hit belongs into ``tests/corpus``, as small as it can be made, with what it must get.
"""

from __future__ import annotations

import argparse
import itertools
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from tests.fuzz.campaign import campaign
from tests.fuzz.case import Case
from tests.fuzz.child import Server
from tests.fuzz.kinds import COUNTS, case
from tests.fuzz.rules import faults
from tests.fuzz.shrink import shrunk
from tests.fuzz.tally import Hit, Tally

_EVERY = 30  # s between two accounts
_TURN = 250  # cases of all kinds, before the first one has its turn again


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("--times", type=float, default=1, help="how many times the cases of the tests (default: 1)")
    parser.add_argument("--cases", type=int, help="so many cases in all, in place of --times")
    parser.add_argument("--only", nargs="+", choices=list(COUNTS), default=list(COUNTS), help="kinds of cases")
    parser.add_argument("--seed", type=int, default=0, help="another seed has other cases")
    parser.add_argument("--jobs", type=int, default=1, help="processes that share the cases")
    parser.add_argument("--share", default="1/1", help="of several processes this one: 1/2, 2/2")
    parser.add_argument("--minutes", type=float, default=float("inf"), help="stop after so long")
    parser.add_argument("--folder", type=Path, help="keep the figures here, and go on from those that are here")
    parser.add_argument("--case", help="run this one alone and show what it says: yaml:1203")
    parser.add_argument("--shrink", action="store_true", help="make --case as small as it breaks the rule")
    parser.add_argument("--keep", type=Path, help="leave the files of --case here")
    options = parser.parse_args()
    if options.cases:
        options.times = options.cases / sum(COUNTS[kind] for kind in options.only)
    if options.jobs > 1:
        return _shared(options)
    with Server() as server:
        return _one(server, options) if options.case else _many(server, options)


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


def _shared(options: argparse.Namespace) -> int:
    """Several processes, each with its share of the cases, and the sum of what they count."""
    with tempfile.TemporaryDirectory() as temporary:
        options.folder = options.folder or Path(temporary)
        shares = [f"{k}/{options.jobs}" for k in range(1, options.jobs + 1)]
        words = ["--times", str(options.times), "--seed", str(options.seed), "--minutes", str(options.minutes)]
        words += ["--folder", str(options.folder), "--only", *options.only]
        module = [sys.executable, "-m", "tests.fuzz", *words]
        processes = [subprocess.Popen([*module, "--share", share], stdout=subprocess.DEVNULL) for share in shares]
        ends = [process.wait() for process in processes]
        tallies = [Tally.read(_file(options, share), _asked(options, share)) for share in shares]
    whole = Tally.total(tallies)
    print(*whole.hits, whole.text(), sep="\n")
    return max(ends)


def _many(server: Server, options: argparse.Namespace) -> int:
    start = last = time.perf_counter()
    asked = _asked(options, options.share)
    file = _file(options, options.share) if options.folder else None
    tally = Tally.read(file, asked) if file else Tally()
    before = tally.seconds

    def kept() -> None:
        tally.seconds = before + time.perf_counter() - start
        if file is not None:
            file.parent.mkdir(parents=True, exist_ok=True)
            tally.write(file, asked)

    def told(tally: Tally, hit: Hit | None) -> None:
        nonlocal last
        if hit is not None:
            print(hit, flush=True)
        elif time.perf_counter() - last > _EVERY:  # all that was counted is done
            last = time.perf_counter()
            print(f"{options.share}: {tally.cases} cases, {len(tally.hits)} hits", file=sys.stderr, flush=True)
            kept()

    def wanted() -> Iterator[Case]:
        for kind, number in itertools.islice(_numbers(options), tally.done, None):
            if time.perf_counter() - start > 60 * options.minutes:
                return
            yield case(kind, number, options.seed)

    campaign(server, wanted(), tally, told)
    kept()
    print(tally.text())
    return bool(tally.hits)


def _asked(options: argparse.Namespace, share: str) -> dict[str, Any]:
    """What says which cases a process has."""
    return {"times": options.times, "only": options.only, "seed": options.seed, "share": share}


def _file(options: argparse.Namespace, share: str) -> Path:
    """Where a share keeps its figures."""
    return Path(options.folder) / f"{share.replace('/', '-of-')}.json"


def _numbers(options: argparse.Namespace) -> Iterator[tuple[str, int]]:
    """The kinds take turns, so that a campaign which is stopped has seen all of them."""
    first, of = map(int, options.share.split("/"))
    counts = {kind: round(COUNTS[kind] * options.times) for kind in options.only}
    rounds = 1 + sum(counts.values()) // _TURN
    for turn in range(rounds):
        for kind, count in counts.items():
            for number in range(count * turn // rounds, count * (turn + 1) // rounds):
                if number % of == first - 1:
                    yield kind, number


if __name__ == "__main__":
    sys.exit(main())
