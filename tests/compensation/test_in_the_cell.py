"""Compensated targets are postures of the task in its cell: judged by kinematics and distances of the tests alone."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.optimize import minimize

import posture_opt as po
from tests.helpers.capsules import from_segment, in_the_world
from tests.helpers.factors import frame, pose
from tests.helpers.said import said

CORRECTIONS = {"shoulder_lift.a": "0.8 mm", "elbow.theta": "0.05 deg", "wrist_2.alpha": "0.03 deg"}
TABLE_TOP = -0.02
TABLE = {"name": "table", "kind": "half_space", "normal": [0, 0, 1], "offset": f"{TABLE_TOP} m"}
CLEARANCE = 0.01


def in_cell(**task: Any) -> Any:
    """A corrected UR10 above a table: its links keep 10 mm from it, link ends 60 mm above the base."""
    return po.problem_from_dict({
        "name": "arm",
        "robot": {"kind": "preset", "name": "ur10", "corrections": CORRECTIONS,
                  "tool": {"xyz": ["0 m", "0 m", "120 mm"], "rpy": ["0 deg"] * 3}},
        "uncertainty": {"repeatability": "0.02 mm"},
        "cell": {"obstacles": [TABLE], "clearance": f"{CLEARANCE} m"},
        "task": {"kind": "insert", "direction": [0, 0, -1], "position": ["0.7 m", "0.2 m", "0.1 m"],
                 "subject_to": [{"kind": "link_height", "at_least": "60 mm"}], **task},
    })  # fmt: skip


def targets(count: int, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    angle, radius = rng.uniform(-0.5, 0.9, count), rng.uniform(0.55, 0.95, count)
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), rng.uniform(0.05, 0.35, count)])


def table(p: np.ndarray, **more: object) -> dict[str, object]:
    return {f"{axis} [mm]": 1e3 * p[:, k] for k, axis in enumerate("xyz")} | more


def tilts(problem: Any, q: np.ndarray) -> np.ndarray:
    return np.array([math.acos(min(1.0, -pose(problem.robot, row)[2, 2])) for row in q])


def above_table(problem: Any, q: np.ndarray) -> float:
    """Least height of the moving links' capsules over the table [m]."""
    robot = problem.robot
    moving = [c for c in robot.shape if c.joint not in ("base", robot.joint_names[0])]
    heights = [min(a[2], b[2]) - r for row in q for a, b, r in (in_the_world(robot, row, c) for c in moving)]
    return min(heights) - TABLE_TOP


def link_ends(problem: Any, q: np.ndarray) -> float:
    return min(frame(problem.robot, row, k)[2, 3] for row in q for k in range(1, 6))


def test_positions_take_axis_terms_and_cell_of_the_task() -> None:
    problem, p = in_cell(tilt="8 deg"), targets(4, 101)
    found = po.compensate(problem, table(p))
    reached = np.array([pose(problem.robot, row)[:3, 3] for row in found.q])
    assert np.abs(reached - p).max() < 5e-6
    assert np.degrees(tilts(problem, found.q)).max() < 8 + 1e-3
    assert link_ends(problem, found.q) > 0.06 - 1e-5
    assert above_table(problem, found.q) > CLEARANCE - 1e-5


def test_of_all_postures_that_the_task_allows_the_one_nearest_to_the_plan_is_taken() -> None:
    """With the axis held a 6R arm keeps its spin: no posture that SLSQP finds on own kinematics is nearer."""
    problem, p = in_cell(), targets(2, 7)
    plan = po.select_posture(problem).q
    found = po.compensate(problem, table(p))
    limits = [(joint.lower, joint.upper) for joint in problem.robot.joints]
    for target, q in zip(p, found.q, strict=True):

        def left(x: np.ndarray, target: np.ndarray = target) -> np.ndarray:
            T = pose(problem.robot, x)
            return np.concatenate([T[:3, 3] - target, T[:2, 2]])

        starts = [q, plan, *np.random.default_rng(0).normal(plan, 0.5, (4, 6))]
        ends = [
            minimize(lambda x: 100 * ((x - plan) ** 2).sum(), start, bounds=limits, method="SLSQP",
                     constraints={"type": "eq", "fun": left}, options={"ftol": 1e-12, "maxiter": 100})
            for start in starts
        ]  # fmt: skip
        allowed = [e.fun / 100 for e in ends if np.abs(left(e.x)).max() < 1e-6 and pose(problem.robot, e.x)[2, 2] < 0]
        assert ((q - plan) ** 2).sum() <= min(allowed) + 1e-4


