"""What the levels of a whole diagnosis decide: ``python -m benchmarks.decision_ablation [--seed N] [--only TEXT]``.

Each level of noise, geometry, lack of fit, unnamed components and discrimination is halved and doubled, one at a time,
and the diagnosis of the same fresh hidden draws repeated. A row of the table lists the draws whose answer changed: the
verdict, the causes with their rivals and status, or the measurements of the plan. Levels that act after the search
reuse one search per draw. One process, about six CPU minutes.
"""

from __future__ import annotations

import argparse
import tempfile
import time
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import posture_opt as po
from benchmarks.machine import machine_line
from posture_opt.diagnosis import diagnose as stages
from posture_opt.diagnosis.scores import levels
from tests.hidden.draw import OutOfReach, draw
from tests.hidden.files import write
from tests.hidden.score import score

Change = Mapping[str, Any]

FAMILIES = (
    *("few_poses", "planar", "scara", "narrow", "two"),
    *("joint_noise", "range_noise", "stated_sigma", "outliers"),
    *("geometry", "outside", "shape_often", "clean"),
)
"""Families of hidden draws, one draw of each: effects, noise, and the rest."""
SCALED = ("LACK_OF_FIT_LEVEL", "GEOMETRY_LEVEL", "NOISE_LEVEL", "FURTHER_NOISE_LEVEL", "MIN_REPEAT_FREEDOM")
"""Levels that act after the search."""
PLANNED = ("DISCRIMINATED_LAMBDA",)
"""Levels of the plan that discriminates rivals."""
PLANNED_FAMILY = "narrow_unloaded"
"""A family whose first draw has a cause with rivals that postures discriminate."""
UNEXPLAINED = ("outside", "shape_often")
"""Families whose errors are in no catalogue: leaving them unexplained is right."""
SEARCHED: dict[str, Change] = {
    "PREFERRED_SHARE = 0.7": {"PREFERRED_SHARE": 0.7},
    "PREFERRED_SHARE = 0.95": {"PREFERRED_SHARE": 0.95},
}
"""Levels of the search, which is repeated for them."""


@dataclass(frozen=True, eq=False)
class HiddenCase:
    """One hidden draw as files hand it over, and its truth."""

    family: str
    problem: Any
    data: Any
    truth: dict[str, Any]


@dataclass(frozen=True)
class Decision:
    """What one diagnosis decided: comparable as a whole.

    Args:
        answer: verdict; kind, target, status and rivals of each cause; where something is left unexplained.
        right: whether truth and answer agree, rivals included.
        planned: by effect, the measurements that discriminate it from its rivals.
    """

    answer: tuple[Any, ...]
    right: bool
    planned: tuple[Any, ...] = ()


def hidden_cases(seed: int, families: Sequence[str] = FAMILIES) -> list[HiddenCase]:
    """The first draw of each family whose effects have a noncentrality λ of 25 at least."""
    found = []
    for family in families:
        for index in range(20):
            try:
                drawn = draw(seed, family, index, weakest=25.0)
            except OutOfReach:
                continue
            with tempfile.TemporaryDirectory() as folder:
                write(drawn, Path(folder))
                problem = po.load_problem(Path(folder) / "problem.yaml")
                data = po.read_measurements(Path(folder) / "data.csv", problem)
            found.append(HiddenCase(family, problem, data, drawn.truth))
            break
    return found


def decision(case: HiddenCase, planned: bool) -> Decision:
    """The diagnosis of one case, reduced to what it decides."""
    found = stages.diagnose(case.problem, case.data, plan=False)
    effects = [finding.to_json() for finding in found.effects]
    rivals = [sorted((r["kind"], r["target"]) for r in e["confounded_with"]) for e in effects]
    named = tuple((e["kind"], e["target"], e["status"], *r) for e, r in zip(effects, rivals, strict=True))
    inside = score(case.truth, {"verdict": found.verdict, "effects": effects})["inside"]
    right = found.verdict == "unexplained" if case.family in UNEXPLAINED else inside
    split = found.split if planned else None
    plan = () if split is None else (tuple(sorted(split.counts.items())), len(split.rows))
    places = found.unexplained_places if found.verdict == "unexplained" else ()
    return Decision((found.verdict, named, places), bool(right), plan)


