"""What each threshold of a search is worth: ``python -m benchmarks.ablation [--seed N] [--real FOLDER] [--only TEXT]``.

Every threshold is halved, doubled or removed, one at a time, and the search repeated on the same fresh draws of the
hidden tests and on real measurements: hits, extra names, false alarms, and errors of rows left out. Differences are
paired, with their standard error.
"""

from __future__ import annotations

import argparse
import math
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import posture_opt as po
from benchmarks.machine import machine_line
from posture_opt.diagnosis.scores import levels
from posture_opt.diagnosis.scores.candidates import LinearisedData, linearise_calibration
from posture_opt.diagnosis.search.search import SearchResult, remaining_unnamed, search_effects
from tests.hidden.draw import OutOfReach, draw
from tests.hidden.files import write

FAMILIES = {"full": 5, "narrow": 5, "two": 6, "outside": 4, "clean": 4}
"""Family of hidden draws and how many of it."""
REAL = {
    "WAM": ("jacobi_wam/problem.yaml", "jacobi_wam/grid.csv"),
    "kuka_14": ("mukca_sockets/problem_iiwa.yaml", "mukca_sockets/kuka_14.csv"),
    "panda_4": ("mukca_sockets/problem_panda_4.yaml", "mukca_sockets/panda_4.csv"),
}
"""Real set, problem and data under the folder."""


def _scaled(name: str, *factors: float) -> dict[str, dict[str, Any]]:
    value = getattr(levels, name)
    return {f"{name} × {f:g}": {name: type(value)(value * f)} for f in factors}


def _set(name: str, *values: Any) -> dict[str, dict[str, Any]]:
    return {f"{name} = {v:g}": {name: v} for v in values}


VARIANTS: dict[str, dict[str, Any]] = {
    "as it is": {},
    **_scaled("EFFECT_LEVEL", 0.5, 2),
    "FAMILY_SHARES equal": {"FAMILY_SHARES": dict.fromkeys(levels.FAMILY_SHARES, 0.25)},
    **_set("SIGN_FLIPS", 99),
    **_set("LARGE_GROUP_SIZE", 2, 1000),
    **_set("CHOICE_PENALTY", 0.0, 10.0),
    **_scaled("RIVAL_CRITERION", 0.5, 2),
    **_set("MIN_RIVAL_COSINE", 0.25, 0.9),
    **_scaled("MIN_DISTINCT_SHARE", 0.2, 5),
    **_set("MAX_EXCHANGED_EFFECTS", 0),
    **_scaled("MIN_SURVIVING_SHARE", 0.5, 2),
}
"""Levels that each variant sets."""


@dataclass(frozen=True)
class Case:
    """One set of measurements, ready for a search; ``truth`` of a hidden draw, ``None`` of real ones."""

    name: str
    problem: Any
    data: Any
    truth: list[tuple[str, str]] | None = None


def hidden_cases(seed: int) -> Iterator[Case]:
    """Fresh draws of the hidden tests."""
    for family, count in FAMILIES.items():
        found, index = 0, 0
        while found < count:
            index += 1
            try:
                drawn = draw(seed, family, index, weakest=25.0)
            except OutOfReach:
                continue
            found += 1
            with tempfile.TemporaryDirectory() as folder:
                write(drawn, Path(folder))
                problem = po.load_problem(Path(folder) / "problem.yaml")
                data = po.read_measurements(Path(folder) / "data.csv", problem)
            truth = [(e["kind"], e["target"]) for e in drawn.truth["effects"]]
            yield Case(family, problem, data, truth)


def real_cases(folder: Path) -> Iterator[Case]:
    """Real sets that are there."""
    for name, (problem_file, file) in REAL.items():
        if (folder / file).exists():
            problem = po.load_problem(folder / problem_file)
            yield Case(name, problem, po.read_measurements(folder / file, problem))


def figures(case: Case, linearised: LinearisedData, found: SearchResult) -> dict[str, float]:
    """What one search is judged by: hits, extra names, alarms, or the RMS of rows left out [mm]."""
    model = found.names or found
    names = [(s.kind, s.target) for s in model.chosen if s.named]
    if case.truth is None:
        losses = model.nested.each[0].losses
        return {"RMS": 1e3 * math.sqrt(losses[min(model.size, len(losses) - 1)].mean()), "causes": float(len(names))}
    unnamed = bool(remaining_unnamed(linearised, found))
    if case.name == "clean":
        return {"false alarms": float(bool(names) or unnamed)}
    if case.name == "outside":
        return {"unexplained": float(unnamed), "wrong names": float(bool(names) and not unnamed)}
    sets = [{(s.kind, s.target), *((r.kind, r.target) for r in rivals)}
            for s, rivals in zip(model.chosen, model.rivals, strict=True)]  # fmt: skip
    hit = bool(sets) and bool(sets[0] & set(case.truth))
    exact = set(case.truth) <= set().union(*sets) and all(s & set(case.truth) for s in sets) and not unnamed
    return {"first": float(hit), "all and no more": float(exact), "rivals": float(sum(len(s) - 1 for s in sets))}


def run(cases: list[Case], prepare: Callable[[Case], LinearisedData], change: dict[str, Any]) -> list[dict[str, float]]:
    """The figures of every case with some levels changed."""
    former = {name: getattr(levels, name) for name in change}
    for name, value in change.items():
        setattr(levels, name, value)
    try:
        found = []
        for case in cases:
            linearised = prepare(case)
            found.append(figures(case, linearised, search_effects(linearised)))
        return found
    finally:
        for name, value in former.items():
            setattr(levels, name, value)


def line(cases: list[Case], base: list[dict[str, float]], now: list[dict[str, float]]) -> str:
    """One row of the table: mean of each figure, and its paired difference where it moved."""
    cells = []
    for key in ("first", "all and no more", "rivals", "false alarms", "unexplained", "wrong names"):
        pairs = [(n[key], b[key]) for n, b in zip(now, base, strict=True) if key in b]
        mean = float(np.mean([n for n, _ in pairs]))
        d = np.array([n - b for n, b in pairs])
        error = float(d.std(ddof=1) / math.sqrt(len(d))) if np.any(d) else 0.0
        cells.append(f"{mean:.2f}" + (f" ({d.mean():+.2f} ± {error:.2f})" if np.any(d) else ""))
    for case, b, n in zip(cases, base, now, strict=True):
        if case.truth is None:
            cells.append(f"{n['RMS']:.3f}, {n['causes']:.0f}" + (" *" if abs(n["RMS"] - b["RMS"]) > 1e-4 else ""))
    return " | ".join(cells)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=31)
    parser.add_argument("--real", type=Path, default=Path())
    parser.add_argument("--only", default="")
    options = parser.parse_args()
    cases = [*hidden_cases(options.seed), *real_cases(options.real)]
    calibrated = {id(case): po.calibrate(case.problem, case.data) for case in cases}

    def prepare(case: Case) -> LinearisedData:
        return linearise_calibration(calibrated[id(case)], levels.SIGN_FLIPS)

    print(machine_line("numpy", "scipy"))
    head = ["variant", "first name", "all and no more", "rivals a case", "false alarms", "unexplained", "wrong names"]
    head += [f"{case.name} [mm], causes" for case in cases if case.truth is None]
    print("| " + " | ".join(head) + " |\n|" + "---|" * len(head))
    base = run(cases, prepare, {})
    for name, change in VARIANTS.items():
        if not change or options.only in name:
            now = run(cases, prepare, change) if change else base
            print(f"| {name} | {line(cases, base, now)} |", flush=True)


if __name__ == "__main__":
    main()
