"""Cost against the number of targets of a map."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import posture_opt as po
from benchmarks.calibration import timed
from benchmarks.results.section import Chart, Section

LOW, HIGH = (0.4, -0.4, 0.05), (0.9, 0.4, 0.35)  # m


def mapped(side: int, workers: int) -> tuple[int, float, float]:
    """Targets of a map with ``side`` of them along x and y and a tenth of that along z, seconds, feasible %."""
    counts = (side, side, max(side // 10, 1))
    low, high = (LOW, HIGH) if counts[2] > 1 else ((*LOW[:2], 0.2), (*HIGH[:2], 0.2))
    problem: Any = po.load_problem("insert_ur10")
    seconds, found = timed(lambda: po.map_targets(problem, counts=counts, low=low, high=high, workers=workers), 1)
    return len(found.map_points), seconds, 100 * float(found.feasible.mean())


def measure(quick: bool) -> Iterator[Section]:
    mapped(3, 1)  # compiles
    rows = []
    for side in (5, 10) if quick else (5, 10, 20, 30):
        targets, seconds, feasible = mapped(side, 1)
        rows.append((targets, seconds, 1e3 * seconds / targets, feasible))
    yield Section(
        "targets", "Cost against targets",
        "`map_targets` of the insertion of a UR10 (`insert_ur10`) over 0.5 × 0.8 m, from 400 targets on in several "
        "heights; one process, compiled before.",
        ("targets", "s", "ms a target", "feasible %"), tuple(rows), ("d", ".2f", ".2f", ".0f"), (),
        Chart("whole map [s]", (1,)),
    )  # fmt: skip
