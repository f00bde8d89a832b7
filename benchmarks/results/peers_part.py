"""Posture selection beside the libraries that one would otherwise use."""

from __future__ import annotations

from collections.abc import Iterator
from importlib.util import find_spec

from benchmarks.arms import ARMS
from benchmarks.posture_selection import measure as selected
from benchmarks.posture_selection import rows
from benchmarks.results.section import Chart, Section
from benchmarks.targets import draw

TEXT = (
    "Smallest worst axis of the horizontal position covariance across a vertical insertion: tool axis down, yaw free, "
    "limits hard, joint noise alone. {arm}: {count} targets, {replaced} draws replaced because nothing reaches them. "
    "Medians over the targets; feasible is what Pinocchio says is, the best is that of all ways and references."
)
HEADERS = ("way", "wall ms", "CPU ms", "to ours", "feasible %", "within 1 % of best %", "worst gap %")
LEFT_OUT = {
    "pytracik": "one inverse kinematics solution a call, without an objective: no way of its own here",
    "pyroki": "the package index has none; from its repository it needs JAX",
}


def measure(quick: bool) -> Iterator[Section]:
    for arm in ARMS:
        targets = draw(arm, 5 if quick else 25, 0)
        records, skipped = selected(arm, targets, quick)
        found = [tuple(v if v is None or isinstance(v, str) else float(v) for v in row) for row in rows(records)]
        skipped_rows = [(note.split(": skipped")[0], *[None] * 6) for note in skipped]
        missing = [
            f"{name} ({'installed' if find_spec(name) else 'not installed'}): {why}." for name, why in LEFT_OUT.items()
        ]
        yield Section(
            f"selection_{arm.name.lower()}", f"Posture selection, {arm.name}",
            TEXT.format(arm=f"{arm.name} at {arm.tip}", count=len(targets.positions), replaced=targets.replaced),
            HEADERS, (*found, *skipped_rows), ("", ".1f", ".1f", ".1f", ".0f", ".0f", ".2f"),
            (*skipped, *missing), Chart("median wall time of one target [ms]", (1,)),
        )  # fmt: skip
