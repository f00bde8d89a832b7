"""Posture selection side by side: smallest worst axis of the covariance across a vertical insertion.

Tool axis down, yaw free, joint limits hard, joint noise alone. Run with `python -m benchmarks.posture_selection`.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from benchmarks.arms import ARMS, Arm, Array
from benchmarks.judge import AXIS_TOLERANCE, LIMIT_TOLERANCE, POSITION_TOLERANCE, Verdict, judge
from benchmarks.machine import machine_line
from benchmarks.tables import table
from benchmarks.targets import Targets, draw
from benchmarks.ways import Solve, drake_snopt, eaik_sweep, ipopt_starts, ours, rtb_sampling, scipy_slsqp

PACKAGES = ("posture_opt", "roboticstoolbox-python", "pin", "scipy", "drake", "EAIK", "casadi", "numpy")


@dataclass
class Record:
    """What one way did with all targets: seconds and verdicts in the order of the targets."""

    title: str
    reference: bool
    wall: list[float] = field(default_factory=list)
    cpu: list[float] = field(default_factory=list)
    verdicts: list[Verdict | None] = field(default_factory=list)

    def run(self, solve: Solve, arm: Arm, position: Array) -> None:
        wall, cpu = time.perf_counter(), time.process_time()
        q = solve(position)
        self.wall.append(time.perf_counter() - wall)
        self.cpu.append(time.process_time() - cpu)
        self.verdicts.append(None if q is None else judge(arm, position, np.asarray(q, dtype=float)))

    @property
    def sigmas(self) -> Array:
        """(N,) worst standard deviations [m], infinite where no feasible posture was found."""
        return np.array([v.sigma if v is not None and v.feasible else np.inf for v in self.verdicts])


def ways(arm: Arm, quick: bool) -> tuple[list[tuple[Record, Solve]], list[str]]:
    """The ways that can run here, built, and the reasons why the others cannot."""
    built: list[tuple[Record, Solve]] = []
    skipped: list[str] = []
    for module in (ours, rtb_sampling, scipy_slsqp, drake_snopt):
        try:
            built.append((Record(module.TITLE, reference=False), module.build(arm)))
        except ImportError as error:
            skipped.append(f"{module.TITLE}: skipped, {type(error).__name__}: {error}")
    starts = 16 if quick else 64
    built.append((Record(f"reference: IPOPT, {starts} feasible starts", True), ipopt_starts.build(arm, starts)))
    if arm.analytic:
        steps = 180 if quick else 720
        built.append((Record(f"reference: EAIK, {steps} yaw steps", True), eaik_sweep.build(arm, steps)))
    return built, skipped


def measure(arm: Arm, targets: Targets, quick: bool) -> tuple[list[Record], list[str]]:
    """Every way at every target, in turns, so that a slow moment of the machine strikes them all alike."""
    built, skipped = ways(arm, quick)
    for _, solve in built:
        solve(targets.positions[0])  # first calls pay for lazy imports and allocations
    for i, position in enumerate(targets.positions):
        for record, solve in built:
            record.run(solve, arm, position)
        _progress(arm, i + 1, len(targets.positions))
    return [record for record, _ in built], skipped


def rows(records: list[Record]) -> list[list[Any]]:
    """A line a way: times, feasible, within 1 % of the best that any way found at that target, worst gap."""
    best = np.min([record.sigmas for record in records], axis=0)
    own = next((np.median(r.wall) for r in records if r.title == ours.TITLE), None)
    return [
        [
            record.title,
            1e3 * np.median(record.wall),
            1e3 * np.median(record.cpu),
            None if own is None else np.median(record.wall) / own,
            100 * np.mean(np.isfinite(record.sigmas)),
            100 * np.mean(record.sigmas <= 1.01 * best),
            100 * _worst_gap(record.sigmas, best),
        ]
        for record in records
    ]


def _worst_gap(sigmas: Array, best: Array) -> float:
    found = np.isfinite(sigmas)
    return float(np.max(sigmas[found] / best[found] - 1.0)) if found.any() else np.nan


def _progress(arm: Arm, done: int, count: int) -> None:
    if sys.stderr.isatty():
        print(f"\r{arm.name} {done}/{count}", end="\n" if done == count else "", file=sys.stderr, flush=True)


def report(arm: Arm, targets: Targets, records: list[Record], skipped: Iterable[str]) -> str:
    headers = ["way", "wall ms", "CPU ms", "to ours", "feasible %", "within 1 % of best %", "worst gap %"]
    times = table(headers, rows(records), ("", ".1f", ".1f", ".1f", ".0f", ".0f", ".2f"))
    head = f"{arm.name} at {arm.tip} ({arm.urdf}): {len(targets.positions)} targets, {targets.replaced} replaced"
    return "\n".join([head, times, *skipped])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--targets", type=int, default=50)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--arm", choices=[arm.name for arm in ARMS], help="one arm only")
    parser.add_argument("--quick", action="store_true", help="five targets, coarser references")
    arguments = parser.parse_args()
    print(machine_line(*PACKAGES))
    print(
        f"Medians over the targets. Feasible: position within {POSITION_TOLERANCE:.0e} m, axis within "
        f"{AXIS_TOLERANCE:.0e} rad, limits within {LIMIT_TOLERANCE:.0e} rad, by Pinocchio. Best: of all ways."
    )
    for arm in ARMS:
        if arguments.arm in (None, arm.name):
            targets = draw(arm, 5 if arguments.quick else arguments.targets, arguments.seed)
            print("\n" + report(arm, targets, *measure(arm, targets, arguments.quick)), flush=True)


if __name__ == "__main__":
    main()
