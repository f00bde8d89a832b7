"""Posture selection on a fleet of arms and tasks, against a brute force. Run with `python -m benchmarks.fleet`."""

from __future__ import annotations

import argparse
import json
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict
from multiprocessing import get_context
from pathlib import Path

from benchmarks.fleet.cases import setups
from benchmarks.fleet.jobs import answered, plan
from benchmarks.fleet.outcome import Outcome
from benchmarks.fleet.report import text
from benchmarks.fleet.times import times
from benchmarks.machine import machine_line


def parsed() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--targets", type=int, default=400)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", default="", help="arms whose name contains this")
    parser.add_argument("--task", default="", help="tasks whose name contains this")
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--cache", type=Path, required=True, help="folder of the best known answers")
    parser.add_argument("--rounds", type=int, default=2, help="least rounds of brute force")
    parser.add_argument("--compiled", action="store_true", help="compile the solver's functions (slow the first time)")
    parser.add_argument("--thorough", action="store_true", help="select_posture too")
    parser.add_argument("--no-solve", action="store_true", help="without PostureSelector.solve")
    parser.add_argument("--times", action="store_true", help="CPU ms of the compiled Panda and UR10 too")
    parser.add_argument("--json", type=Path, help="every outcome into this file")
    parser.add_argument("--replay", nargs="+", default=[], metavar="KEY", help="these cases only: arm/task/seed/index")
    return parser.parse_args()


def main() -> None:
    options = parsed()
    keys = options.replay or plan(setups(options.only, options.task), options.targets, options.seed)
    jobs = [(key, options) for key in keys]
    outcomes: list[Outcome] = []
    print(machine_line("posture_opt", "casadi", "numpy", "scipy"))
    with ProcessPoolExecutor(options.workers, get_context("spawn")) as pool:
        began = time.perf_counter()
        for done, found in enumerate(pool.map(answered, jobs), 1):
            outcomes += found
            if options.replay:
                print(json.dumps([asdict(o) for o in found], indent=1))
            if sys.stderr.isatty() or done % 25 == 0:
                print(f"{done}/{len(jobs)} cases, {time.perf_counter() - began:.0f} s", file=sys.stderr, flush=True)
    print(text(outcomes))
    if options.times:
        print(times())
    if options.json:
        options.json.write_text(json.dumps([asdict(o) for o in outcomes], indent=1), encoding="utf-8")


if __name__ == "__main__":
    main()
