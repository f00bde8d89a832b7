"""The measured example: its numbers are those of the simulator that is named, and the calibrated plan hits there."""

from __future__ import annotations

import numpy as np

import posture_opt as po
from posture_opt.problem.calibrated import replanned
from posture_opt.problem.load import load_builtin, problems_folder
from tests.helpers import measured_planar_2r as shop


def test_the_file_holds_what_the_simulator_measures() -> None:
    lines = (problems_folder() / "planar_2r_measured.csv").read_text(encoding="utf-8").splitlines()
    assert lines[0] == shop.HEAD
    table = np.array([[float(cell) for cell in line.split(",")] for line in lines[1:]])
    off = 1e-3 * table[:, 2:] - shop.reached(np.radians(table[:, :2]))
    # Scatter of joints at levers of 1 to 2 m and the instrument: 0.1 to 0.2 mm.
    assert len(table) == 60
    assert 0.05e-3 < np.sqrt(np.mean(off**2)) < 0.25e-3


def test_the_plan_with_the_calibrated_arm_hits() -> None:
    problem = load_builtin("insert_planar_2r_measured")
    found = po.calibrate(problem, po.read_measurements(problems_folder() / "planar_2r_measured.csv", problem))
    again = replanned(problem, found, po.calibrated_problem(problem, found))
    assert again is not None
    assert again.before is not None
    assert again.after is not None
    assert again.landed is not None
    assert again.landing is not None
    before, after = (shop.reached(solution.q) - (0.9, 0.4) for solution in (again.before, again.after))
    sigma = again.landing.sigma_max
    assert abs(after[0]) < 3.5 * sigma  # across the direction
    assert abs(before[0] - again.landed.miss[0]) < 3.5 * sigma
    assert abs(before[0]) > 5 * abs(after[0])
