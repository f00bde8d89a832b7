"""How long a fresh process takes."""

from __future__ import annotations

import statistics
from collections.abc import Iterator

from benchmarks.results.section import Chart, Section
from benchmarks.startup import CALLS, seconds


def measure(quick: bool) -> Iterator[Section]:
    taken: dict[str, list[float]] = {title: [] for title in CALLS}
    for _ in range(3 if quick else 10):
        for title, arguments in CALLS.items():  # in turns
            taken[title].append(seconds(arguments))
    rows = tuple((title, statistics.median(times), min(times), max(times)) for title, times in taken.items())
    yield Section(
        "start", "Start", "Wall time of fresh interpreters, in turns.", ("call", "median s", "min s", "max s"), rows,
        ("", ".3f", ".3f", ".3f"), (), Chart("median wall time [s]", (1,), logarithmic=False),
    )  # fmt: skip
