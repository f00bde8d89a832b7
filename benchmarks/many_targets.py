"""What a target of a large map costs, and what workers do: ``python -m benchmarks.many_targets [--side 100]``.

Each line is a map of side x side targets in a process of its own. Beside the wall time stand the CPU seconds of the
process that shares out the work and of its workers, and the largest memory of the first; the times of more workers than
there are cores are worked out from these: what is shared out is divided, what shares it out is not.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import time

_PLANNED = (1, 2, 4, 8)
_MEGABYTE = 1024  # KiB, as Linux counts the memory of a process


def measured(problem: str, side: int, workers: int) -> dict[str, float]:
    """Wall and CPU seconds and memory [MB] of one map, in this process."""
    import posture_opt as po

    loaded = po.load_problem(problem)
    po.map_targets(loaded, counts=(3, 3), workers=workers)  # compiled functions are found in the cache from here on
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    wall, own = time.perf_counter(), time.process_time()
    po.map_targets(loaded, counts=(side, side), workers=workers)
    wall, own = time.perf_counter() - wall, time.process_time() - own
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    shared = after.ru_utime + after.ru_stime - children.ru_utime - children.ru_stime
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / _MEGABYTE
    return {"targets": side**2, "workers": workers, "wall": wall, "own": own, "shared": shared, "MB": peak}


def main() -> None:
    """Measure with one worker and with as many as there are cores, and plan with more."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--problem", default="insert_ur10")
    parser.add_argument("--side", type=int, nargs="+", default=[32, 100])
    parser.add_argument("--workers", type=int, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.workers:
        print(json.dumps(measured(given.problem, given.side[0], given.workers)))
        return
    print("| targets | workers | s | ms a target | CPU s, sharing out | CPU s, workers | MB | times one worker |")
    print("|--:|--:|--:|--:|--:|--:|--:|--:|")
    for side in given.side:
        alone = 0.0
        for workers in (1, os.cpu_count() or 2):
            words = ["--problem", given.problem, "--side", str(side), "--workers", str(workers)]
            command = [sys.executable, "-m", "benchmarks.many_targets", *words]
            done = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
            alone = done["wall"] if workers == 1 else alone
            cells = (done["targets"], workers, f"{done['wall']:.1f}", f"{1e3 * done['wall'] / done['targets']:.2f}",
                     f"{done['own']:.1f}", f"{done['shared']:.1f}", f"{done['MB']:.0f}",
                     f"{alone / done['wall']:.2f}")  # fmt: skip
            print("|", " | ".join(map(str, cells)), "|", flush=True)
    print("\n1 000 000 targets, worked out from the last line: CPU of sharing out + CPU of the workers / workers\n")
    for workers in _PLANNED:
        seconds = (done["own"] + done["shared"] / workers) * 1e6 / done["targets"]
        print(f"{workers} workers: {seconds / 3600:.2f} h, {1e6 / seconds:.0f} targets a second")


if __name__ == "__main__":
    main()
