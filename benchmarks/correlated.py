"""What correlated joint errors cost in a batch of covariances, and how good its nodes are: side by side.

`python -m benchmarks.correlated`. Compiled `SpreadFunction` of a Panda and a UR10 with joint noise alone and with all
geometric errors, in turn for each kind of correlation, so that what else the machine does bears on all of them alike.
The ratio is to independent errors of the same arm; the error is the stated one, of the variance along any direction.
"""

from __future__ import annotations

import argparse
import time
from typing import Any

import numpy as np

import posture_opt as po
from benchmarks.machine import machine_line
from benchmarks.tables import table

SIGMA = {"theta": "0.02 deg", "d": "0.05 mm", "a": "0.05 mm", "alpha": "0.01 deg", "beta": "0.01 deg"}
Pairs = list[tuple[int, int, float]]


def correlations(n: int) -> dict[str, Pairs]:
    """Pairs of joints and their correlation; those of three pairs stand in a row or overlap along the chain."""
    return {
        "independent": [],
        "one pair, neighbours": [(1, 2, 0.8)],
        "one pair, first and last": [(0, n - 1, 0.8)],
        "three pairs in a row": [(0, 1, 0.8), (2, 3, 0.7), (4, 5, 0.5)],
        "three pairs that overlap": [(0, 3, 0.8), (1, 4, 0.7), (2, 5, 0.5)],
        "all joints alike": [(i, j, 0.5) for i in range(n) for j in range(i)],
    }


def problem(preset: str, uncertainty: dict[str, Any]) -> Any:
    """The content of a problem file about a preset arm, read."""
    content = {"name": preset, "robot": {"kind": "preset", "name": preset}, "task": {"kind": "insert"}}
    return po.problem_from_dict(content | ({"uncertainty": uncertainty} if uncertainty else {}))


def spread_function(preset: str, parameters: tuple[str, ...], pairs: Pairs) -> Any:
    """The compiled function for errors of the named kinds with correlated joints."""
    arm = problem(preset, {}).robot
    named = [name.split(".") for name in arm.parameters]
    sigma = {f"{owner}.{kind}": SIGMA[kind] for owner, kind in named if owner in arm.joint_names and kind in parameters}
    driven = [f"{joint}.theta" for joint in arm.joint_names]
    correlation = [[driven[i], driven[j], rho] for i, j, rho in pairs]
    uncertainty = {"sigma": sigma} | ({"correlation": correlation} if correlation else {})
    return po.SpreadFunction(problem(preset, uncertainty), compiled=True)


def rows(preset: str, parameters: tuple[str, ...], count: int, repeats: int) -> list[list[Any]]:
    """Name, nanoseconds a covariance, ratio to independent errors and stated error of each kind."""
    n = problem(preset, {}).robot.n
    functions = {kind: spread_function(preset, parameters, pairs) for kind, pairs in correlations(n).items()}
    Q = np.random.default_rng(0).uniform(-2, 2, (count, n))
    seconds: dict[str, list[float]] = {kind: [] for kind in functions}
    for _ in range(repeats + 1):
        for kind, function in functions.items():
            start = time.process_time()
            function(Q)
            seconds[kind].append(time.process_time() - start)
    fastest = {kind: min(times[1:]) / count for kind, times in seconds.items()}  # the first one warms the cache
    sources = "joint noise" if len(parameters) == 1 else "all errors"
    return [
        [f"{preset}, {sources}, {kind}", 1e9 * t, t / fastest["independent"], f"{functions[kind].relative_error:.0e}"]
        for kind, t in fastest.items()
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=50_000, help="postures in the batch")
    parser.add_argument("--repeats", type=int, default=7)
    arguments = parser.parse_args()
    found = [
        row
        for preset in ("ur10", "panda")
        for parameters in (("theta",), tuple(SIGMA))
        for row in rows(preset, parameters, arguments.count, arguments.repeats)
    ]
    print(machine_line("posture_opt", "casadi", "numpy"))
    print(f"{arguments.count} postures, the fastest of {arguments.repeats} turns, CPU time")
    print(
        table(["arm, errors, correlations", "ns a covariance", "ratio", "stated error"], found, ("", ".0f", ".2f", ""))
    )


if __name__ == "__main__":
    main()
