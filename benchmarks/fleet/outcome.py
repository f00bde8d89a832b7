"""What the program makes of one case, judged against the best known."""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

import posture_opt as po
from benchmarks.fleet.brute import Best, better, brute_force
from benchmarks.fleet.cases import Case
from benchmarks.fleet.judge import judge
from benchmarks.fleet.requirements import Requirements
from benchmarks.fleet.store import Store
from posture_opt.errors import NoSolutionError, PostureOptError

EQUAL_MISS = float(np.log(1e-12))  # probabilities below are as good as none
OPTIMAL = 1e-3  # of a gap: an answer that is as good as the best known is optimal


@dataclass(frozen=True)
class Outcome:
    """One answer to one case.

    Args:
        way: ``solve`` or ``select_posture``.
        gap: relative to the best known, of the standard deviation or of the probability to miss; NaN for no answer.
        violations: what the judge found violated, and whether the axis was let go.
        cpu: seconds of a repeated solve.
        warnings: what the solve wrote to standard error.
    """

    key: str
    arm: str
    task: str
    joints: int
    way: str
    status: str
    value: float
    best: float
    gap: float
    violations: tuple[str, ...]
    cpu: float
    hits: int
    rounds: int
    limits_hit: int
    posture: tuple[float, ...]
    best_posture: tuple[float, ...]
    warnings: str


Way = Callable[[Case], tuple[po.Solution, float]]


def quick(compiled: bool | None) -> Way:
    """`PostureSelector.solve`, timed at its second call."""

    def solve(case: Case) -> tuple[po.Solution, float]:
        selector = po.PostureSelector(po.problem_from_dict(case.document), compiled=compiled)
        solution = selector.solve(ordinary=0.0)
        began = time.process_time()
        selector.solve(ordinary=0.0)
        return solution, time.process_time() - began

    return solve


def thorough(case: Case) -> tuple[po.Solution, float]:
    """`select_posture`."""
    began = time.process_time()
    solution = po.select_posture(po.problem_from_dict(case.document), ordinary=0.0)
    return solution, time.process_time() - began


def best_known(target: Requirements, store: Store, rounds: int) -> Best:
    """From the store, or by brute force; the posture that made the target is a reachable answer, so there is one."""
    known = store.read(target.case)
    if known is not None and known.rounds >= rounds:
        return known
    found = brute_force(target, seed=known.rounds if known else 0, least_rounds=rounds)
    best = min((b for b in (known, found) if b is not None), key=lambda b: b.value, default=None)
    if best is None:
        raise RuntimeError(f"{target.case.key}: the brute force found nothing")
    store.write(target.case, best)
    return best


def run(case: Case, name: str, way: Way, store: Store, rounds: int) -> Outcome:
    """The program's answer beside the best known, which it lowers where it is better."""
    target = Requirements(case)
    best = best_known(target, store, rounds)
    q, status, cpu = np.array([]), "", np.nan
    with _standard_error() as written:
        try:
            solution, cpu = way(case)
            q, status = solution.q, solution.status
        except NoSolutionError:
            status = "infeasible"
        except PostureOptError as error:
            status = f"{type(error).__name__}: {error}"
    value, violations = np.nan, ()
    if len(q):
        judged = judge(target, q)
        value = judged.value
        names = {"position": judged.position > 2e-6, "limits": judged.limits > 1e-6, "axis": not judged.axis_met}
        violations = tuple(name for name, broken in names.items() if broken)
        if judged.met and value < best.value:
            # A brute force that was beaten clearly has not found the basin: no round of its own ended there.
            beaten = better(best.value, value, case.setup.task.criterion) > OPTIMAL
            best = Best(value, tuple(q.tolist()), best.rounds, 0 if beaten else best.hits)
            store.write(case, best)
    return _outcome(case, name, status, value, best, violations, cpu, q, written[0])


def _outcome(
    case: Case,
    way: str,
    status: str,
    value: float,
    best: Best,
    violations: tuple[str, ...],
    cpu: float,
    q: np.ndarray,
    warnings: str,
) -> Outcome:
    criterion, (lower, upper) = case.setup.task.criterion, case.setup.limits
    low, high = (max(v, EQUAL_MISS) if criterion == "miss" else v for v in (best.value, value))
    at = np.array(best.q)
    return Outcome(
        key=case.key,
        arm=case.setup.arm.name,
        task=case.setup.task.name,
        joints=case.setup.model.robot.n,
        way=way,
        status=status,
        value=value,
        best=best.value,
        gap=better(high, low, criterion) if len(q) else np.nan,
        violations=violations,
        cpu=cpu,
        hits=best.hits,
        rounds=best.rounds,
        limits_hit=int(np.sum((at < lower + 1e-6) | (at > upper - 1e-6))),
        posture=tuple(q.tolist()),
        best_posture=best.q,
        warnings=warnings,
    )


@contextmanager
def _standard_error() -> Iterator[list[str]]:
    """What C and Python write to standard error meanwhile, in the list's only entry afterwards."""
    written = [""]
    kept = os.dup(2)
    with tempfile.TemporaryFile() as file:
        os.dup2(file.fileno(), 2)
        try:
            yield written
        finally:
            os.dup2(kept, 2)
            os.close(kept)
            file.seek(0)
            written[0] = file.read().decode(errors="replace")[:2000]
