"""Which instrument is worth what: a UR10 of hidden errors calibrated with each, judged at postures it has not seen.

`python -m benchmarks.instruments`, some minutes; `--draws 4 --counts 60` for a look. The errors of each arm are normal,
0.5 mm and 0.5 mrad in every parameter; the simulator is the tests' own. The table of docs/how-to/instruments/which.md.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import least_squares

import posture_opt as po
from benchmarks.machine import machine_line
from benchmarks.tables import table
from posture_opt.calibration.calibration import Calibration
from tests.helpers.cameras import camera_problem, camera_table
from tests.helpers.instruments import (
    JOINTS,
    TrueArm,
    distance_table,
    misplaced,
    plane_table,
    postures,
    socket_table,
    table_of,
    tracker_table,
)

Maker = Callable[[TrueArm, np.random.Generator, int], dict[str, Any]]
TOOL = {"xyz": ["30 mm", "-20 mm", "120 mm"], "rpy": ["0 deg", "0 deg", "0 deg"]}


@dataclass(frozen=True)
class Instrument:
    """An instrument: what it is called, how its rows are simulated for so many postures, and its σ's."""

    title: str
    rows: Maker
    sigma: dict[str, str]
    camera: bool = False

    def problem(self, folder: Path) -> po.Problem:
        """The arm as the file states it: the tool is free, but where a board of unknown pose takes its place."""
        if self.camera:
            return po.problem_from_dict(camera_problem(folder), folder)
        robot = {"kind": "preset", "name": "ur10", "tool": {**TOOL, "free": True}}
        robot |= {"base": "free"} if "tracker" in self.title else {}
        return po.problem_from_dict({"robot": robot, "uncertainty": {"measurement": self.sigma}})


