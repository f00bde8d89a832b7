"""What a campaign has found so far: counts that are kept in a file, gone on with, and summed over processes."""

from __future__ import annotations

import json
import os
import re
from collections import Counter
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from tests.fuzz.case import Case
from tests.fuzz.rules import CODES
from tests.fuzz.run import Run

SLOW = 2.0  # s of CPU; such cases are counted by themselves


@dataclass(frozen=True)
class Hit:
    """A case that broke a rule: its name, exit code and call, and the rules."""

    name: str
    code: int
    words: str
    faults: tuple[str, ...]

    @classmethod
    def of(cls, case: Case, run: Run, faults: Iterable[str]) -> Hit:
        """What a run did wrong."""
        return cls(case.name, run.code, " ".join(case.words).encode("unicode_escape").decode()[:160], tuple(faults))

    def __str__(self) -> str:
        return "\n    ".join([f"{self.name}: exit {self.code}: {self.words}", *self.faults])


@dataclass
class Tally:
    """Runs by kind and exit code, CPU [s] by kind, the extremes, and all hits.

    Args:
        done: cases of the campaign's sequence that are behind it: where the same call goes on.
        slow: cases that took over `SLOW`; ``again`` were run twice, ``pairs`` with a twin.
        seconds: by the clock.
    """

    codes: dict[str, Counter[int]] = field(default_factory=dict)
    cpu: dict[str, float] = field(default_factory=dict)
    slowest: tuple[float, str] = (0.0, "")
    largest: tuple[float, str] = (0.0, "")
    slow: int = 0
    again: int = 0
    pairs: int = 0
    done: int = 0
    seconds: float = 0.0
    hits: list[Hit] = field(default_factory=list)

    def add(self, case: Case, run: Run) -> None:
        """Counts a run."""
        self.codes.setdefault(case.kind, Counter())[run.code] += 1
        self.cpu[case.kind] = self.cpu.get(case.kind, 0.0) + run.cpu
        self.slowest = max(self.slowest, (run.cpu, case.name))
        self.largest = max(self.largest, (run.memory, case.name))
        self.slow += run.cpu > SLOW

    @classmethod
    def total(cls, parts: Iterable[Tally]) -> Tally:
        """The sum over processes that ran beside each other."""
        whole = cls()
        for part in parts:
            for kind, codes in part.codes.items():
                whole.codes.setdefault(kind, Counter()).update(codes)
                whole.cpu[kind] = whole.cpu.get(kind, 0.0) + part.cpu[kind]
            whole.slowest, whole.largest = max(whole.slowest, part.slowest), max(whole.largest, part.largest)
            for name in ("slow", "again", "pairs", "done"):
                setattr(whole, name, getattr(whole, name) + getattr(part, name))
            whole.seconds = max(whole.seconds, part.seconds)
            whole.hits += part.hits
        return whole

    def write(self, file: Path, asked: dict[str, Any]) -> None:
        """Keeps it in a file, whole at every moment, with what was asked for."""
        beside = file.with_suffix(".new")
        held = {"asked": asked, **vars(self), "hits": [asdict(hit) for hit in self.hits]}
        beside.write_text(json.dumps(held), encoding="utf-8")
        os.replace(beside, file)

    @classmethod
    def read(cls, file: Path, asked: dict[str, Any]) -> Tally:
        """What a file holds; an empty tally where there is none.

        Raises:
            ValueError: it holds another campaign.
        """
        if not file.exists():
            return cls()
        held = json.loads(file.read_text(encoding="utf-8"))
        if held.pop("asked") != asked:
            raise ValueError(f"{file} holds another campaign")
        held["codes"] = {kind: Counter({int(k): n for k, n in codes.items()}) for kind, codes in held["codes"].items()}
        held |= {name: tuple(held[name]) for name in ("slowest", "largest")}
        held["hits"] = [Hit(**{**hit, "faults": tuple(hit["faults"])}) for hit in held["hits"]]
        return cls(**held)

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
        spent = sum(self.cpu.values())
        lines += [
            f"{self.cases} cases, {spent:.0f} s of CPU in them ({1e3 * spent / max(self.cases, 1):.0f} ms each), "
            f"{self.seconds:.0f} s by the clock; {self.again} of them run twice, {self.pairs} as pairs",
            "most CPU: {:.2f} s ({}), ".format(*self.slowest)
            + f"{self.slow} over {SLOW:g} s; most memory: {{:.0f}} MB ({{}})".format(*self.largest),
            f"{len(self.hits)} cases broke a rule" + "".join(f"\n  {n} x {what}" for what, n in self._classes()),
        ]
        return "\n".join(lines)

    def _classes(self) -> list[tuple[str, int]]:
        """Hits that say the same, numbers and names aside, are one class."""
        said = (hit.faults[0] for hit in self.hits)
        return Counter(re.sub(r"\d+(\.\d+)?|'[^']*'", "#", text)[:100] for text in said).most_common()
