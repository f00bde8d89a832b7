"""Fresh draws through the public door: ``python -m tests.hidden.hunt --trials 200 --seed 7 [--family full narrow]``.

The only file of this folder that knows the package. Trials are dealt over the families in turn; ``--json`` keeps truth,
answer and score of every case, ``--rescore`` prints the table of such a file again.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
import traceback
import warnings
from pathlib import Path
from typing import Any

from tests.hidden.draw import OutOfReach, draw
from tests.hidden.families import FAMILIES
from tests.hidden.files import plain, write
from tests.hidden.score import score
from tests.hidden.table import report

Case = tuple[str, int]
# Each family in turn, those that the closing table asks of more often.
MIX = ("full", "kr16", "narrow", "clean", "outside", "two", *FAMILIES)


def ask(folder: Path, by_command: bool = False) -> dict[str, Any]:
    """The document of the diagnosis of the files in a folder."""
    other = folder / "test.csv"
    if by_command:
        command = [sys.executable, "-m", "posture_opt", "diagnose", str(folder / "data.csv")]
        command += ["--problem", str(folder / "problem.yaml"), "--json"]
        command += ["--test", str(other)] if other.exists() else []
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            raise RuntimeError(f"exit code {done.returncode}: {done.stderr[-500:]}")
        return json.loads(done.stdout)
    import posture_opt as po

    problem = po.load_problem(folder / "problem.yaml")
    data = po.read_measurements(folder / "data.csv", problem)
    more = {"test": po.read_measurements(other, problem)} if other.exists() else {}
    if len(data.robot_names) > 1:
        return json.loads(json.dumps(po.diagnose_batch(problem, data).to_json()))
    return json.loads(json.dumps(po.diagnose(problem, data, **more).to_json()))


def trial(case: Case, options: argparse.Namespace) -> dict[str, Any]:
    """One case from its seed to its score; files vanish unless they are kept."""
    family, index = case
    span = {"weakest": options.weakest, "strongest": options.strongest}
    try:
        drawn = draw(options.seed, family, index, kind=options.kind, test=options.test, **span)
    except OutOfReach as error:
        return {"skipped": str(error)}
    truth = json.loads(json.dumps(drawn.truth, default=plain))
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(options.files) / f"{family}_{options.seed}_{index}" if options.files else Path(scratch)
        write(drawn, folder)
        start, answer, error = time.perf_counter(), None, ""
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                answer = ask(folder, options.command)
        except Exception:
            error = traceback.format_exc()
        seconds = time.perf_counter() - start
    return {"truth": truth, "answer": answer, "score": score(truth, answer, seconds, error)}


def deal(trials: int, families: list[str], first: int = 0) -> list[Case]:
    """(family, index) of every trial."""
    count: dict[str, int] = {}
    cases = []
    for i in range(trials):
        family = families[i % len(families)]
        cases.append((family, first + count.get(family, 0)))
        count[family] = count.get(family, 0) + 1
    return cases


def hunt(cases: list[Case], options: argparse.Namespace) -> list[dict[str, Any]]:
    """All trials: here, in worker processes, or on the cluster of a scheduler."""
    for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
        os.environ.setdefault(name, "1")  # the workers share the cores, and inherit this
    from posture_opt.workers import opened
    from posture_opt.workers.dask_cluster import scheduled

    pool = scheduled(options.scheduler, options.workers) if options.scheduler else opened(options.workers)
    done: dict[int, dict[str, Any]] = {}
    with pool:
        for k, result in pool.run(_trial, options, cases):
            done[k] = _tell(result, len(done), cases)
    return [done[k] for k in range(len(cases))]


def _trial(options: argparse.Namespace, case: Case) -> dict[str, Any]:
    return trial(case, options)


def _tell(done: dict[str, Any], i: int, cases: list[Case]) -> dict[str, Any]:
    if sys.stderr.isatty():
        print(f"\r{i + 1} of {len(cases)}", end="", file=sys.stderr)
    return done


def options_of(arguments: list[str] | None = None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trials", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--first", type=int, default=0, help="index of the first case of every family")
    parser.add_argument("--family", nargs="+", choices=sorted(FAMILIES), default=list(MIX))
    parser.add_argument("--kind", default="", help="only this kind of effect")
    parser.add_argument("--weakest", type=float, default=25.0, help="least λ")
    parser.add_argument("--strongest", type=float, default=float("inf"), help="largest λ")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--scheduler", help="share the trials by Dask: local, or tcp://HOST:PORT")
    parser.add_argument("--test", action="store_true", help="hand over a second session too")
    parser.add_argument("--command", action="store_true", help="by the command line, not in the process")
    parser.add_argument("--json", help="keep truth, answer and score of all cases in this file")
    parser.add_argument("--files", help="keep the files of all cases in this folder")
    parser.add_argument("--rescore", help="no trials: score the cases of such a JSON file again")
    return parser.parse_args(arguments)


def main(arguments: list[str] | None = None) -> None:
    options = options_of(arguments)
    if options.rescore:
        kept = json.loads(Path(options.rescore).read_text())
        old = [k["score"] for k in kept]
        print(
            report([score(k["truth"], k["answer"], s["seconds"], s["error"]) for k, s in zip(kept, old, strict=True)])
        )
        return
    done = hunt(deal(options.trials, options.family, options.first), options)
    kept = [d for d in done if "score" in d]
    if options.json:
        Path(options.json).write_text(json.dumps(kept))
    if len(kept) < len(done):
        print(f"{len(done) - len(kept)} draws left out: the wanted strength was out of reach\n")
    print(report([d["score"] for d in kept]))


if __name__ == "__main__":
    main()