INSTRUMENTS = (
    Instrument(
        "tracker, 0.02 mm", lambda arm, rng, n: tracker_table(arm, rng, n, 2e-5, np.eye(4)), {"position": "0.02 mm"}
    ),
    Instrument("3 planes, 0.02 mm", lambda arm, rng, n: plane_table(arm, rng, n // 3, 2e-5, 0.0), {"plane": "0.02 mm"}),
    Instrument(
        "bar, 4 anchors, 0.005 mm", lambda arm, rng, n: distance_table(arm, rng, n // 4, 5e-6), {"distance": "0.005 mm"}
    ),
    Instrument("camera, 0.2 px", lambda arm, rng, n: camera_table(arm, rng, n, 0.2), {}, camera=True),
    Instrument("4 sockets, 0.1 mm", lambda arm, rng, n: socket_table(arm, rng, n // 4, 1e-4), {"position": "0.1 mm"}),
)


@dataclass(frozen=True)
class Judged:
    """One calibration: task error before and after [mm], coverage of parameters and of the tool, cost of scipy."""

    before: float
    after: float
    parameters: float
    tool: float
    determined: int
    unknowns: int
    worse_than_scipy: float


def judged(found: Calibration, arm: TrueArm, given: po.Problem, against_scipy: bool) -> Judged:
    """A calibration held against the truth at 60 other postures, the base aligned to them.

    Where the tool was no unknown, a board of unknown pose stood for it: its offset is aligned too.
    """
    q = postures(np.random.default_rng(99), 60)
    truth = arm.point(q)
    errors = []
    for x in (found.x_nominal, found.x):
        values = {f"tool.{axis}": v for axis, v in zip("xyz", (0.03, -0.02, 0.12), strict=True)}
        values |= {p.name: p.nominal + v for p, v in zip(found.parameters, x, strict=True)}
        errors.append(1e3 * misplaced(values, q, truth, tool="tool.x" not in {p.name for p in found.parameters}))
    own = [i for i, p in enumerate(found.parameters) if p.group == "geometry" and np.isfinite(found.std[i])]
    z = [(found.x[i] - arm.error_of(found.parameters[i].name)) / found.std[i] for i in own if found.std[i] > 0]
    geometry = [i for i, p in enumerate(found.parameters) if p.group == "geometry"]
    return Judged(
        errors[0], errors[1], float(np.mean(np.abs(z) < 1.96)),
        np.nan if found.request.data.lever is not None else _tool_coverage(found, given, q, truth),
        int(found.fixed[geometry].sum()), len(geometry), _above_scipy(found, arm) if against_scipy else np.nan,
    )  # fmt: skip


def _tool_coverage(found: Calibration, given: po.Problem, q: np.ndarray, truth: np.ndarray) -> float:
    """Share of distances between tool points that are in their stated 95 % interval: no frame is in these."""
    rows = {f"{axis} [m]": truth[:, i] for i, axis in enumerate("xyz")}
    own = [i for i, p in enumerate(found.parameters) if p.group != "place"]
    parameters = tuple(found.parameters[i] for i in own)
    there = replace(found.residuals, parameters=parameters, place_sigmas={}, distances=(), further={}, lever=1.0)
    there = there.of_data(po.read_measurements(table_of(q, **rows), given))
    x, C = found.x[own], found.covariance[np.ix_(own, own)]
    points = np.stack([np.broadcast_to(v, len(q)) for v in there.walk(x).position], axis=1)
    J = np.stack(there.reading_shifts([p.source for p in parameters], x), axis=-1)
    i, j = np.triu_indices(len(q), 1)
    apart = points[i] - points[j]
    length = np.linalg.norm(apart, axis=1)
    g = np.einsum("nc,nck->nk", apart / length[:, None], J[i] - J[j])
    std = np.sqrt(np.einsum("nk,kl,nl->n", g, C, g))
    return float(np.mean(np.abs(length - np.linalg.norm(truth[i] - truth[j], axis=1)) < 1.96 * std))


def _above_scipy(found: Calibration, arm: TrueArm) -> float:
    """How far the minimum found is above scipy's, of the same residuals from the true arm; relative."""
    fit = found.fit
    used = fit.residuals.take(np.flatnonzero(fit.kept))
    known = np.zeros((0, len(fit.x))) if fit.prior is None else fit.weight * fit.prior.matrix(len(fit.x))

    def residuals(z: np.ndarray) -> np.ndarray:
        x = fit.x + fit.directions @ z
        return np.concatenate([used.whitened(x), known @ x])

    def slope(z: np.ndarray) -> np.ndarray:
        x = fit.x + fit.directions @ z
        return np.concatenate([used.residuals_and_jacobian(x)[1], known]) @ fit.directions

    geometry = [p.group == "geometry" for p in found.parameters]
    true = np.where(
        geometry, [arm.error_of(p.name) if g else 0.0 for p, g in zip(found.parameters, geometry, strict=True)], fit.x
    )
    start = np.linalg.lstsq(fit.directions, true - fit.x, rcond=None)[0]
    best = least_squares(residuals, start, slope, x_scale="jac", xtol=1e-12, ftol=1e-12, gtol=1e-12).cost
    return float(0.5 * np.sum(residuals(np.zeros(len(start))) ** 2) / best - 1)


def main() -> None:
    """One row an instrument and number of postures: medians of errors, means of shares."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--draws", type=int, default=20)
    parser.add_argument("--counts", type=int, nargs="+", default=[48, 60, 120])
    parser.add_argument("--only", nargs="*", default=[])
    asked = parser.parse_args()
    rows = []
    for one in INSTRUMENTS:
        if asked.only and not any(word in one.title for word in asked.only):
            continue
        for n in asked.counts:
            with tempfile.TemporaryDirectory() as folder:
                rows.append(_row(one, n, asked.draws, Path(folder)))
            print(rows[-1], flush=True)
    print(machine_line("posture_opt", "numpy", "scipy"))
    titles = ["instrument", "postures", "before mm", "after mm", "parameters in 95 %", "tool in 95 %", "determined"]
    formats = ("", "d", ".3f", ".3f", ".0%", ".0%", "", ".0e")
    print(table([*titles, "above scipy"], rows, formats))


def _row(one: Instrument, n: int, draws: int, folder: Path) -> list[Any]:
    """The row of an instrument at n postures, over some draws of arms; scipy is asked at the first two."""
    given, found = one.problem(folder), []
    for seed in range(1000, 1000 + draws):
        rng = np.random.default_rng(seed)
        arm = TrueArm.drawn(rng)
        rows = {k: v for k, v in one.rows(arm, rng, n).items() if k.removesuffix(".approach") not in JOINTS}
        data = po.read_measurements(rows, given)
        found.append(judged(po.calibrate(given, data, plan=False), arm, given, seed < 1002))
    values = {name: np.array([getattr(f, name) for f in found]) for name in Judged.__dataclass_fields__}
    return [
        one.title, n, float(np.median(values["before"])), float(np.median(values["after"])),
        float(np.mean(values["parameters"])), float(np.mean(values["tool"])),
        f"{np.median(values['determined']):.0f} of {found[0].unknowns}", float(np.nanmax(values["worse_than_scipy"])),
    ]  # fmt: skip


if __name__ == "__main__":
    main()
