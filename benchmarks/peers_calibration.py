"""Calibration of real arms beside the peers: ``python -m benchmarks.peers_calibration FOLDER [SET ...]``.

Every way learns from the same rows and predicts the same others: folds by pose, as `calibrate` has them, or by block of
the workspace (``--by block``). Then it learns from two disjoint halves, whose sizes are compared. FOLDER is that of
`benchmarks.real_arms`; sets of touched points are left out, as no peer knows them. Peers whose dependencies exclude
those of the package run by an interpreter of their own: ``--python figaroh_fit=/path/to/python``.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml

import posture_opt as po
from benchmarks.calibrators import WAYS, Task
from benchmarks.machine import load, machine_line
from benchmarks.real_arms import RealSet, markdown_row, real_sets
from posture_opt.calibration.estimation.error_statistics import By, folds_of, groups_of

MOST_ROWS = 300  # of a set: the peers' residuals are Python loops with derivatives by differences
FOLDS = 5
LIMIT = 1200.0  # s a way and set
HEADERS = ("data", "way", "held out", "95 %", "stated", "true", "sizes within 2 s.e.", "parameters", "CPU s a fit")
Parts = list[tuple[list[int], list[int]]]


def task_of(asked: RealSet) -> tuple[Task, Any]:
    """The task of a set, and the measurements that it has; rows evenly spaced over the set."""
    joints = yaml.safe_load(asked.problem.read_text())["robot"]["joints"]
    table = [[_number(joint[key]) for key in ("a", "alpha", "d", "theta")] for joint in joints]
    problem = po.load_problem(asked.problem)
    data = po.read_measurements(asked.data, problem)
    rows = np.unique(np.linspace(0, len(data) - 1, MOST_ROWS).astype(int))
    used = data.take(rows)
    assert used.position is not None  # sets of points are left out
    return Task(np.array(table), used.q, used.position, rows, str(asked.problem), str(asked.data)), used


def _number(text: str) -> float:
    value, unit = text.split()
    return float(value) * {"m": 1.0, "rad": 1.0, "deg": math.pi / 180}[unit]


def parts_of(used: Any, by: By) -> tuple[Parts, Any]:
    """Learned and asked rows of every fold, then of two halves; and the groups (N,) that stay together."""
    groups, everything = groups_of(used, by, FOLDS), np.arange(len(used))
    parts = [(np.setdiff1d(everything, part), part) for part in folds_of(groups, FOLDS, by)]
    names = np.unique(groups)
    first = np.isin(groups, np.random.default_rng(1).permutation(names)[: len(names) // 2])
    one, two = np.flatnonzero(first), np.flatnonzero(~first)
    return [(a.tolist(), b.tolist()) for a, b in [*parts, (one, two), (two, one)]], groups


def run(way: str, interpreter: str, folder: Path) -> dict[str, Any]:
    """What a way answers, or ``reason`` why it does not."""
    command = [interpreter, "-m", "benchmarks.calibrators", way, str(folder / "task.npz"), str(folder / "parts.json")]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=LIMIT, check=False, cwd=os.getcwd())
    except subprocess.TimeoutExpired:
        return {"title": way, "reason": f"given up after {LIMIT:.0f} s"}
    if done.returncode:
        return {"title": way, "reason": (done.stderr.strip() or "no message").splitlines()[-1]}
    found: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return found


def row_of(found: dict[str, Any], parts: Parts, groups: Any) -> tuple[str, ...]:
    """The cells of one way behind the name of the set; millimetres."""
    if "reason" in found:
        return (found["title"], f"skipped: {found['reason']}", *[""] * (len(HEADERS) - 3))
    *folds, one, two = found["answers"]
    squares = np.zeros(len(groups))
    for answer, (_, asked) in zip(folds, parts[:-2], strict=True):
        squares[asked] = answer["squares"]
    held, (low, high) = math.sqrt(squares.mean()), _interval(squares, groups)
    stated = [answer["stated"] for answer in folds if answer["stated"] is not None]
    rms = math.sqrt(np.mean(np.square(stated))) if stated else None
    true = "states none" if rms is None else "yes" if low <= rms <= high else f"{100 * (rms / held - 1):+.0f} %"
    apart = [
        abs(value - two["sizes"][name][0]) / math.hypot(std, two["sizes"][name][1])
        for name, (value, std) in one["sizes"].items()
        if name in two["sizes"]
    ]
    return (
        found["title"], f"{1e3 * held:.3f}", f"{1e3 * low:.3f}–{1e3 * high:.3f}",
        "" if rms is None else f"{1e3 * rms:.3f}", true,
        f"{sum(a < 2 for a in apart)} of {len(apart)}" if apart else "no s.e.",
        str(folds[0]["parameters"] or ""), f"{np.median([answer['seconds'] for answer in folds]):.2f}",
    )  # fmt: skip


def _interval(squares: Any, groups: Any) -> tuple[float, float]:
    """95 % of the RMS, by bootstrap over the groups."""
    code = np.unique(groups, return_inverse=True)[1].ravel()
    total, count = np.bincount(code, squares), np.bincount(code)
    drawn = np.random.default_rng(0).integers(len(total), size=(1000, len(total)))
    low, high = np.sqrt(np.quantile(total[drawn].sum(1) / count[drawn].sum(1), [0.025, 0.975]))
    return float(low), float(high)


def rows_of(asked: RealSet, by: By, ways: Sequence[str], pythons: dict[str, str]) -> Iterator[tuple[str, ...]]:
    """The rows of a set, way by way; the last element of each is the versions that ran."""
    task, used = task_of(asked)
    parts, groups = parts_of(used, by)
    with tempfile.TemporaryDirectory() as name:
        task.save(Path(name) / "task.npz")
        (Path(name) / "parts.json").write_text(json.dumps(parts))
        for i, way in enumerate(ways):
            found = run(way, pythons.get(way, sys.executable), Path(name))
            title = f"{asked.name}, {len(used)} rows" if i == 0 else ""
            yield (title, *row_of(found, parts, groups), found.get("versions", ""))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="measurements of real arms, one subfolder an origin")
    parser.add_argument("names", nargs="*", metavar="SET", help="parts of the names of the sets that are asked for")
    parser.add_argument("--by", choices=("pose", "block"), default="pose", help="what is left out together")
    parser.add_argument("--ways", nargs="+", choices=WAYS, default=WAYS)
    parser.add_argument("--python", action="append", default=[], metavar="WAY=PATH", help="interpreter of a way")
    given = parser.parse_intermixed_args()
    pythons = dict(text.split("=", 1) for text in given.python)
    print(f"{machine_line('posture_opt', 'casadi', 'numpy', 'scipy')}; {load()}\n")
    print(markdown_row(HEADERS))
    print(markdown_row(["---", "---", *["--:"] * (len(HEADERS) - 2)]), flush=True)
    versions: dict[str, None] = {}
    for asked in real_sets(given.folder):
        if asked.touches or (given.names and not any(name in asked.name for name in given.names)):
            continue
        if not asked.there:
            print(markdown_row([asked.name, f"skipped: {asked.data} is not there", *[""] * (len(HEADERS) - 2)]))
            continue
        for *cells, ran in rows_of(asked, given.by, given.ways, pythons):
            print(markdown_row(cells), flush=True)
            versions[ran] = None
    print(f"\nWays: {'; '.join(filter(None, versions))}.")


if __name__ == "__main__":
    main()
