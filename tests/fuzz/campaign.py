"""Runs cases and counts: exit codes, CPU, memory, faults."""

from __future__ import annotations

import re
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field

from tests.fuzz.case import Case
from tests.fuzz.child import Server
from tests.fuzz.relations import unrelated
from tests.fuzz.rules import CODES, faults, same
from tests.fuzz.run import Run

_TOGETHER = 25  # cases in one child
_AGAIN = 40  # every so many is run once more, alone: its answer must be the same


@dataclass(frozen=True)
class Hit:
    """A case that broke a rule."""

    case: Case
    run: Run
    faults: tuple[str, ...]

    def __str__(self) -> str:
        words = " ".join(self.case.words).encode("unicode_escape").decode()
        return "\n    ".join([f"{self.case.name}: exit {self.run.code}: {words[:160]}", *self.faults])


@dataclass
class Tally:
    """What a campaign has found so far."""

    codes: dict[str, Counter[int]] = field(default_factory=dict)
    cpu: dict[str, float] = field(default_factory=dict)
    slowest: tuple[float, str] = (0.0, "")
    largest: tuple[float, str] = (0.0, "")
    again: int = 0
    pairs: int = 0
    hits: list[Hit] = field(default_factory=list)
    start: float = field(default_factory=time.perf_counter)

    def add(self, case: Case, run: Run) -> None:
        """Counts a run."""
        self.codes.setdefault(case.kind, Counter())[run.code] += 1
        self.cpu[case.kind] = self.cpu.get(case.kind, 0.0) + run.cpu
        self.slowest = max(self.slowest, (run.cpu, case.name))
        self.largest = max(self.largest, (run.memory, case.name))

    @property
    def cases(self) -> int:
        """How many were run."""
        return sum(sum(codes.values()) for codes in self.codes.values())

    def text(self) -> str:
        """The figures, as a table."""
        others = sorted({code for codes in self.codes.values() for code in codes} - {*CODES})
        heads = [*(f"exit {code}" for code in (*CODES, *others)), "cases", "CPU s"]
        lines = [f"{'':10}" + "".join(f"{head:>10}" for head in heads)]
        for kind, codes in self.codes.items():
            row = [codes[code] for code in (*CODES, *others)] + [sum(codes.values()), round(self.cpu[kind])]
            lines.append(f"{kind:10}" + "".join(f"{number:10}" for number in row))
        lines += [
            f"{self.cases} cases, {sum(self.cpu.values()):.0f} s of CPU in them, "
            f"{time.perf_counter() - self.start:.0f} s by the clock; {self.again} of them run twice, "
            f"{self.pairs} as pairs",
            "most CPU: {:.2f} s ({}); ".format(*self.slowest) + "most memory: {:.0f} MB ({})".format(*self.largest),
            f"{len(self.hits)} cases broke a rule" + "".join(f"\n  {n} x {what}" for what, n in self._classes()),
        ]
        return "\n".join(lines)

    def _classes(self) -> list[tuple[str, int]]:
        """Hits that say the same, numbers and names aside, are one class."""
        said = (hit.faults[0] for hit in self.hits)
        return Counter(re.sub(r"\d+(\.\d+)?|'[^']*'", "#", text)[:100] for text in said).most_common()


def campaign(server: Server, cases: Iterable[Case], told: Callable[[Tally, Hit | None], None]) -> Tally:
    """Runs all cases; ``told`` hears of every hit, and after every few cases."""
    tally = Tally()
    for together in _chunks(cases):
        for case, run in zip(together, server.run_all(together), strict=True):
            tally.add(case, run)
            hit = _judged(server, case, run, tally) or _related(server, case, run, tally)
            if hit is not None:
                tally.hits.append(hit)
                told(tally, hit)
        told(tally, None)
    return tally


def _related(server: Server, case: Case, run: Run, tally: Tally) -> Hit | None:
    """What is wrong with the twin of a case, or between the two."""
    if case.twin is None:
        return None
    other = next(server.run_all([case.twin]))
    tally.pairs += 1
    wrong = (*faults(case.twin, other), *unrelated(case, run, other))
    return Hit(case, other, wrong) if wrong else None


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
    return Hit(case, alone, tuple(wrong)) if wrong else None


def _chunks(cases: Iterable[Case]) -> Iterator[Sequence[Case]]:
    chunk: list[Case] = []
    for case in cases:
        chunk.append(case)
        if len(chunk) == _TOGETHER:
            yield chunk
            chunk = []
    if chunk:
        yield chunk
