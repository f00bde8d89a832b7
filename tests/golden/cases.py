"""What is frozen: the documents that the public functions return for problem files, shipped, simulated, real data."""

from __future__ import annotations

import json
import tempfile
import textwrap
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import posture_opt as po
from tests.golden.compare import WORDS
from tests.helpers.real_arms import DATA
from tests.hidden.draw import draw
from tests.hidden.files import write

ROOT = Path(__file__).parents[2]
PROBLEMS = ROOT / "problems"
SEED = 2026
WIDTH = 120
SOLVED = {
    "custom_planar_2r": "a criterion and a bound of one's own",
    "insert_iiwa14_tilt": "freedom left: seven joints, a tilt, the miss as criterion",
    "insert_panda_block": "features in one placement that succeed together",
    "insert_planar_2r": "a region in the plane, exact moments", "insert_scara_cell": "obstacles, a sliding joint",
    "insert_scara_tray": "features, the mean of them", "insert_ur10": "a fixed target, configurations as alternatives",
    "insert_ur10_extended": "effects beyond the geometry", "insert_ur10_peg": "a long peg: both ends and wedging",
    "measure_planar_2r": "an expanded uncertainty", "weld_planar_2r": "a path",
    "weld_ur10": "a path at the highest speed",
}  # fmt: skip
"""Problem files, and what is decided in each and in no other."""
HIDDEN = {
    "clean": "the geometry alone", "exact": "nothing is found", "loose": "a cause of undetermined size",
    "outliers": "gross rows", "outside": "an error that no cause explains",
    "stated_sigma": "a stated sigma that the repeats refute", "two": "two causes, one of which others could replace",
    "batch": "lengths that vary together, a noisy joint of every robot",
}  # fmt: skip
"""Families of simulated data, and what is decided in each and in no other."""
INDEX = {"exact": 1}
"""The case of a family, where it is not the first."""
REAL_SETS = {
    "calibrate": (("ipa_ur10/series_b.csv", "ipa_ur10/problem.yaml", ""),),
    "diagnose": (
        ("jacobi_ur5/grid.csv", "jacobi_ur5/problem.yaml", "jacobi_ur5/random.csv"),
        ("jacobi_wam/grid.csv", "jacobi_wam/problem.yaml", "jacobi_wam/test.csv"),
        ("ipa_ur10/series_b.csv", "ipa_ur10/problem.yaml", ""),
        ("mukca_sockets/kuka_14.csv", "mukca_sockets/problem_iiwa.yaml", ""),
    ),
}
SLOW = frozenset({"batch", "exact", "loose", "outliers", "stated_sigma"})
Case = Callable[[], dict[str, Any]]

DIGITS = 12
"""Significant digits of a number that is written: more than any comparison looks at."""
NOT_HELD = WORDS | {
    "seconds", "posture_opt", "version", "absorbed", "iterations", "kkt", "agrees", "prices", "limiting_joint",
}  # fmt: skip
"""Keys of what a clock or a version says, of text for people, of lists whose order is rounding, and of how a solver
came to its end: its steps and residuals are rounding, and which prices pass their check hangs on it.
"""
WHOLE = frozenset({
    "solve-insert_planar_2r", "solve-insert_ur10", "solve-insert_scara_tray", "solve-weld_planar_2r",
    "calibrate-planar", "calibrate-batch", "diagnose-ur10", "plan-planar", "map-panda", "hidden-batch-0",
})  # fmt: skip
"""Documents that are held with all that they have, one of each kind of result; of the others, the decisions."""
LEFT_OUT = {
    "solve": frozenset({
        "tool", "covariance", "covariance_first_order", "bias", "basis", "budget_groups", "orientation", "position",
        "most_manipulable", "path", "others", "curvature", "curvature_infinite", "bias_mahalanobis", "bias_infinite",
    }),
    "calibrate": frozenset({
        "residuals", "correlations", "singular_values", "observability", "assessment", "spread_check", "posture",
        "nominal", "prior", "z", "p_value", "unit",
    }),
    "diagnose": frozenset({
        "residuals", "candidates", "unknowable", "test", "posture", "split", "tool_shift_rms", "gain_interval95",
        "test_gain", "repeat", "robots", "unit",
    }),
}  # fmt: skip
"""Of each kind of result, the keys of what is no decision and of what follows the decisions."""


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
    for name in SOLVED:
        yield f"solve-{name}", partial(solved, PROBLEMS / f"{name}.yaml")
    planar, batch = PROBLEMS / "planar_2r_measured.csv", PROBLEMS / "planar_2r_batch.csv"
    file, ur10 = PROBLEMS / "insert_planar_2r_measured.yaml", PROBLEMS / "insert_ur10_measured.yaml"
    yield "calibrate-planar", partial(calibrated, planar, file)
    yield "calibrate-batch", partial(calibrated, batch, file)
    yield "calibrate-ur10", partial(calibrated, PROBLEMS / "ur10_measured.csv", ur10, PROBLEMS / "ur10_another_day.csv")
    yield "diagnose-ur10", partial(diagnosed, PROBLEMS / "ur10_measured.csv", ur10, PROBLEMS / "ur10_another_day.csv")
    yield "plan-planar", partial(planned, file)
    yield "map-panda", partial(mapped, PROBLEMS / "insert_panda.yaml")
    yield from _simulated(name for name in HIDDEN if name not in SLOW)


