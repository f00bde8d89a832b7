"""Postures that keep clear of a cell, of themselves and of what the arm stands on: by brute force and by coal."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

import posture_opt as po
from posture_opt.problem.load import problem_from_dict
from tests.export.programs import answer_program
from tests.helpers import brute_force
from tests.helpers.brute_force import in_the_world
from tests.helpers.cells import GROUND, LAMP, POST, TABLE, problem_in_cell
from tests.helpers.said import said
from tests.helpers.variants import conformance

DOWN, ACROSS = np.array([0.0, 0.0, -1.0]), np.eye(3)[:, :2]
WALL = {"name": "wall", "kind": "half_space", "normal": [0, 1, 0], "offset": "-0.25 m"}
SCARA_POST = {**POST, "xyz": ["0.23 m", "-30 mm", "0 m"], "length": "0.4 m", "radius": "50 mm"}
CELLS = {
    "panda": ((TABLE, WALL, {**POST, "xyz": ["0.2 m", "0.3 m", "0.45 m"]}), (0.5, 0.1, 0.2)),
    "scara": ((SCARA_POST, {**GROUND, "offset": "-0.3 m"}), (0.2, 0.15, -0.08)),
}


def written(point):
    return [f"{x} m" for x in point]


@pytest.mark.parametrize("preset", conformance(CELLS, ["scara"]))
def test_the_answer_in_a_cell_is_as_good_as_brute_force_finds(preset: str) -> None:
    obstacles, point = CELLS[preset]
    problem = problem_in_cell(preset, *obstacles, clearance="10 mm", position=written(point))
    solution = po.PostureSelector(problem).solve()  # compiled, where there is a compiler
    names = [f"{name}.{'theta' if joint.type == 'revolute' else 'd'}" for name, joint in zip(
        problem.robot.joint_names, problem.robot.joints, strict=True)]  # fmt: skip
    sigma = np.array([dict(zip(problem.sources.names, problem.sources.sigma, strict=True))[name] for name in names])
    found, _ = brute_force.best_posture(problem.scene, sigma, ACROSS, np.array(point), DOWN, np.random.default_rng(0))
    assert solution.critical.sigma_max <= 1.001 * found
    assert solution.status == "optimal"
    exact = brute_force.clearance(problem.scene, solution.q)
    assert exact >= problem.scene.margin - 1e-7
    assert solution.clearance.distance == pytest.approx(exact, abs=1e-7)
    free = po.select_posture(problem_from_dict({**problem.to_dict(), "cell": "none"}))
    assert brute_force.clearance(problem.scene, free.q) < problem.scene.margin  # the obstacles matter
    assert free.critical.sigma_max <= solution.critical.sigma_max * (1 + 1e-4)


@pytest.mark.parametrize(
    ("preset", "position"),
    conformance([("ur5e", (0.45, -0.3, 0.3)), ("panda", None)], [("ur5e", (0.45, -0.3, 0.3))]),
)
def test_an_arm_of_known_shape_keeps_clear_of_itself(preset: str, position) -> None:
    task = {"kind": "insert", **({} if position is None else {"position": written(position)})}
    robot = {"kind": "preset", "name": preset}
    problem = problem_from_dict({"robot": robot, "uncertainty": {"repeatability": "0.1 mm"}, "task": task})
    solution = po.select_posture(problem)
    assert solution.clearance is not None
    assert brute_force.clearance(problem.scene, solution.q) >= -1e-7
    assert all(brute_force.clearance(problem.scene, list(a.posture.values())) >= -1e-7 for a in solution.alternatives)
    document = solution.to_json()
    assert document["clearance"]["distance"] == pytest.approx(solution.clearance.distance)
    assert len(document["clearance"]["between"]) == 2
    assert "collision.no-obstacles" in said(solution)


@pytest.mark.long
def test_a_selector_keeps_clear_at_every_target() -> None:
    problem = problem_in_cell("ur10", TABLE, POST, clearance="20 mm", position=["0.6 m", "0.2 m", "0.2 m"])
    selector = po.PostureSelector(problem, compiled=False)
    rng = np.random.default_rng(2)
    with_rows = 0
    for _ in range(5):
        solution = selector.solve(position=rng.uniform((0.5, 0.0, 0.1), (0.75, 0.4, 0.3)))
        with_rows += solution.optimisation_problem.scene is not None
        assert brute_force.slack(problem.scene, solution.q) >= -1e-7
    assert 0 < with_rows < 5  # both ways


@pytest.mark.long
def test_what_was_checked_is_told() -> None:
    cell = problem_in_cell("ur10", TABLE, LAMP, position=["0.6 m", "0.2 m", "0.2 m"])
    told = said(po.select_posture(cell))["collision.checked-with-margin"]
    assert told.values["bodies"] == ("table", "lamp", "mounting plane", "itself")[: len(told.values["bodies"])]  # type: ignore[arg-type]
    assert told.values["margin"].value == pytest.approx(0.02)  # type: ignore[union-attr]
    off = problem_from_dict({**cell.to_dict(), "cell": "none"})
    solution = po.select_posture(off)
    assert "collision.switched-off" in said(solution)
    assert json.loads(json.dumps(solution.to_json()))["clearance"] is None


def test_what_the_free_end_of_a_tool_passes_through_is_told() -> None:
    """The last part of a tool touches its target and is not checked: what stands in front of that is not touched."""

    def cell(*obstacles: dict[str, Any], **robot: Any) -> po.Problem:
        tool = {"xyz": ["0 m", "0 m", "300 mm"], "radius": "10 mm"}
        return problem_from_dict({
            "robot": {"kind": "preset", "name": "ur10", "tool": tool, **robot},
            "cell": {"obstacles": list(obstacles), "mounting": "none"}, "uncertainty": {"repeatability": "0.1 mm"},
            "task": {"kind": "insert", "position": ["0.7 m", "0.2 m", "0.1 m"]},
        })  # fmt: skip

    def plate(height: int, thick: int) -> dict[str, Any]:
        size = ["300 mm", "300 mm", f"{thick} mm"]
        return {"name": "plate", "kind": "box", "size": size, "xyz": ["0.7 m", "0.2 m", f"{height} mm"]}

    free, pierced = po.select_posture(cell()), cell(plate(106, 4))
    assert "collision.tool-pierces" not in said(free)
    assert pierced.scene.pierced(free.q) == ("plate",)
    assert "collision.tool-pierces" in said(po.select_posture(pierced))
    for height, thick in ((0, 220), (95, 10)):  # the block that the target is in, and a plate that it lies on
        assert cell(plate(height, thick)).scene.pierced(free.q) == ()
    # A finger beside the tool axis, or a ball, says nothing of where the tool point is: it is checked as it is stated.
    for end in ("-250 mm", "-300 mm"):
        finger = {"joint": "tool", "from": ["0 m", "0.1 m", "-300 mm"], "to": ["0 m", "0.1 m", end], "radius": "20 mm"}
        stated = cell(plate(106, 4), tool={"xyz": ["0 m", "0 m", "300 mm"]}, shape={"add": [finger]})
        assert stated.scene.pierced(free.q) == ()


NEAR = {**TABLE, "size": ["1.6 m", "1.6 m", "40 mm"], "xyz": ["0.9 m", "0 m", "-40 mm"]}  # begins 0.1 m before the arm
SHELF = {**TABLE, "name": "shelf", "xyz": ["1.2 m", "0 m", "-0.2 m"]}
CEILING = {"name": "ceiling", "kind": "half_space", "normal": [0, 0, -1], "offset": "-1.5 m"}
FLOOR = {"name": "floor", "kind": "half_space", "normal": [0, 0, 1], "offset": "-0.75 m"}


def problem_of(preset, position=None, cell=None, robot=None, **task):
    """The insert task of a preset."""
    document = {
        "robot": {"kind": "preset", "name": preset, **(robot or {})},
        "uncertainty": {"repeatability": "0.1 mm"},
        "task": {"kind": "insert", **({} if position is None else {"position": [f"{v} m" for v in position]}), **task},
    }
    return po.problem_from_dict({**document, **({} if cell is None else {"cell": cell})})


def heights(problem, q):
    """Least and greatest z [m] of each capsule of links behind the first and of the tool, by other kinematics."""
    placed = problem.scene.placed
    found = []
    for capsule, body in zip(placed.capsules, placed.bodies, strict=True):
        if body > 1:
            a, b, radius = in_the_world(problem.robot, q, capsule)
            found.append((min(a[2], b[2]) - radius, max(a[2], b[2]) + radius))
    return np.array(found)


@pytest.mark.parametrize("preset", conformance(["ur5e", "panda"], ["ur5e"]))
def test_no_link_reaches_below_the_base(preset: str) -> None:
    problem = problem_of(preset)
    selector = po.PostureSelector(problem, compiled=False)
    rng = np.random.default_rng(2207)
    free = po.PostureSelector(problem_of(preset, cell={"mounting": "none"}), compiled=False)
    needed = 0
    for position in rng.uniform((0.3, -0.2, 0.1), (0.5, 0.2, 0.35), (2, 3)):
        solution = selector.solve(position=position)
        assert not solution.problem.scene.mounting.dropped
        assert heights(solution.problem, solution.q)[:, 0].min() >= -1e-7
        without = free.solve(position=position)
        assert without.sigma_max <= solution.sigma_max * (1 + 1e-3)
        needed += heights(without.problem, without.q)[:, 0].min() < 0
    assert needed or preset != "ur5e"  # the plane matters


def test_the_plane_is_the_ceiling_of_a_hanging_arm() -> None:
    hanging = {"base": {"xyz": ["0 m", "0 m", "1.5 m"], "rpy": ["180 deg", "0 deg", "0 deg"]}}
    solution = po.PostureSelector(problem_of("ur10", (0.6, 0.2, 0.5), robot=hanging), compiled=False).solve()
    assert heights(solution.problem, solution.q)[:, 1].max() <= 1.5 + 1e-7
    assert solution.problem.scene.plane.normal == (0.0, 0.0, -1.0)
    assert solution.problem.scene.plane.offset == -1.5


@pytest.mark.long
def test_a_plane_that_the_task_cannot_do_with_is_dropped_and_named_first() -> None:
    solution = po.select_posture(problem_of("ur5e", (0.4, 0.1, -0.35)))
    depth = -heights(solution.problem, solution.q)[:, 0].min()
    dropped = said(solution)["collision.mounting-dropped"]
    assert (dropped.severity, dropped.values["depth"].value) == ("danger", pytest.approx(depth, abs=1e-6))
    assert "below its mounting plane" in solution.report().splitlines()[2]
    assert solution.to_json()["mounting"] == {"below": 0.0, "assumed": True, "dropped": True}
    assert any("below its mounting plane" in note for note in answer_program(solution.problem, solution).notes)


@pytest.mark.parametrize(
    ("cell", "below"),
    [
        (None, 0.0),
        ({"mounting": "none"}, None),
        ("none", None),
        ({"obstacles": [NEAR]}, None),  # the table that it stands at
        ({"obstacles": [FLOOR]}, None),  # the floor around its pedestal
        ({"obstacles": [POST]}, 0.0),
        ({"obstacles": [SHELF]}, 0.0),
        ({"obstacles": [CEILING]}, 0.0),
    ],
)
def test_a_table_or_floor_of_ones_own_takes_the_place_of_the_plane(cell, below) -> None:
    mounting = problem_of("ur10", cell=cell).scene.mounting
    assert below == (None if mounting is None else mounting.below)


@pytest.mark.conformance
def test_features_and_maps_drop_the_plane_together() -> None:
    low, high = ({"name": name, "position": ["0 m", "0 m", z]} for name, z in (("low", "-0.35 m"), ("high", "0 m")))
    workpiece = {"x": "0.4 m", "y": "0.1 m", "z": "0.1 m"}
    both = po.select_posture(problem_of("ur5e", workpiece=workpiece, features=[low, high]))
    assert both.problem.scene.mounting.dropped
    assert "collision.mounting-dropped" in said(both)
    found = po.map_targets(
        problem_of("ur5e", (0.4, 0.1, -0.35)), counts=(2, 2), low=(0.38, 0.1, -0.35), high=(0.42, 0.14, -0.35),
        compiled=False,
    )  # fmt: skip
    assert found.problem.scene.mounting.dropped
    assert "collision.mounting-dropped" in said(found)