class SharedSearch:
    """`diagnose` with calibration and search of each case done once, for levels that act after them."""

    def __init__(self) -> None:
        self.calibrate, self.search = stages.calibrate, stages._search_effects
        self.known: dict[int, tuple[Any, Any]] = {}

    def __enter__(self) -> SharedSearch:
        stages.calibrate = self._calibrated  # type: ignore[assignment]
        stages._search_effects = self._found
        return self

    def __exit__(self, *_: object) -> None:
        stages.calibrate, stages._search_effects = self.calibrate, self.search

    def _calibrated(self, problem: Any, data: Any, **options: Any) -> Any:
        if id(problem) not in self.known:
            self.known[id(problem)] = self.calibrate(problem, data, **options), None
        self._last = id(problem)
        return self.known[id(problem)][0]

    def _found(self, calibration: Any, draws: int, seed: int, steps: Any) -> Any:
        known, result = self.known[self._last]
        if result is None:
            result = self.search(calibration, draws, seed, steps)
            self.known[self._last] = known, result
        return result


def decisions(cases: Sequence[HiddenCase], change: Change, planned: bool = False) -> list[Decision]:
    """The decisions of all cases with some levels changed."""
    former = {name: getattr(levels, name) for name in change}
    for name, value in change.items():
        setattr(levels, name, value)
    try:
        return [decision(case, planned) for case in cases]
    finally:
        for name, value in former.items():
            setattr(levels, name, value)


def scaled(name: str, factor: float) -> Change:
    """A level, or each of a tuple, times a factor; counts stay whole numbers."""
    value = getattr(levels, name)
    more = tuple(v * factor for v in value) if isinstance(value, tuple) else type(value)(value * factor)
    return {name: more}


def row(name: str, cases: Sequence[HiddenCase], base: Sequence[Decision], now: Sequence[Decision]) -> str:
    """How many answers are right, and the cases that changed, with what they say now."""
    changed = [f"{case.family}: {_difference(b, n)}" for case, b, n in zip(cases, base, now, strict=True) if b != n]
    return f"| {name} | {sum(n.right for n in now)} of {len(now)} | {'; '.join(changed) or 'nothing'} |"


def _difference(base: Decision, now: Decision) -> str:
    parts = [f"{a} -> {b}" for a, b in zip(base.answer, now.answer, strict=True) if a != b]
    parts += [f"plan {base.planned} -> {now.planned}"] if base.planned != now.planned else []
    return ", ".join([*parts, *(["right now"] if now.right > base.right else []),
                      *(["wrong now"] if now.right < base.right else [])])  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=83)
    parser.add_argument("--only", default="")
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    cases, start = hidden_cases(options.seed), time.process_time()
    print(machine_line("numpy", "scipy"))
    print("| level | right | what changes |\n|---|---|---|")
    with SharedSearch():
        base = decisions(cases, {})
        print(row("as it is", cases, base, base), flush=True)
        for name in filter(lambda name: options.only in name, SCALED):
            for factor in (0.5, 2.0):
                print(row(f"{name} × {factor:g}", cases, base, decisions(cases, scaled(name, factor))), flush=True)
        planned = hidden_cases(options.seed, (PLANNED_FAMILY,))
        plans = decisions(planned, {}, planned=True)
        for name in filter(lambda name: options.only in name, PLANNED):
            for factor in (0.5, 2.0):
                now = decisions(planned, scaled(name, factor), planned=True)
                print(row(f"{name} × {factor:g}", planned, plans, now), flush=True)
    for name, change in SEARCHED.items():
        if options.only in name:
            print(row(name, cases, base, decisions(cases, change)), flush=True)
    print(f"{time.process_time() - start:.0f} s of CPU")


if __name__ == "__main__":
    main()
