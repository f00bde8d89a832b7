"""One position covariance of a UR10 with 30 sources, in a batch: nanoseconds each, side by side.

`python -m benchmarks.covariance`. All but posture_opt give the first order J Σ Jᵀ; posture_opt gives that and the
exact covariance. Everything is held against Pinocchio's first order.
"""

from __future__ import annotations

import argparse
import time
import tracemalloc
from collections.abc import Callable
from typing import Any

import numpy as np
import pinocchio as pin

from benchmarks import dh_ur10
from benchmarks.arms import Array
from benchmarks.machine import machine_line
from benchmarks.tables import table

Covariances = Callable[[Array], Array]  # postures (N, 6) -> (N, 3, 3) [m²]
CHUNK = 1000  # postures at once in NumPy: their Jacobians fit the cache


def pinocchio_loop() -> Covariances:
    model = dh_ur10.pinocchio_model()
    data, variances, last = model.createData(), dh_ur10.sigma() ** 2, model.njoints - 1

    def covariances(Q: Array) -> Array:
        C = np.empty((len(Q), 3, 3))
        for i, q in enumerate(dh_ur10.coordinates(Q)):
            pin.computeJointJacobians(model, data, q)
            J = pin.getJointJacobian(model, data, last, pin.LOCAL_WORLD_ALIGNED)[:3]
            C[i] = (J * variances) @ J.T
        return C

    return covariances


def roboticstoolbox_loop() -> Covariances:
    from roboticstoolbox import ET, ETS

    kinds = (ET.Rz, ET.tz, ET.tx, ET.Rx, ET.Ry)
    chain = ETS([kind(jindex=5 * i + k) for i in range(6) for k, kind in enumerate(kinds)])
    variances = dh_ur10.sigma() ** 2

    def covariances(Q: Array) -> Array:
        C = np.empty((len(Q), 3, 3))
        for i, q in enumerate(dh_ur10.coordinates(Q)):
            J = chain.jacob0(q)[:3]
            C[i] = (J * variances) @ J.T
        return C

    return covariances


def numpy_vectorised() -> Covariances:
    sigma = dh_ur10.sigma()

    def covariances(Q: Array) -> Array:
        C = np.empty((len(Q), 3, 3))
        for start in range(0, len(Q), CHUNK):
            L = _jacobians(Q[start : start + CHUNK]) * sigma
            C[start : start + CHUNK] = L @ L.transpose(0, 2, 1)
        return C

    return covariances


def _jacobians(Q: Array) -> Array:
    """Columns of all 30 sources at many postures, (N, 3, 30): z × r, z, x, x × r, y × r joint by joint."""
    N = len(Q)
    R, p = np.broadcast_to(np.eye(3), (N, 3, 3)).copy(), np.zeros((N, 3))
    axes, origins = np.empty((N, 30, 3)), np.empty((N, 30, 3))
    for i in range(6):
        axes[:, 5 * i], origins[:, 5 * i] = R[:, :, 2], p
        R = _turned(R, 0, 1, Q[:, i])
        axes[:, 5 * i + 1], axes[:, 5 * i + 2] = R[:, :, 2], R[:, :, 0]
        p = p + dh_ur10.D[i] * R[:, :, 2] + dh_ur10.A[i] * R[:, :, 0]
        axes[:, 5 * i + 3], origins[:, 5 * i + 3] = R[:, :, 0], p
        R = _turned(R, 1, 2, np.full(N, dh_ur10.ALPHA[i]))
        axes[:, 5 * i + 4], origins[:, 5 * i + 4] = R[:, :, 1], p
    J = axes.transpose(0, 2, 1).copy()
    turning = np.flatnonzero(np.isin(np.arange(30) % 5, (0, 3, 4)))
    r, z = (p[:, None] - origins[:, turning]).transpose(0, 2, 1), J[:, :, turning]
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):  # z × r; np.cross takes three times as long
        J[:, i, turning] = z[:, j] * r[:, k] - z[:, k] * r[:, j]
    return J


def _turned(R: Array, i: int, j: int, angle: Array) -> Array:
    """R times a rotation that takes axis i towards axis j."""
    c, s = np.cos(angle)[:, None], np.sin(angle)[:, None]
    turned = R.copy()
    turned[:, :, i] = c * R[:, :, i] + s * R[:, :, j]
    turned[:, :, j] = c * R[:, :, j] - s * R[:, :, i]
    return turned


def ours(compiled: bool, exact: bool) -> Covariances:
    import posture_opt as po

    spread: Any = po.SpreadFunction(po.problem_from_dict(dh_ur10.problem()), compiled=compiled)
    return spread if exact else spread.first_order


WAYS: dict[str, Callable[[], Covariances]] = {
    "posture_opt, compiled, exact": lambda: ours(compiled=True, exact=True),
    "posture_opt, compiled, first order": lambda: ours(compiled=True, exact=False),
    "posture_opt, interpreted, exact": lambda: ours(compiled=False, exact=True),
    "posture_opt, interpreted, first order": lambda: ours(compiled=False, exact=False),
    "NumPy vectorised": numpy_vectorised,
    "Pinocchio, Python loop": pinocchio_loop,
    "roboticstoolbox, Python loop": roboticstoolbox_loop,
}


def line(title: str, build: Callable[[], Covariances], Q: Array, truth: Array, repeats: int) -> list[Any]:
    """Median time and peak memory of one way, and its largest relative difference from Pinocchio's first order."""
    covariances = build()
    few = Q[: len(truth)]
    difference = np.abs(covariances(few) - truth).max() / np.abs(truth).max()
    seconds = []
    for _ in range(repeats):
        start = time.perf_counter()
        covariances(Q)
        seconds.append(time.perf_counter() - start)
    tracemalloc.start()
    covariances(Q)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return [title, 1e9 * float(np.median(seconds)) / len(Q), peak / 2**20, f"{difference:.1e}"]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=100_000, help="postures in the batch")
    parser.add_argument("--repeats", type=int, default=5)
    arguments = parser.parse_args()
    Q = np.random.default_rng(0).uniform(-np.pi, np.pi, (arguments.count, 6))
    truth = pinocchio_loop()(Q[:200])
    rows, skipped = [], []
    for title, build in WAYS.items():
        try:
            rows.append(line(title, build, Q, truth, arguments.repeats))
        except ImportError as error:
            skipped.append(f"{title}: skipped, {type(error).__name__}: {error}")
    print(machine_line("posture_opt", "casadi", "pin", "roboticstoolbox-python", "numpy"))
    print(f"UR10, 30 sources, {arguments.count} postures, median of {arguments.repeats}")
    headers = ["way", "ns a covariance", "peak MB", "difference from first order"]
    print(table(headers, rows, ("", ".0f", ".1f", "")))
    print("\n".join(skipped))


if __name__ == "__main__":
    main()
