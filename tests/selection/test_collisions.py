"""Postures that keep clear: as good as brute force finds them, and clear by coal."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

import posture_opt as po
from posture_opt.model.toolchain import find_compiler
from tests.helpers import brute_force
from tests.helpers.cells import GROUND, POST, TABLE, problem_in_cell
from tests.helpers.said import said
from tests.helpers.variants import conformance

DOWN, ACROSS = np.array([0.0, 0.0, -1.0]), np.eye(3)[:, :2]
WALL = {"name": "wall", "kind": "half_space", "normal": [0, 1, 0], "offset": "-0.25 m"}
SCARA_POST = {**POST, "xyz": ["0.23 m", "-30 mm", "0 m"], "length": "0.4 m", "radius": "50 mm"}
CELLS = {
    "ur10": ((TABLE, POST), (0.6, 0.25, 0.1)),
    "panda": ((TABLE, WALL, {**POST, "xyz": ["0.2 m", "0.3 m", "0.45 m"]}), (0.5, 0.1, 0.2)),
    "scara": ((SCARA_POST, {**GROUND, "offset": "-0.3 m"}), (0.2, 0.15, -0.08)),
}


def written(point):
    return [f"{x} m" for x in point]


@pytest.mark.parametrize("preset", conformance(CELLS, ["scara"]))
def test_the_answer_in_a_cell_is_as_good_as_brute_force_finds(preset: str) -> None:
    obstacles, point = CELLS[preset]
    problem = problem_in_cell(preset, *obstacles, clearance="10 mm", position=written(point))
    solution = po.select_posture(problem)
    names = [f"{name}.{'theta' if joint.type == 'revolute' else 'd'}" for name, joint in zip(
        problem.robot.joint_names, problem.robot.joints, strict=True)]  # fmt: skip
    sigma = np.array([dict(zip(problem.sources.names, problem.sources.sigma, strict=True))[name] for name in names])
    found, _ = brute_force.best_posture(problem.scene, sigma, ACROSS, np.array(point), DOWN, np.random.default_rng(0))
    assert solution.critical.sigma_max <= 1.01 * found
    exact = brute_force.clearance(problem.scene, solution.q)
    assert exact >= problem.scene.margin - 1e-7
    assert solution.clearance.distance == pytest.approx(exact, abs=1e-7)
    free = po.select_posture(po.problem_from_dict({**problem.to_dict(), "cell": "none"}))
    assert brute_force.clearance(problem.scene, free.q) < problem.scene.margin  # the obstacles matter
    assert free.critical.sigma_max <= solution.critical.sigma_max * (1 + 1e-4)


@pytest.mark.parametrize(
    ("preset", "position"),
    conformance(
        product(["ur5e", "panda"], [None, (0.4, 0.2, 0.1), (0.45, -0.3, 0.3)]),
        [("ur5e", (0.45, -0.3, 0.3))],
    ),
)
def test_an_arm_of_known_shape_keeps_clear_of_itself(preset: str, position) -> None:
    task = {"kind": "insert", **({} if position is None else {"position": written(position)})}
    robot = {"kind": "preset", "name": preset}
    problem = po.problem_from_dict({"robot": robot, "uncertainty": {"repeatability": "0.1 mm"}, "task": task})
    solution = po.select_posture(problem)
    assert solution.clearance is not None
    assert brute_force.clearance(problem.scene, solution.q) >= -1e-7
    assert all(brute_force.clearance(problem.scene, list(a.posture.values())) >= -1e-7 for a in solution.alternatives)
    document = solution.to_json()
    assert document["clearance"]["distance"] == pytest.approx(solution.clearance.distance)
    assert len(document["clearance"]["between"]) == 2
    assert "collision.no-obstacles" in said(solution)


@pytest.mark.skipif(not find_compiler(), reason="no C compiler on this machine")
@pytest.mark.parametrize("preset", conformance(CELLS, ["scara"]))
def test_a_repeated_solve_in_a_cell_is_clear_by_coal_and_as_good_as_brute_force(preset: str) -> None:
    obstacles, point = CELLS[preset]
    problem = problem_in_cell(preset, *obstacles, clearance="10 mm", position=written(point))
    solution = po.PostureSelector(problem).solve()
    names = [f"{name}.{'theta' if joint.type == 'revolute' else 'd'}" for name, joint in zip(
        problem.robot.joint_names, problem.robot.joints, strict=True)]  # fmt: skip
    sigma = np.array([dict(zip(problem.sources.names, problem.sources.sigma, strict=True))[name] for name in names])
    found, _ = brute_force.best_posture(problem.scene, sigma, ACROSS, np.array(point), DOWN, np.random.default_rng(0))
    assert solution.critical.sigma_max <= 1.001 * found
    assert brute_force.clearance(problem.scene, solution.q) >= problem.scene.margin - 1e-7
    assert solution.status == "optimal"


# A plate in front of the target, the block that the target is in, and a plate that it lies on.
@pytest.mark.parametrize(("height", "told"), [(106, True), (0, False), (95, False)])
def test_what_the_free_end_of_a_tool_passes_through_is_told(height: int, told: bool) -> None:
    """The last part of a tool touches its target and is not checked: what stands in front of that is not touched."""
    thick = {106: 4, 0: 220, 95: 10}[height]
    size = ["300 mm", "300 mm", f"{thick} mm"]
    plate = {"name": "plate", "kind": "box", "size": size, "xyz": ["0.7 m", "0.2 m", f"{height} mm"]}
    problem = po.problem_from_dict({
        "robot": {"kind": "preset", "name": "ur10", "tool": {"xyz": ["0 m", "0 m", "300 mm"], "radius": "10 mm"}},
        "cell": {"obstacles": [plate], "mounting": "none"}, "uncertainty": {"repeatability": "0.1 mm"},
        "task": {"kind": "insert", "position": ["0.7 m", "0.2 m", "0.1 m"]},
    })  # fmt: skip
    q = po.select_posture(po.problem_from_dict({**problem.to_dict(), "cell": {"mounting": "none"}})).q
    assert (problem.scene.pierced(q) == ("plate",)) is told
    assert ("collision.tool-pierces" in said(po.select_posture(problem))) is told
