"""One covariance of the lecture's arm (2 joints, 4 sources): nanoseconds by each way, written for lecture.md.

`python -m benchmarks.lecture [--write]`. The formulas written out by hand and the exported C function run in a loop in
C; every way is held against the exact covariance of the package before it is timed.
"""

from __future__ import annotations

import argparse
import ctypes
import json
import math
import statistics
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

import posture_opt as po
from benchmarks.arms import Array
from benchmarks.machine import machine_line
from benchmarks.tables import table
from posture_opt.uncertainty.spread_function import covariance_c

ROOT = Path(__file__).resolve().parents[1]
WRITTEN = ROOT / "docs" / "lecture" / "lecture_times.json"
POSTURES = 100_000
POINTS = 10_000  # of a cloud: its variances are known to 1.4 %
REPEATS = 7
BY_HAND = r"""
#include <math.h>
#include "tool_covariance.h"
static const double A1 = 1, A2 = 1, V1 = %(v1).17g, V2 = %(v2).17g, W1 = 1e-4, W2 = 1e-4;

static void first_order(const double *t, double *C) {
  double c1 = cos(t[0]), s1 = sin(t[0]), c = cos(t[0] + t[1]), s = sin(t[0] + t[1]);
  double e = A2 * c, f = A2 * s, x = A1 * c1 + e, y = A1 * s1 + f;
  C[0] = y * y * V1 + f * f * V2 + c1 * c1 * W1 + c * c * W2;
  C[1] = -x * y * V1 - e * f * V2 + s1 * c1 * W1 + s * c * W2;
  C[2] = x * x * V1 + e * e * V2 + s1 * s1 * W1 + s * s * W2;
}

/* The factors k depend on the arm alone: they are computed once. */
static void exact(const double *t, const double *k, double *C) {
  double c1 = cos(t[0]), s1 = sin(t[0]), c = cos(t[0] + t[1]), s = sin(t[0] + t[1]);
  double x = k[0] * c1 + k[1] * c, y = k[0] * s1 + k[1] * s;
  double p = k[5] + k[6] * (c1 * c + s1 * s) - x * x - y * y;
  double q = k[2] * (2 * c1 * c1 - 1) + k[3] * (2 * c * c - 1) + k[4] * (c1 * c - s1 * s) - x * x + y * y;
  double r = k[2] * 2 * s1 * c1 + k[3] * 2 * s * c + k[4] * (s1 * c + c1 * s) - 2 * x * y;
  C[0] = (p + q) / 2; C[1] = r / 2; C[2] = (p - q) / 2;
}

void run_first_order(long n, const double *q, double *C) {
  for (long i = 0; i < n; ++i) first_order(q + 2 * i, C + 3 * i);
}

void run_exact(long n, const double *q, double *C) {
  double V = V1 + V2;
  double k[] = {A1 * exp(-V1 / 2), A2 * exp(-V / 2), (A1 * A1 + W1) * exp(-2 * V1), (A2 * A2 + W2) * exp(-2 * V),
                2 * A1 * A2 * exp(-2 * V1 - V2 / 2), A1 * A1 + W1 + A2 * A2 + W2, 2 * A1 * A2 * exp(-V2 / 2)};
  for (long i = 0; i < n; ++i) exact(q + 2 * i, k, C + 3 * i);
}

void run_exported(long n, const double *q, double *C) {
  double full[9];
  for (long i = 0; i < n; ++i) {
    tool_covariance(q + 2 * i, 0, full, 0);
    C[3 * i] = full[0]; C[3 * i + 1] = full[1]; C[3 * i + 2] = full[4];
  }
}
"""
Way = Callable[[Array], Array]  # postures (N, 2) -> (N, 3): Cxx, Cxy, Cyy [m²]


