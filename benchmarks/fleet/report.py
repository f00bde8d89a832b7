"""The tables of the fleet."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from benchmarks.fleet.outcome import OPTIMAL, Outcome
from benchmarks.tables import table

HEADERS = [
    "", "count", "≤ 1 %", "≤ 0.5 %", "worst gap %", "infeasible", "axis let go", "violated", "not optimal", "CPU ms"
]  # fmt: skip
FORMATS = ("", "d", ".1f", ".1f", ".2f", "d", "d", "d", "d", ".1f")


def row(name: str, outcomes: Sequence[Outcome]) -> list[object]:
    """One line: shares of all targets within 1 and 0.5 %, the worst gap of the answers that hold, and counts."""
    good = [o for o in outcomes if o.posture and not o.violations]
    gaps = np.array([o.gap for o in good])
    return [
        name,
        len(outcomes),
        100 * float(np.sum(gaps <= 0.01)) / len(outcomes),
        100 * float(np.sum(gaps <= 0.005)) / len(outcomes),
        100 * float(gaps.max()) if len(good) else None,
        sum(not o.posture for o in outcomes),
        sum("axis" in o.violations for o in outcomes),
        sum(bool(set(o.violations) - {"axis"}) for o in outcomes),
        sum(o.status == "feasible" and o.gap < OPTIMAL for o in good),
        1e3 * float(np.nanmedian([o.cpu for o in outcomes])),
    ]


def grouped(outcomes: Sequence[Outcome], key: Callable[[Outcome], str]) -> str:
    """A table with a line for each value of ``key``, and one for all."""
    names = list(dict.fromkeys(key(o) for o in outcomes))
    rows = [row(name, [o for o in outcomes if key(o) == name]) for name in names]
    return table(HEADERS, [*rows, row("all", outcomes)], FORMATS)


def missed(o: Outcome) -> bool:
    """Whether an answer is not within 1 % of the best known, or does not hold."""
    return not o.posture or bool(o.violations) or not o.gap <= 0.01


def text(outcomes: Sequence[Outcome]) -> str:
    """All tables, and a line for every miss."""
    parts = []
    for way in dict.fromkeys(o.way for o in outcomes):
        mine = [o for o in outcomes if o.way == way]
        sizes = grouped(sorted(mine, key=lambda o: o.joints > 6), lambda o: "≤ 6 joints" if o.joints <= 6 else "≥ 7")
        parts += [f"{way}", sizes, grouped(mine, lambda o: o.arm), grouped(mine, lambda o: o.task)]
        misses = sorted((o for o in mine if missed(o)), key=lambda o: -np.nan_to_num(o.gap, nan=np.inf))
        parts.append("\n".join(["misses (replay: --replay KEY)", *map(_line, misses)]))
        alone = sum(o.hits < 2 for o in mine)
        noisy = sum(bool(o.warnings) for o in mine)
        parts.append(f"{alone} best known answers found by fewer than two rounds; {noisy} solves wrote to stderr")
    return "\n\n".join(parts)


def _line(o: Outcome) -> str:
    state = ", ".join((o.status, *o.violations))
    return (
        f"{o.key:34s} gap {100 * o.gap:8.2f} %  joints {o.joints}  on limits {o.limits_hit}  "
        f"found {o.hits}/{o.rounds}  {state[:90]}"
    )
