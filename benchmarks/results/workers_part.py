"""Cost against the number of worker processes."""

from __future__ import annotations

import os
from collections.abc import Iterator

from benchmarks.results.section import Chart, Section
from benchmarks.results.targets_part import mapped


def measure(quick: bool) -> Iterator[Section]:
    mapped(3, 1)  # compiles
    cores = os.cpu_count() or 1
    side = 10 if quick else 30
    rows = []
    for workers in [n for n in (1, 2, 4, 8) if n <= max(cores, 2)]:
        targets, seconds, _ = mapped(side, workers)
        one = rows[0][1] if rows else seconds
        rows.append((workers, seconds, targets / seconds, one / seconds, one / seconds / workers))
    yield Section(
        "workers", "Cost against workers",
        f"The map of {targets} targets of the table above by worker processes of `--workers` on {cores} cores.",
        ("workers", "s", "targets a second", "speed-up", "a worker"), tuple(rows), ("d", ".2f", ".0f", ".2f", ".2f"),
        (),
        Chart("targets a second", (2,), logarithmic=False),
    )  # fmt: skip
