"""How long a diagnosis takes: ``python -m benchmarks.diagnosis [ROWS ...]``.

Arms, effects and measurements are those of the hidden tests; each size is asked from the command line, cold, and in
the process, and compared with the calibration alone of the same rows.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import posture_opt as po
from benchmarks.machine import machine_line
from tests.hidden import families
from tests.hidden.draw import draw
from tests.hidden.files import write

SEED, CASE = 77, 0
SIZES = (150, 1000)


def files_of(rows: int, folder: Path) -> None:
    """A problem file and ``rows`` measurements of a UR10-like arm with one hidden effect."""
    usual = families.FAMILIES["full"]

    def larger(rng, index):  # type: ignore[no-untyped-def]
        setting = usual(rng, index)
        return replace(setting, plan=replace(setting.plan, rows=rows))

    families.FAMILIES["full"] = larger
    try:
        write(draw(SEED, "full", CASE, kind="joint_compliance"), folder)
    finally:
        families.FAMILIES["full"] = usual


def seconds(work) -> float:  # type: ignore[no-untyped-def]
    """Wall time of a call."""
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def main(sizes: tuple[int, ...]) -> None:
    print(machine_line("numpy", "scipy"))
    print(f"{'rows':>6}  {'calibrate':>10}  {'diagnose':>10}  {'ratio':>6}  {'command':>10}   seconds")
    for rows in sizes:
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            files_of(rows, folder)
            problem = po.load_problem(folder / "problem.yaml")
            data = po.read_measurements(folder / "data.csv", problem)
            po.calibrate(problem, data)  # SciPy is imported
            alone = seconds(lambda p=problem, d=data: po.calibrate(p, d))
            whole = seconds(lambda p=problem, d=data: po.diagnose(p, d))
            command = [sys.executable, "-m", "posture_opt", "diagnose", str(folder / "data.csv")]
            command += ["--problem", str(folder / "problem.yaml"), "--json"]
            cold = seconds(lambda c=command: subprocess.run(c, check=True, capture_output=True))
        print(f"{len(data):6d}  {alone:10.2f}  {whole:10.2f}  {whole / alone:6.1f}  {cold:10.2f}")


if __name__ == "__main__":
    main(tuple(map(int, sys.argv[1:])) or SIZES)