def built(problem: po.Problem, folder: Path) -> ctypes.CDLL:
    """The C ways in one library."""
    source, header = covariance_c(problem, "tool_covariance")
    (folder / "tool_covariance.c").write_text(source)
    (folder / "tool_covariance.h").write_text(header)
    variances = {"v1": math.radians(1) ** 2, "v2": math.radians(3) ** 2}
    (folder / "hand.c").write_text(BY_HAND % variances)
    command = ["cc", "-O2", "-shared", "-fPIC", "-o", "ways.so", "hand.c", "tool_covariance.c", "-lm"]
    subprocess.run(command, cwd=folder, check=True)
    return ctypes.CDLL(str(folder / "ways.so"))


def in_c(library: ctypes.CDLL, name: str) -> Way:
    def covariances(Q: Array) -> Array:
        C = np.empty((len(Q), 3))
        pointer = ctypes.c_void_p
        library[name](ctypes.c_long(len(Q)), Q.ctypes.data_as(pointer), C.ctypes.data_as(pointer))
        return C

    return covariances


def upper(C: Array) -> Array:
    return C.reshape(-1, 9)[:, [0, 1, 4]]


def cloud(Q: Array) -> Array:
    """Sample covariances of vectorised Monte Carlo, the fastest that NumPy has."""
    rng, sigma = np.random.default_rng(0), np.array([math.radians(1), math.radians(3), 0.01, 0.01])
    C = np.empty((len(Q), 3))
    for i, q in enumerate(Q):
        t1, t2, l1, l2 = rng.standard_normal((4, POINTS)) * sigma[:, None]
        t1 += q[0]
        t2 += t1 + q[1]
        x = (1 + l1) * np.cos(t1) + (1 + l2) * np.cos(t2)
        y = (1 + l1) * np.sin(t1) + (1 + l2) * np.sin(t2)
        x, y = x - x.mean(), y - y.mean()
        C[i] = np.array([x @ x, x @ y, y @ y]) / (POINTS - 1)
    return C


def nanoseconds(way: Way, Q: Array) -> float:
    """Median CPU time of one posture."""
    way(Q)
    seconds = []
    for _ in range(REPEATS):
        start = time.process_time()
        way(Q)
        seconds.append(time.process_time() - start)
    return 1e9 * statistics.median(seconds) / len(Q)


def measured(folder: Path) -> dict[str, float]:
    """Nanoseconds of CPU time a covariance, by way."""
    problem = po.load_problem(ROOT / "problems" / "lecture_bent_weak_elbow.yaml")
    library, batch = built(problem, folder), po.SpreadFunction(problem, compiled=True)
    Q = np.random.default_rng(0).uniform(-np.pi, np.pi, (POSTURES, 2))
    truth = upper(np.asarray(batch(Q)))
    ways: dict[str, tuple[Way, int, float]] = {
        "first order, by hand, in C": (in_c(library, "run_first_order"), POSTURES, 2e-2),
        "exact, by hand, in C": (in_c(library, "run_exact"), POSTURES, 1e-11),
        "exact, the exported C": (in_c(library, "run_exported"), POSTURES, 1e-12),
        "exact, SpreadFunction, a batch": (lambda Q: upper(np.asarray(batch(Q))), POSTURES, 1e-15),
        "exact, SpreadFunction, one posture": (lambda Q: np.array([upper(batch(q))[0] for q in Q]), 2000, 1e-15),
        "Monte Carlo, 10⁴ points, NumPy": (cloud, 20, 0.1),
    }
    times = {}
    for name, (way, count, allowed) in ways.items():
        off = float(np.abs(way(Q[:count]) - truth[:count]).max() / np.abs(truth).max())
        assert off <= allowed, f"{name} is {off:.1e} off"
        times[name] = nanoseconds(way, Q[:count])
    return times


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true", help="keep the times for docs/lecture/make_lecture.py")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        times = measured(Path(folder))
    machine, least = machine_line("posture_opt", "numpy"), next(iter(times.values()))
    print(machine)
    rows = [(name, ns, ns / least) for name, ns in times.items()]
    print(table(["way", "ns a covariance", "ratio"], rows, ("", ".0f", ".1f")))
    if arguments.write:
        found = {"machine": machine, "ns": {name: round(ns, 1) for name, ns in times.items()}}
        WRITTEN.write_text(json.dumps(found, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
