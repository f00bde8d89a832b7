"""What one half of real measurements says of the other: ``python -m benchmarks.halves FOLDER [SET ...]``.

The poses of a set are dealt to two disjoint halves at random (``--by block``: blocks of the workspace). Each half is
diagnosed by itself, predicts the other with nothing refitted, and names its causes without knowing those of the other.
What is stated is cross-validated as the command does by default: by pose, of touched points by place.
FOLDER is that of `benchmarks.real_arms`; sets that are missing are skipped, with the reason.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

import posture_opt as po
from benchmarks.machine import load, machine_line
from benchmarks.real_arms import RealSet, markdown_row, real_sets
from posture_opt.calibration.estimation.error_statistics import By, Statistics, groups_of
from posture_opt.diagnosis.causes.causes import Finding
from posture_opt.diagnosis.diagnosis import Diagnosis
from posture_opt.model.effects import CyclicError

MOST_ROWS = 600  # a half: the search then takes seconds
MODELS = ("nominal", "calibrated", "extended")
HEADERS = ("data", "half", "rows", *(f"{name}, {how}" for name in MODELS for how in ("stated", "unseen")), "apart",
           "causes", "first cause", "agree")  # fmt: skip
_SAME_LINE = 0.5  # cycles a turn: lines of two halves that are nearer than that are one
_SHOWN = {"rad": (1e3, "mrad"), "m": (1e3, "mm"), "rad/(N*m)": (1e6, "µrad/(N m)")}  # SI unit -> factor and unit


@dataclass(frozen=True)
class Size:
    """One number of a cause with its standard error [SI]; ``cycles`` a turn of a line, 0 of what is no line."""

    kind: str
    target: str
    name: str
    value: float
    std: float
    unit: str
    cycles: float = 0.0

    def same(self, other: Size) -> bool:
        """Whether the other half means the same number."""
        names = (self.kind, self.target, self.name) == (other.kind, other.target, other.name)
        return names and abs(self.cycles - other.cycles) < _SAME_LINE

    def apart(self, other: Size) -> float:
        """The difference of two halves in its own standard errors."""
        return abs(self.value - other.value) / math.hypot(self.std, other.std)

    def __str__(self) -> str:
        factor, unit = _SHOWN.get(self.unit, (1.0, self.unit.replace("*", " ")))
        at = f" at {self.cycles:.4g} a turn" if self.cycles else ""
        return f"{factor * self.value:.3g} ± {factor * self.std:.2g}{'' if unit == '1' else f' {unit}'}{at}"


@dataclass(frozen=True)
class Half:
    """What one half says: errors by model [m] stated and unseen, and its causes with their sizes.

    ``apart`` is how far the unseen error of the extended model is from the stated one, in standard errors of both.
    """

    rows: int
    stated: tuple[float, ...]
    unseen: tuple[float, ...]
    apart: float
    causes: tuple[tuple[str, str], ...]
    sizes: tuple[Size, ...]
    seconds: float


def two_halves(asked: RealSet, by: By, deal: int) -> tuple[Any, Any, Any]:
    """The problem, and the measurements of two disjoint halves; of touched points half of the touches of each.

    Args:
        deal: seed of the dealing.
    """
    problem = po.load_problem(asked.problem)
    data = po.read_measurements(asked.data, problem)
    data = data.take(np.unique(np.linspace(0, len(data) - 1, 2 * MOST_ROWS).astype(int)))
    groups = groups_of(data, by, folds=5)
    names = np.unique(groups)
    first = np.isin(groups, np.random.default_rng(deal).permutation(names)[: len(names) // 2])
    return problem, data.take(np.flatnonzero(first)), data.take(np.flatnonzero(~first))


def half(problem: Any, mine: Any, other: Any, by: By) -> Half:
    """One half diagnosed, and judged by the other; errors are stated as by default, or by block."""
    began = time.process_time()
    found = po.diagnose(problem, mine, test=other, by="block" if by == "block" else None, plan=False)
    seconds = time.process_time() - began
    assert found.test is not None  # asked for
    causes = tuple((f.kind, f.target) for f in named(found))
    return Half(
        len(mine), tuple(found.errors[m].rms for m in MODELS), tuple(found.test.models[m].rms for m in MODELS),
        difference(found.errors["extended"], found.test.models["extended"]), causes,
        tuple(size for f in named(found) for size in sizes_of(found, f)), seconds,
    )  # fmt: skip


def difference(stated: Statistics, unseen: Statistics) -> float:
    """Unseen minus stated RMS in the standard errors that their bootstrap intervals have."""
    widths = (s.interval[1] - s.interval[0] for s in (stated, unseen))
    return (unseen.rms - stated.rms) * 2 * 1.96 / math.hypot(*widths)


def named(found: Diagnosis) -> list[Finding]:
    """The causes beside geometry that are stated with a size."""
    return [f for f in found.effects if f.kind != "geometry" and f.determined]


def sizes_of(found: Diagnosis, finding: Finding) -> Iterator[Size]:
    """The numbers that are stated of a cause: of a sine and a cosine the amplitude, of unstated loads the turn."""
    if finding.effect is not None and finding.effect.unstated_loads:
        turn = finding.sizes.rms
        if turn is not None:
            yield Size(finding.kind, finding.target, "turn RMS", *turn, "rad")
        return
    estimate, kind, target = finding.estimate, finding.kind, finding.target
    cause = finding.cause
    cycles = (cause.cycles, *cause.further) if isinstance(cause, CyclicError) else ()
    for name, (value, std, unit) in estimate.items():
        if name.startswith("cos") or not math.isfinite(std) or name in ("cycles", "centre"):
            continue
        if name.startswith("sin"):
            line = int(name[3:] or 1) - 1
            cosine, its_std, _ = estimate["cos" + name[3:]]
            length = math.hypot(value, cosine)
            std = math.hypot(value * std, cosine * its_std) / length
            yield Size(kind, target, "amplitude", length, std, unit, cycles[line] if cycles else 0.0)
        else:
            yield Size(kind, target, name, value, std, unit)


def pairs(one: Half, two: Half) -> list[tuple[Size, Size]]:
    """The numbers that both halves state."""
    return [(a, b) for a in one.sizes for b in two.sizes if a.same(b)]


def agreement(one: Half, two: Half) -> str:
    """Whether the first causes of two halves are the same, with the same size."""
    if not one.causes or not two.causes:
        return "yes, none" if one.causes == two.causes else "no"
    if one.causes[0] != two.causes[0]:
        there = [c.causes[0] in o.causes for c, o in ((one, two), (two, one))]
        return "each is named by the other, later" if all(there) else "one is named by both" if any(there) else "no"
    both = [a.apart(b) for a, b in pairs(one, two) if (a.kind, a.target) == one.causes[0]]
    if not both:
        return "name yes, no size in common"
    return f"name yes, size {'yes' if both[0] < 2 else 'no'} ({both[0]:.1f} standard errors apart)"


def rows_of(name: str, halves: Sequence[Half]) -> Iterator[tuple[str, ...]]:
    """Two rows of the table; millimetres."""
    for i, h in enumerate(halves):
        errors = [f"{1e3 * rms:.3f}" for pair in zip(h.stated, h.unseen, strict=True) for rms in pair]
        sizes = [s for s in h.sizes if h.causes and (s.kind, s.target) == h.causes[0]]
        first = f"{h.causes[0][0].replace('_', ' ')} ({h.causes[0][1]})" if h.causes else "none"
        first += f" {max(sizes, key=lambda s: abs(s.value) / s.std)}" if sizes else ""
        agree = agreement(*halves) if i == 0 else ""
        yield (
            name if i == 0 else "",
            "ab"[i],
            str(h.rows),
            *errors,
            f"{h.apart:+.1f}",
            str(len(h.causes)),
            first,
            agree,
        )


def measured(asked: RealSet, by: By, deal: int) -> list[Half]:
    """Both halves of a set."""
    problem, a, b = two_halves(asked, by, deal)
    return [half(problem, a, b, by), half(problem, b, a, by)]


def summary(found: Sequence[Sequence[Half]]) -> Iterator[str]:
    """What the table comes to: first causes, sizes, unseen errors."""
    sizes = [a.apart(b) for one, two in found for a, b in pairs(one, two)]
    first = sum(one.causes[:1] == two.causes[:1] for one, two in found)
    both = [(set(one.causes), set(two.causes)) for one, two in found]
    shared, named_ = sum(len(a & b) for a, b in both), sum(len(a | b) for a, b in both)
    yield f"The first cause is the same in both halves of {first} of {len(found)} sets."
    yield f"Of {named_} causes that a half names {shared} are named by both."
    yield f"Of {len(sizes)} sizes that both state {sum(s < 2 for s in sizes)} are within two standard errors."
    halves = [h for pair in found for h in pair]
    below = [s for h in halves for s in h.sizes if abs(s.value) < s.std]
    yield f"Of {sum(len(h.sizes) for h in halves)} sizes that a half states {len(below)} are less than their error."
    true = sum(abs(h.apart) < 2 for h in halves)
    yield f"The stated RMS of the extended model holds within two standard errors in {true} of {len(halves)} halves."
    better = sum(h.unseen[2] < h.unseen[1] for h in halves)
    yield f"The extended model predicts the other half better than the calibrated in {better} of {len(halves)} cases."


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="measurements of real arms, one subfolder an origin")
    parser.add_argument("names", nargs="*", metavar="SET", help="parts of the names of the sets that are asked for")
    parser.add_argument("--by", choices=("pose", "block"), default="pose", help="what is dealt to the halves together")
    parser.add_argument("--deal", type=int, default=1, help="seed of the dealing")
    given = parser.parse_intermixed_args()
    print(f"{machine_line('posture_opt', 'numpy', 'scipy')}; {load()}\n")
    print(markdown_row(HEADERS))
    print(markdown_row(["---", "---", *["--:"] * 8, "--:", "---", "---"]), flush=True)
    found, seconds = [], 0.0
    for asked in real_sets(given.folder):
        if given.names and not any(name in asked.name for name in given.names):
            continue
        if not asked.there or (asked.touches and given.by == "block"):
            why = "touched points have no blocks" if asked.there else f"{asked.data} is not there"
            print(markdown_row([asked.name, f"skipped: {why}", *[""] * (len(HEADERS) - 2)]), flush=True)
            continue
        with ProcessPoolExecutor(1, get_context("spawn")) as alone:
            halves = alone.submit(measured, asked, given.by, given.deal).result()
        found.append(halves)
        seconds += sum(h.seconds for h in halves)
        for cells in rows_of(asked.name, halves):
            print(markdown_row(cells), flush=True)
    print("", *summary(found), f"CPU: {seconds:.0f} s.", sep="\n")


if __name__ == "__main__":
    main()
