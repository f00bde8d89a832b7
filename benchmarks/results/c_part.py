"""Exported C."""

from __future__ import annotations

from collections.abc import Iterator

from benchmarks.exported_c import FLAGS, nanoseconds
from benchmarks.results.section import Chart, Section


def measure(quick: bool) -> Iterator[Section]:
    yield Section(
        "exported_c", "Exported C",
        f"The UR10 with 30 sources as `export --to c` writes it, compiled by `cc {' '.join(FLAGS)}` and run alone; the "
        "shortest of 20 runs over 20 000 random postures, one a call and all in one call.",
        ("output", "one posture ns", "many, ns each"), tuple(nanoseconds()), ("", ".0f", ".0f"), (),
        Chart("ns", (1, 2)),
    )  # fmt: skip