def slow() -> Iterator[tuple[str, Case]]:
    """The cases that take minutes, or that need the real measurements beside the repository."""
    yield from _simulated(name for name in HIDDEN if name in SLOW)
    for command, run in (("calibrate", calibrated), ("diagnose", diagnosed)):
        for data, problem, test in REAL_SETS[command]:
            name = data.removesuffix(".csv").replace("/", "-")
            yield f"real-{command}-{name}", partial(run, DATA / data, DATA / problem, DATA / test if test else None)


def _simulated(families: Iterable[str]) -> Iterator[tuple[str, Case]]:
    for family in families:
        index = INDEX.get(family, 0)
        yield f"hidden-{family}-{index}", partial(hidden, family, index)


def missing(name: str) -> str:
    """Why a case cannot be looked at here; empty where it can."""
    lacks = name.startswith("real-") and not DATA.is_dir()
    return f"the measurements of real arms are not there: {DATA}" if lacks else ""


def document(name: str, case: Case) -> Any:
    """The document of a case as JSON text would give it back: whole, or its decisions and the numbers beside them."""
    return held(name, json.loads(json.dumps(case())))


def held(name: str, found: Any) -> Any:
    """What is held of a document: see `WHOLE`, `LEFT_OUT` and `NOT_HELD`."""
    kind = {"hidden": "diagnose"}.get(name.split("-")[0], name.removeprefix("real-").split("-")[0])
    left_out = frozenset() if name in WHOLE else LEFT_OUT[kind]
    return strip(found, NOT_HELD | left_out)


def strip(value: Any, keys: frozenset[str] = NOT_HELD) -> Any:
    """Without some keys at any depth, and with the first five candidates: those far down change places by rounding."""
    if isinstance(value, dict):
        kept = {k: strip(v, keys) for k, v in value.items() if k not in keys}
        return {k: v[:5] if k == "candidates" else v for k, v in kept.items()}
    return [strip(v, keys) for v in value] if isinstance(value, list) else value


def text(value: Any, indent: int = 0, lead: int = 0) -> str:
    """JSON with twelve digits, in which what fits on a line of 120 columns is on one line."""
    line = json.dumps(_rounded(value))
    if indent + lead + len(line) < WIDTH or not isinstance(value, dict | list) or not value:
        return line
    pad = " " * (indent + 1)
    if isinstance(value, dict):
        items = [f"{pad}{json.dumps(k)}: {text(v, indent + 1, len(k) + 4)}" for k, v in value.items()]
        return "{\n" + ",\n".join(items) + "\n" + " " * indent + "}"
    if not all(isinstance(v, int | float) for v in value):
        return "[\n" + ",\n".join(pad + text(v, indent + 1) for v in value) + "\n" + " " * indent + "]"
    filled = textwrap.fill(line[1:-1], WIDTH, initial_indent=pad, subsequent_indent=pad, break_on_hyphens=False)
    return "[\n" + filled + "\n" + " " * indent + "]"


def _rounded(value: Any) -> Any:
    if isinstance(value, float):
        return float(f"{value:.{DIGITS}g}")
    if isinstance(value, dict):
        return {k: _rounded(v) for k, v in value.items()}
    return [_rounded(v) for v in value] if isinstance(value, list) else value
