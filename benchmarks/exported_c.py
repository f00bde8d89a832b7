"""Exported C, compiled and run by itself: nanoseconds of each output, one posture a call and many.

`python -m benchmarks.exported_c`. The UR10 of `benchmarks.dh_ur10`, 30 sources, its task a vertical insertion.
"""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from pathlib import Path

import posture_opt as po
from benchmarks import dh_ur10
from benchmarks.machine import machine_line
from benchmarks.tables import table

FLAGS = ("-std=c99", "-O3")
COUNT, REPEATS = 20_000, 20
CALLS = {
    "covariance, exact": ("tool_covariance(q, 0, C, 0)", "tool_covariance_rows(COUNT, Q, 0, many, 0)"),
    "covariance, first order": ("tool_covariance(q, 0, 0, C)", "tool_covariance_rows(COUNT, Q, 0, 0, many)"),
    "position": ("tool_covariance(q, C, 0, 0)", "tool_covariance_rows(COUNT, Q, many, 0, 0)"),
    "objective": ("tool_covariance_objective(q, C, 0, 0)", ""),
    "objective and gradient": ("tool_covariance_objective(q, C, g, 0)", ""),
    "objective, gradient and Hessian": ("tool_covariance_objective(q, C, g, H)", ""),
}
_MAIN = """
#include <stdio.h>
#include <stdlib.h>
#include <time.h>
#include "tool_covariance.h"
#include "tool_covariance_objective.h"
#define COUNT %d
static double Q[6 * COUNT], many[9 * COUNT], C[9], g[6], H[36], sum;
static double now(void) { return (double)clock() / CLOCKS_PER_SEC; }
int main(void) {
  double best, t;
  for (int i = 0; i < 6 * COUNT; ++i) Q[i] = 6.28 * rand() / RAND_MAX - 3.14;
%s
  return sum == 0.123;
}
"""
_TIMED = """  best = 1e9;
  for (int r = 0; r < %d; ++r) {
    t = now();
    %s
    t = now() - t;
    if (t < best) best = t;
  }
  printf("%%.1f\\n", 1e9 * best / COUNT);
"""


def nanoseconds() -> list[tuple[str, float, float | None]]:
    """What is computed, and the shortest time of it for one posture a call and for many at once [ns].

    Raises:
        RuntimeError: no C compiler.
    """
    compiler = shutil.which("cc")
    if compiler is None:
        raise RuntimeError("no C compiler")
    blocks = []
    for one, rows in CALLS.values():
        loop = f"for (int i = 0; i < COUNT; ++i) {{ const double* q = Q + 6 * i; {one}; sum += C[0]; }}"
        blocks += [_TIMED % (REPEATS, loop), *([_TIMED % (REPEATS, f"{rows}; sum += many[0];")] if rows else [])]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for file, text in po.export_files(po.problem_from_dict(dh_ur10.problem()), "c").files.items():
            (folder / file).write_text(text)
        (folder / "tool_covariance_check.c").unlink()
        (folder / "main.c").write_text(_MAIN % (COUNT, "".join(blocks)))
        sources = sorted(file.name for file in folder.glob("*.c"))
        subprocess.run([compiler, *FLAGS, *sources, "-o", "timed", "-lm"], cwd=folder, check=True)
        said = iter(subprocess.run([folder / "timed"], capture_output=True, text=True, check=True).stdout.split())
    return [(what, float(next(said)), float(next(said)) if rows else None) for what, (_, rows) in CALLS.items()]


def main() -> None:
    print(machine_line("posture_opt", "casadi"))
    print(f"cc {' '.join(FLAGS)}")
    print(table(["output", "one posture ns", "many, ns each"], nanoseconds(), ("", ".0f", ".0f")))


if __name__ == "__main__":
    main()
