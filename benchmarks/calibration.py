"""Calibration of a UR10 from simulated poses: seconds of the whole answer, and of one fit beside SciPy's.

`python -m benchmarks.calibration`. The whole answer is the fit, the cross-validation (ten more fits), outliers,
identifiability and errors. SciPy solves the same least squares problem in the directions that are determined, once
with the same derivatives and once by differences, as one would who has no Jacobian.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.optimize import least_squares

import posture_opt as po
from benchmarks.arms import Array
from benchmarks.machine import machine_line
from benchmarks.tables import table
from posture_opt.calibration.assumptions.frames import arm_and_data, fit_frames
from posture_opt.calibration.estimation.fit import estimate_parameters
from posture_opt.calibration.estimation.fit_setup import determine_directions

# d, a, alpha of the UR10 (Universal Robots, "DH parameters for calculations of kinematics and dynamics")
TABLE = [
    (0.1273, 0.0, np.pi / 2), (0.0, -0.612, 0.0), (0.0, -0.5723, 0.0),
    (0.163941, 0.0, np.pi / 2), (0.1157, 0.0, -np.pi / 2), (0.0922, 0.0, 0.0),
]  # fmt: skip
NOISE = 2e-5  # m
OFF = 5e-4  # rad and m: how far the simulated arm is off its table


def problem() -> Any:
    joints = [
        {"name": f"j{i}", "type": "revolute", "d": f"{d} m", "a": f"{a} m", "alpha": f"{alpha} rad"}
        for i, (d, a, alpha) in enumerate(TABLE, 1)
    ]
    robot = {"kind": "dh", "joints": joints, "base": "free", "tool": "free"}
    return po.problem_from_dict({"robot": robot, "uncertainty": {"measurement": {"position": "0.02 mm"}}})


def measurements(task: Any, n: int) -> Any:
    """Points of an arm with hidden errors, its base and tool somewhere, by plain matrices."""
    rng = np.random.default_rng(0)
    q = rng.uniform(-2.5, 2.5, (n, 6))
    T = np.tile(np.eye(4), (n, 1, 1))
    for (d, a, alpha), angle, e in zip(TABLE, q.T, rng.normal(0, OFF, (6, 4)), strict=True):
        c, s, ca, sa = np.cos(angle + e[0]), np.sin(angle + e[0]), np.cos(alpha + e[3]), np.sin(alpha + e[3])
        zero, one = np.zeros(n), np.ones(n)
        link = np.array(
            [
                [c, -s * ca, s * sa, (a + e[2]) * c],
                [s, c * ca, -c * sa, (a + e[2]) * s],
                [zero, one * sa, one * ca, one * (d + e[1])],
                [zero, zero, zero, one],
            ]
        )
        T = T @ np.moveaxis(link, -1, 0)
    points = (T @ [0.03, -0.05, 0.12, 1.0])[:, :3] @ np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1.0]]).T + [1.2, -0.4, 0.3]
    points = points + rng.normal(0, NOISE, (n, 3))
    columns = {f"j{i + 1} [rad]": q[:, i] for i in range(6)} | {f"{x} [m]": points[:, i] for i, x in enumerate("xyz")}
    return po.read_measurements(columns, task)


def timed(call: Callable[[], Any], runs: int) -> tuple[float, Any]:
    """Median seconds, and the last answer."""
    seconds = []
    for _ in range(runs):
        start = time.perf_counter()
        answer = call()
        seconds.append(time.perf_counter() - start)
    return float(np.median(seconds)), answer


def row(n: int, runs: int) -> list[Any]:
    task = problem()
    data = measurements(task, n)
    whole, _ = timed(lambda: po.calibrate(task, data), runs)
    residuals, _ = arm_and_data(task, data)
    x0 = fit_frames(residuals)
    known = determine_directions(task, residuals, x0, None, False)
    D = known.directions

    def function(z: Array) -> Array:
        return residuals.whitened(x0 + D @ z)

    def jacobian(z: Array) -> Array:
        return residuals.residuals_and_jacobian(x0 + D @ z)[1] @ D

    zero = np.zeros(D.shape[1])
    ours, found = timed(lambda: estimate_parameters(residuals, x0, D, robust=False), runs)
    same, theirs = timed(lambda: least_squares(function, zero, jacobian, method="lm", x_scale="jac"), runs)
    differences, _ = timed(lambda: least_squares(function, zero, method="lm", x_scale="jac"), 1)
    apart = np.max(np.abs(found.x - x0 - D @ theirs.x) / np.sqrt(np.diag(found.covariance).clip(1e-30)))
    return [n, D.shape[1], whole, ours, same, same / ours, differences / ours, apart]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--poses", type=int, nargs="+", default=[100, 1000, 11911])
    parser.add_argument("--runs", type=int, default=3)
    given = parser.parse_args()
    print(machine_line("posture_opt", "numpy", "scipy"))
    headers = [
        "poses", "unknowns", "whole answer [s]", "one fit [s]", "SciPy lm [s]", "ratio", "ratio without Jacobian",
        "apart [std. errors]",
    ]  # fmt: skip
    rows = [row(n, given.runs) for n in given.poses]
    print(table(headers, rows, ("d", "d", ".2f", ".3f", ".3f", ".1f", ".0f", ".1e")))


if __name__ == "__main__":
    main()
