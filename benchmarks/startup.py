"""How long a fresh process takes: `import posture_opt`, and the first answer on the command line.

`python -m benchmarks.startup`. Each call is a new interpreter; the files may be in the system's cache.
"""

from __future__ import annotations

import argparse
import json
import statistics
import subprocess
import sys
import time

from benchmarks.machine import machine_line
from benchmarks.tables import table

CALLS = {
    "python -c pass": ["-c", "pass"],
    "import numpy": ["-c", "import numpy"],
    "import posture_opt": ["-c", "import posture_opt"],
    "optimize-posture --task insert --json": ["-m", "posture_opt", "--task", "insert", "--json"],
    "optimize-posture --task insert --robot ur10": ["-m", "posture_opt", "--task", "insert", "--robot", "ur10"],
}


def seconds(arguments: list[str]) -> float:
    """The wall time of one interpreter; raises RuntimeError with the last line of its standard error if it fails."""
    start = time.perf_counter()
    run = subprocess.run([sys.executable, *arguments], capture_output=True, text=True, check=False)
    elapsed = time.perf_counter() - start
    if run.returncode:
        raise RuntimeError((run.stderr.strip() or "no message").splitlines()[-1])
    if "--json" in arguments:
        json.loads(run.stdout)
    return elapsed


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=10)
    repeats = parser.parse_args().repeats
    rows, skipped = [], []
    for title, arguments in CALLS.items():
        try:
            times = [seconds(arguments) for _ in range(repeats)]
            rows.append([title, statistics.median(times), min(times), max(times)])
        except RuntimeError as error:
            skipped.append(f"{title}: skipped, {error}")
    print(machine_line("posture_opt", "casadi", "numpy"))
    print(table(["call", "median s", "min s", "max s"], rows, ("", ".3f", ".3f", ".3f")))
    print("\n".join(skipped))


if __name__ == "__main__":
    main()
