"""What a diagnosis costs beside the calibration of the same rows: ``python -m benchmarks.diagnosis_rows [FOLDER]``.

110 rows are those of the shipped arm, with and without the plans of its task; 1 000 and 10 000 are simulated. With
FOLDER, that of `benchmarks.real_arms`, also the UR5 and the UR10 there, which have lines in every joint.

Both commands run cold, one after the other: the ratio of their processor times holds where the times do not.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from benchmarks.machine import machine_line
from benchmarks.rows import measured_run, write_files
from benchmarks.tables import table

HEADERS = ("data", "rows", "calibrate, CPU s", "diagnose, CPU s", "ratio", "diagnose, peak MB")
FORMATS = ("", "d", ".1f", ".1f", ".1f", ".0f")
SHIPPED = Path("problems")
MOST = 10_000
REAL = {"UR5, grid": ("jacobi_ur5", "grid"), "UR10, series A": ("ipa_ur10", "series_a")}
Row = tuple[str, int, float, float, float, float]


def compared(title: str, problem: Path, data: Path, *options: str) -> Row:
    """Both commands on one file; of more rows than a diagnosis searches, the first so many."""
    with tempfile.TemporaryDirectory() as name:
        lines = data.read_text().splitlines()[: MOST + 1]
        (first := Path(name) / data.name).write_text("\n".join(lines) + "\n")
        command = [sys.executable, "-m", "posture_opt"]
        ends = [str(first), "--problem", str(problem), "--json", "--quiet", *options]
        (calibrated, _, _), (seconds, megabytes, _) = (
            measured_run([*command, task, *ends]) for task in ("calibrate", "diagnose")
        )
    return title, len(lines) - 1, calibrated, seconds, seconds / calibrated, megabytes


def comparisons(folder: Path | None = None, sizes: tuple[int, ...] = (1000, MOST)) -> Iterator[Row]:
    """The shipped arm, simulated ones, and with a folder the real ones."""
    shipped = SHIPPED / "insert_ur10_measured.yaml", SHIPPED / "ur10_measured.csv"
    yield compared("shipped, with its plans", *shipped)
    yield compared("shipped, --no-plan", *shipped, "--no-plan")
    for count in sizes:
        with tempfile.TemporaryDirectory() as name:
            write_files(Path(name), "ur10", count, False)
            yield compared("simulated", Path(name) / "problem.yaml", Path(name) / "data.csv")
    for title, (place, file) in REAL.items() if folder else ():
        assert folder is not None
        yield compared(title, folder / place / "problem.yaml", folder / place / f"{file}.csv", "--no-plan")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, nargs="?", help="with the files of benchmarks.real_arms")
    found = []
    for row in comparisons(parser.parse_args().folder):
        print(*row, file=sys.stderr, flush=True)
        found.append(row)
    print(machine_line("numpy", "scipy", "casadi"))
    print(table(HEADERS, found, FORMATS))


if __name__ == "__main__":
    main()
