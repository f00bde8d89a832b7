"""A small example of every public result."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import posture_opt as po
from posture_opt.result import Result

PROBLEMS = Path(__file__).parents[2] / "problems"
MEASURED = "insert_planar_2r_measured"


def measured(name: str = "planar_2r_measured.csv") -> tuple[Any, Any]:
    problem = po.load_problem(MEASURED)
    return problem, po.read_measurements(PROBLEMS / name, problem)


def calibrated() -> tuple[Any, Any, po.Calibration]:
    problem, data = measured()
    return problem, data, po.calibrate(problem, data)


def compared() -> po.Comparison:
    problem, _, calibration = calibrated()
    found = po.compare_plans({"nominal": problem, "calibrated": po.calibrated_problem(problem, calibration)})
    assert found is not None
    return found


def followed() -> Any:
    points = [["0.9 m", "0.5 m", "0 m"], ["1 m", "0.55 m", "0 m"], ["1.1 m", "0.5 m", "0 m"]]
    return po.load_problem("insert_planar_2r").with_task("trace", points=points)


def arms_compared() -> po.Comparison:
    names = ("insert_planar_2r_measured", "insert_planar_2r_calibrated")
    return po.compare({name: po.load_problem(name) for name in names})


def rechecked() -> po.Recheck:
    problem = po.load_problem("insert_planar_2r_calibrated")
    return po.recheck(problem, po.read_measurements(PROBLEMS / "planar_2r_measured.csv", problem))


MADE: dict[str, Callable[[], Result]] = {name: cache(make) for name, make in {
    "Solution": lambda: po.select_posture(po.load_problem("insert_planar_2r_fixed_hole")),
    "PostureBatch": lambda: po.select_postures(
        {name: po.load_problem(name) for name in ("insert_planar_2r", "insert_planar_2r_fixed_hole")}
    ),
    "Solution of a path": lambda: po.select_posture(followed()),
    "Solution of features": lambda: po.select_posture(po.load_problem("insert_scara_tray")),
    "Spread": lambda: po.propagate(po.load_problem("insert_planar_2r"), [0.3, 0.5]),
    "Cloud": lambda: po.simulate(po.load_problem("insert_planar_2r"), [0.3, 0.5], n=200),
    "TargetMap": lambda: po.map_targets(po.load_problem("insert_planar_2r_fixed_hole"), counts=(3, 3)),
    "AccuracyMap": lambda: po.map_accuracy(po.load_problem("insert_planar_2r_calibrated"), counts=(3, 3)),
    "MeasurementPlan": lambda: po.plan_measurements(po.load_problem(MEASURED), 10, candidates=100),
    "Comparison": compared,
    "Comparison of arms": arms_compared,
    "Compensation": lambda: po.compensate(
        po.load_problem("insert_planar_2r_calibrated"), {"x [m]": [0.9, 1.1], "y [m]": [0.4, 0.5]}
    ),
    "Calibration": lambda: calibrated()[2],
    "Assessment": lambda: po.assess(*calibrated()),
    "SpreadCheck": lambda: po.check_spread(*calibrated()),
    "Diagnosis": lambda: po.diagnose(*measured()),
    "Recheck": rechecked,
    "Batch": lambda: po.calibrate_batch(*measured("planar_2r_batch.csv")),
    "BatchDiagnosis": lambda: po.diagnose_batch(*measured("planar_2r_batch.csv")),
}.items()}  # fmt: skip
"""By name; each is made once a process."""
