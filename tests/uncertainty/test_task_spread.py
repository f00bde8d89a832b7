"""The part of a spread that a task minds, at any posture: across or along, its probability of success, its budget."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import posture_opt as po
from posture_opt.uncertainty.sampler import Sampler
from posture_opt.uncertainty.spread_parts import spread_parts
from tests.helpers.planar_2r import position

PLANAR = {
    "robot": {"kind": "preset", "name": "planar_2r"},
    "uncertainty": {"sigma": {"joint1.theta": "1 deg", "joint2.theta": "3 deg", "joint1.a": "10 mm"}},
}
UR10 = {
    "robot": {"kind": "preset", "name": "ur10"},
    "uncertainty": {
        "sigma": {"shoulder_pan.theta": "0.02 deg", "elbow.theta": "0.05 deg", "wrist_1.theta": "0.05 deg"}
    },
}
Q6 = (0.3, -1.0, 1.2, 0.4, 0.7, 0.0)
TASKS = {
    "insert": {"kind": "insert", "direction": [1, 2, -1], "clearance": "0.3 mm"},
    "probe": {"kind": "probe", "direction": [1, 2, -1], "clearance": "0.3 mm"},
    "measure": {"kind": "measure", "direction": [1, 2, -1]},
}


@pytest.mark.parametrize("name", ["insert_planar_2r_fixed_hole", "insert_scara"])
def test_a_posture_is_judged_as_the_solution_is(name: str) -> None:
    solution = po.PostureSelector(po.load_problem(name), compiled=False).solve()
    seen = po.propagate(solution.problem, solution.q).for_task
    assert seen is not None
    assert seen.critical.sigma_max == pytest.approx(solution.critical.sigma_max, rel=1e-12)
    assert seen.critical.radius95 == pytest.approx(solution.critical.radius95, rel=1e-9)
    assert seen.sigma_along == pytest.approx(solution.sigma_along, rel=1e-12)
    assert seen.success_probability == solution.success_probability
    assert seen.budget == solution.budget


@pytest.mark.parametrize("kind", TASKS)
def test_the_part_that_counts_is_that_of_a_cloud(kind: str) -> None:
    problem = po.problem_from_dict({**UR10, "task": TASKS[kind]})
    spread = po.propagate(problem, Q6)
    seen, n = spread.for_task, 200_000
    assert seen is not None
    shift, _ = Sampler.of(spread)(np.random.default_rng(5), n)
    d = np.array([1, 2, -1]) / math.sqrt(6)
    part = {"insert": shift - np.outer(shift @ d, d), "probe": np.outer(shift @ d, d), "measure": shift}[kind]
    largest = math.sqrt(np.linalg.eigvalsh(np.cov(part.T))[-1])
    # A standard deviation of n normal samples has the standard error sigma / sqrt(2 n); five of them.
    assert seen.critical.sigma_max == pytest.approx(largest, rel=5 / math.sqrt(2 * n))
    assert seen.sigma_along == pytest.approx(float(np.std(shift @ d)), rel=5 / math.sqrt(2 * n))
    outside = np.mean(np.linalg.norm(part, axis=1) > seen.critical.radius95)
    assert outside == pytest.approx(0.05, abs=5 * math.sqrt(0.05 * 0.95 / n))
    if seen.success_probability is not None:
        inside = np.mean(np.linalg.norm(part, axis=1) <= 0.3e-3)
        assert 0.1 < seen.success_probability < 0.9
        assert seen.success_probability == pytest.approx(inside, abs=5 * math.sqrt(0.25 / n))


def test_a_simulation_counts_what_stays_within_the_clearance() -> None:
    problem = po.problem_from_dict({**UR10, "task": TASKS["insert"]})
    cloud = po.simulate(problem, Q6, n=20_000, seed=3)
    document = cloud.to_json()
    low, high = document["success_probability_interval95"]
    assert low <= document["closed_form"]["success_probability"] <= high  # a 95 % interval; this seed is one of them
    assert low <= document["success_probability"] <= high
    assert document["critical"]["sigma_max"] == pytest.approx(
        document["closed_form"]["critical"]["sigma_max"], rel=0.03
    )
    (counted,) = (one for one in cloud.statements if one.label == "Simulated")
    assert counted.id == "uncertainty.success-agrees"
    assert counted.values["hits"] == pytest.approx(20_000 * document["success_probability"])


@pytest.mark.parametrize("call", [po.propagate, po.simulate])
def test_without_a_task_there_is_none(call: Any) -> None:
    found = call(po.problem_from_dict(PLANAR), [0.3, 0.5])
    document = found.to_json()
    assert document["task"] is document["critical"] is document["success_probability"] is None
    assert "clearance" not in found.report()


def test_a_hole_across_the_plane_of_a_planar_arm_has_two_directions() -> None:
    # Both directions of the plane count; with one of them the answer would be the other elbow or another number.
    task = {"kind": "insert", "direction": [0, 0, -1], "position": ["0.9 m", "0.4 m", "0 m"], "clearance": "80 mm"}
    problem = po.problem_from_dict({**PLANAR, "task": task})
    solution = po.select_posture(problem)
    reached = math.hypot(0.9, 0.4)
    elbow = math.acos((reached**2 - 2) / 2)
    shoulder = math.atan2(0.4, 0.9)
    best = min(
        float(po.propagate(problem, [shoulder - sign * elbow / 2, sign * elbow]).ellipse.semi_axes[-1])
        for sign in (1, -1)
    )
    assert solution.critical.sigma_max == pytest.approx(best, rel=1e-9)
    assert len(solution.critical.covariance) == 2
    seen = po.propagate(problem, solution.q).for_task
    assert seen is not None
    assert seen.success_probability == pytest.approx(solution.success_probability)


def test_what_nothing_moves_does_not_scatter() -> None:
    # A tilted base leaves 1e-17 in the rotation matrices; its root would be told as a length.
    robot = {**PLANAR["robot"], "base": {"rpy": ["30 deg", "20 deg", "10 deg"]}}
    tilted = po.problem_from_dict({**PLANAR, "robot": robot})
    turned = np.array(po.propagate(tilted, [0.3, 0.5]).to_json()["ellipse"]["axes"])
    normal = np.cross(*turned)
    problem = tilted.with_task("probe", direction=normal.tolist())
    seen = po.propagate(problem, [0.3, 0.5]).for_task
    assert seen is not None
    assert seen.critical.sigma_max == seen.sigma_along == 0.0


Q = (0.4, 1.1)
KNOWN, EACH = 1e-3, 3e-4  # rad: of the second joint, stays; of the first, anew at every repeat


def problem(**uncertainty: object) -> po.Problem:
    joint = {"type": "revolute", "a": "1 m"}
    return po.problem_from_dict(
        {
            "robot": {"kind": "dh", "joints": [{"name": name, **joint} for name in ("joint1", "joint2")]},
            "uncertainty": uncertainty,
        }
    )


def radius(sigma: np.ndarray) -> float:
    """95 % of draws of independent coordinates stay within."""
    drawn = np.random.default_rng(0).normal(size=(400_000, len(sigma))) * sigma
    return float(np.quantile(np.linalg.norm(drawn, axis=1), 0.95))


def moved(joint: int) -> np.ndarray:
    """(2,) shift of the tool point per radian of a joint."""
    step = np.zeros(2)
    step[joint] = 1e-6
    q = np.array(Q)
    links = (1.0, 1.0)
    return (position((q + step)[None], links) - position((q - step)[None], links))[0] / 2e-6


def test_each_part_has_its_own_size() -> None:
    stated = problem(sigma={"joint2.theta": "1 mrad"}, scatter={"joint1.theta": "0.3 mrad"})
    parts = spread_parts(po.propagate(stated, Q), np.eye(3)[:, :2])
    scatter, systematic = EACH * np.linalg.norm(moved(0)), KNOWN * np.linalg.norm(moved(1))
    assert parts.scatter_sigma == pytest.approx(scatter, rel=1e-4)
    assert parts.systematic_sigma == pytest.approx(systematic, rel=1e-4)
    assert parts.scatter_radius == pytest.approx(radius(np.array([scatter])), rel=0.01)
    assert parts.systematic_radius == pytest.approx(radius(np.array([systematic])), rel=0.01)
    assert parts.parameters == ("joint2.theta",)
    assert parts.mostly_systematic
    document = parts.to_json()
    assert document["systematic"]["parameters"] == ["joint2.theta"]
    assert document["scatter"]["sigma_max"] == parts.scatter_sigma


def test_only_what_the_task_cares_about_counts() -> None:
    stated = problem(sigma={"joint2.theta": "1 mrad"}, scatter={"joint1.theta": "0.3 mrad"})
    across = np.array([[1.0], [0.0], [0.0]])
    parts = spread_parts(po.propagate(stated, Q), across)
    assert parts.systematic_sigma == pytest.approx(KNOWN * abs(moved(1)[0]), rel=1e-4)
    assert parts.scatter_sigma == pytest.approx(EACH * abs(moved(0)[0]), rel=1e-4)
