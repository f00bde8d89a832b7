"""What is frozen: the documents that the public functions return for problem files, shipped, simulated, real data."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import posture_opt as po
from tests.helpers.real_arms import DATA
from tests.hidden.draw import draw
from tests.hidden.files import write

ROOT = Path(__file__).parents[2]
PROBLEMS = ROOT / "problems"
SEED = 2026
HIDDEN = [(family, 0) for family in ("full", "kr16", "narrow", "two", "clean", "outside", "planar", "joint_noise")]
MORE_HIDDEN = [
    (family, index)
    for family in ("full", "kr16", "narrow", "narrow_unloaded", "two", "clean", "exact", "outside", "few_poses")
    for index in (1, 2, 3)
] + [
    (family, 0)
    for family in ("scara", "seven", "full_100", "outliers", "range_noise", "stated_sigma", "loose", "geometry",
                   "wrong_masses", "heavy_tails", "batch", "batch_clean", "one_robot", "unknowable")
]  # fmt: skip
REAL_SETS = (
    ("jacobi_ur5/grid.csv", "jacobi_ur5/problem.yaml", "jacobi_ur5/random.csv"),
    ("jacobi_wam/grid.csv", "jacobi_wam/problem.yaml", "jacobi_wam/test.csv"),
    ("ipa_ur10/series_b.csv", "ipa_ur10/problem.yaml", ""),
    ("ipa_ur10/series_d.csv", "ipa_ur10/problem.yaml", ""),
    ("mukca_sockets/panda_3.csv", "mukca_sockets/problem_panda.yaml", ""),
    ("mukca_sockets/kuka_14.csv", "mukca_sockets/problem_iiwa.yaml", ""),
)
Case = Callable[[], dict[str, Any]]


def solved(path: Path) -> dict[str, Any]:
    """The best posture of a problem file."""
    return po.select_posture(po.load_problem(path)).to_json()


def calibrated(data: Path, problem: Path, test: Path | None = None) -> dict[str, Any]:
    """A calibration, of one robot or of a batch."""
    asked = po.load_problem(problem)
    rows = po.read_measurements(data, asked)
    if len(rows.robot_names) > 1:
        return po.calibrate_batch(asked, rows).to_json()
    other = {} if test is None else {"test": po.read_measurements(test, asked)}
    return po.calibrate(asked, rows, **other).to_json()


def diagnosed(data: Path, problem: Path, test: Path | None = None) -> dict[str, Any]:
    """A diagnosis, of one robot or of a batch."""
    asked = po.load_problem(problem)
    rows = po.read_measurements(data, asked)
    if len(rows.robot_names) > 1:
        return po.diagnose_batch(asked, rows).to_json()
    other = {} if test is None else {"test": po.read_measurements(test, asked)}
    return po.diagnose(asked, rows, **other).to_json()


def planned(problem: Path) -> dict[str, Any]:
    """A plan of ten measurements."""
    return po.plan_measurements(po.load_problem(problem), 10).to_json()


def mapped(problem: Path) -> dict[str, Any]:
    """A map of 4 x 4 targets."""
    return po.map_targets(po.load_problem(problem), counts=(4, 4)).to_json()


def hidden(family: str, index: int) -> dict[str, Any]:
    """The diagnosis of one simulated case."""
    case = draw(SEED, family, index, weakest=60.0)
    with tempfile.TemporaryDirectory() as folder:
        write(case, Path(folder))
        other = Path(folder) / "test.csv"
        return diagnosed(Path(folder) / "data.csv", Path(folder) / "problem.yaml", other if other.exists() else None)


def quick() -> Iterator[tuple[str, Case]]:
    """The cases that every run of the tests checks."""
    for path in sorted(PROBLEMS.glob("*.yaml")):
        yield f"solve-{path.stem}", partial(solved, path)
    planar, batch = PROBLEMS / "planar_2r_measured.csv", PROBLEMS / "planar_2r_batch.csv"
    file, ur10 = PROBLEMS / "insert_planar_2r_measured.yaml", PROBLEMS / "insert_ur10_measured.yaml"
    yield "calibrate-planar", partial(calibrated, planar, file)
    yield "calibrate-batch", partial(calibrated, batch, file)
    yield "diagnose-batch", partial(diagnosed, batch, file)
    yield "calibrate-ur10", partial(calibrated, PROBLEMS / "ur10_measured.csv", ur10, PROBLEMS / "ur10_another_day.csv")
    yield "diagnose-ur10", partial(diagnosed, PROBLEMS / "ur10_measured.csv", ur10, PROBLEMS / "ur10_another_day.csv")
    yield "plan-planar", partial(planned, file)
    yield "map-panda", partial(mapped, PROBLEMS / "insert_panda.yaml")
    for family, index in HIDDEN:
        yield f"hidden-{family}-{index}", partial(hidden, family, index)


def slow() -> Iterator[tuple[str, Case]]:
    """The cases that take minutes, or that need the real measurements beside the repository."""
    for family, index in MORE_HIDDEN:
        yield f"hidden-{family}-{index}", partial(hidden, family, index)
    for data, problem, test in REAL_SETS:
        other = DATA / test if test else None
        name = data.removesuffix(".csv").replace("/", "-")
        yield f"real-calibrate-{name}", partial(calibrated, DATA / data, DATA / problem, other)
        yield f"real-diagnose-{name}", partial(diagnosed, DATA / data, DATA / problem, other)


def missing(name: str) -> str:
    """Why a case cannot be looked at here; empty where it can."""
    lacks = name.startswith("real-") and not DATA.is_dir()
    return f"the measurements of real arms are not there: {DATA}" if lacks else ""


def document(case: Case) -> Any:
    """The document of a case as JSON text would give it back, without what a clock or a version says."""
    return strip(json.loads(json.dumps(case())))


def strip(value: Any) -> Any:
    """Without times and versions, and without the lists of all candidates: those far down change places by rounding."""
    if isinstance(value, dict):
        kept = {k: strip(v) for k, v in value.items() if k not in ("seconds", "posture_opt", "version")}
        return {k: v[:5] if k == "candidates" else v for k, v in kept.items() if k != "absorbed"}
    return [strip(v) for v in value] if isinstance(value, list) else value
