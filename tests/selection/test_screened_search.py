"""The search for answers that are compared: as good as brute force, and as the certified search."""

from __future__ import annotations

import numpy as np
import pytest

import posture_opt as po
from tests.helpers.variants import conformance

SIGMA = (1e-4, 3e-4)  # rad
LOWER, UPPER = np.array([0.6, 0.2]), np.array([1.2, 0.5])  # m


def test_it_finds_what_a_fine_grid_finds_in_a_region() -> None:
    joint = {"type": "revolute", "a": "1 m"}
    low, high = ([f"{v} m" for v in (*corner, 0.0)] for corner in (LOWER, UPPER))
    problem = po.problem_from_dict(
        {
            "robot": {"kind": "dh", "joints": [{"name": name, **joint} for name in ("joint1", "joint2")]},
            "uncertainty": {"sigma": {"joint1.theta": f"{SIGMA[0]} rad", "joint2.theta": f"{SIGMA[1]} rad"}},
            "task": {"kind": "insert", "direction": [0, -1, 0], "region": {"min": low, "max": high}},
        }
    )
    found = po.PostureSelector(problem, compiled=False).solve_to_compare()
    angles = np.linspace(-np.pi, np.pi, 721)
    q1, q2 = np.meshgrid(angles, angles, indexing="ij")
    x, y = np.cos(q1) + np.cos(q1 + q2), np.sin(q1) + np.sin(q1 + q2)
    inside = (x >= LOWER[0]) & (x <= UPPER[0]) & (y >= LOWER[1]) & (y <= UPPER[1])
    # Across a direction along y counts x: its derivatives by the joints are -y and -sin(q1 + q2).
    sigma = np.sqrt((SIGMA[0] * y) ** 2 + (SIGMA[1] * np.sin(q1 + q2)) ** 2)
    least = float(sigma[inside].min())
    assert found.status == "optimal"
    assert found.critical.sigma_max <= least * (1 + 1e-6)
    assert found.critical.sigma_max > 0.95 * least  # the grid has no posture exactly at the edge of the region


FILES = [
    *("insert_ur10_measured", "insert_ur10_extended", "insert_ur10_cell", "insert_ur10_placement"),
    *("insert_iiwa14_tilt", "insert_panda", "insert_panda_cell", "drill_ur5e", "custom_planar_2r", "hold_planar_2r"),
]


@pytest.mark.parametrize("name", conformance(FILES, ["drill_ur5e"]))
def test_it_is_as_good_as_the_certified_answer(name: str) -> None:
    problem = po.load_problem(name)
    certified, compared = po.select_posture(problem), po.PostureSelector(problem, compiled=False).solve_to_compare()
    assert compared.critical.sigma_max == pytest.approx(certified.critical.sigma_max, rel=1e-6)
    assert compared.status == certified.status == "optimal"


def test_a_target_out_of_reach_has_the_reasons_of_the_certified_search() -> None:
    problem = po.load_problem("insert_planar_2r_measured").with_task(position=["3 m", "0 m", "0 m"])
    with pytest.raises(po.errors.NoSolutionError) as compared:
        po.PostureSelector(problem, compiled=False).solve_to_compare()
    with pytest.raises(po.errors.NoSolutionError) as certified:
        po.select_posture(problem)
    assert str(compared.value) == str(certified.value)