def test_an_orientation_is_met_near_the_plan_and_in_the_cell() -> None:
    problem, p = in_cell(), targets(4, 11)
    half = np.radians([20.0, 60.0, -30.0, 10.0]) / 2
    quaternion = {"qw": 0 * half, "qx": np.cos(half), "qy": np.sin(half), "qz": 0 * half}
    found = po.compensate(problem, table(p, **quaternion))
    for row, target, h in zip(found.q, p, half, strict=True):
        T = pose(problem.robot, row)
        c, s = math.cos(2 * h), math.sin(2 * h)
        assert np.abs(T[:3, 3] - target).max() < 5e-6
        assert np.abs(T[:3, :3] - [[c, s, 0], [s, -c, 0], [0, 0, -1]]).max() < 1e-5
    assert above_table(problem, found.q) > CLEARANCE - 1e-5
    assert link_ends(problem, found.q) > 0.06 - 1e-5


def test_joint_values_along_the_direction_stay_along_it() -> None:
    """The plan of the drawn arm, brought to its points by this one: exactly along the direction, whatever the tilt."""
    problem, p = in_cell(), targets(6, 23)
    drawn = problem.replace(robot__corrections=None)
    q = po.compensate(drawn, table(p)).q
    columns = {f"{name} [rad]": q[:, k] for k, name in enumerate(problem.robot.joint_names)}
    assert np.degrees(tilts(problem, q)).min() > 0.01
    found = po.compensate(problem, table(p, **columns))
    assert np.degrees(tilts(problem, found.q)).max() < 1e-3
    assert np.abs(found.q - q).max() < 0.02


def test_given_joint_values_are_judged_too() -> None:
    """Postures that are led through the table are refused, each with its line, and not moved elsewhere in silence."""
    problem = in_cell()
    q = np.array([po.select_posture(problem).q] * 2)
    columns = [{f"{name} [rad]": q[:, k].copy() for k, name in enumerate(problem.robot.joint_names)}]
    q[1, 1] -= 0.6
    columns += [{f"{name} [rad]": q[:, k] for k, name in enumerate(problem.robot.joint_names)}]
    assert po.compensate(problem, columns[0]).reached.all()
    assert above_table(problem, q[1:]) < 0
    with pytest.raises(po.errors.NoSolutionError, match="table") as refused:
        po.compensate(problem, columns[1])
    assert refused.value.solution.reached.tolist() == [True, False]


def test_obstacles_are_kept_clear_of_by_a_redundant_arm() -> None:
    """A post beside the elbow of a Panda: its capsules keep the distance by the geometry of the tests."""
    post = {"name": "post", "kind": "sphere", "radius": "80 mm", "xyz": ["0.15 m", "0.35 m", "0.45 m"]}
    problem = po.problem_from_dict({
        "robot": {"kind": "preset", "name": "panda"}, "uncertainty": {"repeatability": "0.1 mm"},
        "cell": {"obstacles": [post], "clearance": "20 mm"},
        "task": {"kind": "insert", "position": ["0.5 m", "0.1 m", "0.2 m"]},
    })  # fmt: skip
    p = np.array([[0.5, 0.25, 0.25], [0.45, 0.3, 0.3], [0.4, 0.35, 0.25]])
    found = po.compensate(problem, table(p))
    centre = np.array([[0.15, 0.35, 0.45]])
    for row, target in zip(found.q, p, strict=True):
        assert np.abs(pose(problem.robot, row)[:3, 3] - target).max() < 1e-5
        ends = [in_the_world(problem.robot, row, capsule) for capsule in problem.robot.shape]
        assert min(from_segment(centre, a, b)[0] - r for a, b, r in ends) - 0.08 > 0.02 - 1e-5


@pytest.mark.parametrize("post", [False, True])
def test_rows_stay_in_one_configuration_and_a_change_is_said(post: bool) -> None:
    """A planar arm with its elbow down cannot keep it over a wall at a low target, and with it up not off a post.

    Two links of a metre reach the point at the distance d with the elbow ``acos(d / 2)`` to either side of it.
    """
    section = po.load_problem("insert_planar_2r").to_dict()
    solids = [{"kind": "half_space", "name": "wall", "normal": [0, 1, 0], "offset": "-0.2 m"},
              {"kind": "sphere", "name": "post", "radius": "50 mm", "xyz": ["0.5 m", "0.866 m", "0 m"]}]  # fmt: skip
    section["cell"] = {"obstacles": solids[: 1 + post]}
    section["robot"]["shape"] = {"radius": "20 mm"}
    down = {"kind": "near_posture", "posture": {"joint2": "90 deg"}, "weight": 1e4}
    task = {"kind": "insert", "direction": [0, -1, 0], "position": ["1.5 m", "0.9 m", "0 m"], "minimize": [down]}
    p = np.array([[1.5, 0.9, 0.0], [1.5, 0.1, 0.0]])
    found = po.compensate(po.problem_from_dict({**section, "task": task}), table(p))
    away, half = np.arctan2(p[:, 1], p[:, 0]), np.arccos(np.hypot(*p[:, :2].T) / 2)
    assert math.sin(away[1] - half[1]) < -0.2
    first = away[0] + half[0] * (-1 if post else 1)
    assert found.q[:, 0] == pytest.approx([first, away[1] + half[1]], abs=1e-4)
    assert len(found.to_json()["configuration_changes"]) == post
    assert ("compensation.configuration-change" in said(found)) == post
