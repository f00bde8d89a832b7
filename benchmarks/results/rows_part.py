"""Cost against the number of measured rows."""

from __future__ import annotations

from collections.abc import Iterator

from benchmarks import diagnosis_rows
from benchmarks.results.section import Chart, Section
from benchmarks.rows import TASKS, cost

HEADERS = ("rows", "calibrate, CPU s", "diagnose, CPU s", "calibrate, peak MB", "diagnose, peak MB")


def measure(quick: bool) -> Iterator[Section]:
    rows, notes = [], []
    for count in (150, 500) if quick else (150, 1000, 3000, 10_000):
        calibrated, diagnosed = (cost(task, "ur10", count, False) for task in TASKS)
        rows.append((count, calibrated.seconds, diagnosed.seconds, calibrated.megabytes, diagnosed.megabytes))
        notes.append(f"{count} rows, verdict of the diagnosis: {diagnosed.verdict}.")
    yield Section(
        "rows", "Cost against rows",
        "`calibrate` and `diagnose` from the command line, cold: positions of a UR10-like arm with a soft elbow and "
        "backlash in its first joint, of the simulator of the hidden tests. Processor time of the whole command.",
        HEADERS, tuple(rows), ("d", ".1f", ".1f", ".0f", ".0f"), tuple(notes), Chart("CPU time [s]", (1, 2)),
    )  # fmt: skip
    yield Section(
        "diagnosis_rows", "Diagnosis beside calibration",
        "`diagnose` beside `calibrate` on the same file, cold, one after the other: the ratio holds. "
        "110 rows of the shipped UR10, with and without the plans of its task; the others are simulated as above.",
        diagnosis_rows.HEADERS, tuple(diagnosis_rows.comparisons(None, (1000,) if quick else (1000, 10_000))),
        diagnosis_rows.FORMATS,
    )  # fmt: skip
