"""What an arm stands on: nothing reaches through it, and where a task cannot do without, that is said first."""

from __future__ import annotations

import numpy as np
import pytest

import posture_opt as po
from posture_opt.errors import NoSolutionError
from tests.export.programs import answer_program
from tests.helpers.brute_force import in_the_world
from tests.helpers.cells import POST, TABLE
from tests.helpers.said import said
from tests.helpers.variants import conformance

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


@pytest.mark.parametrize("preset", conformance(["ur5e", "ur10", "panda"], ["ur5e"]))
def test_no_link_reaches_below_the_base(preset: str) -> None:
    problem = problem_of(preset)
    selector = po.PostureSelector(problem, compiled=False)
    rng = np.random.default_rng(2207)
    free = po.PostureSelector(problem_of(preset, cell={"mounting": "none"}), compiled=False)
    needed = 0
    for position in rng.uniform((0.3, -0.2, 0.1), (0.5, 0.2, 0.35), (3, 3)):
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


@pytest.mark.long
def test_a_plane_that_is_stated_is_kept() -> None:
    with pytest.raises(NoSolutionError, match="mounting plane"):
        po.select_posture(problem_of("ur5e", (0.4, 0.1, -0.35), {"mounting": {"below": "0 m"}}))
    pedestal = po.select_posture(problem_of("ur5e", (0.4, 0.1, -0.35), {"mounting": {"below": "750 mm"}}))
    assert heights(pedestal.problem, pedestal.q)[:, 0].min() >= -0.75
    assert "collision.mounting-assumed" not in said(pedestal)


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


def test_presets_that_stand_on_a_foot_have_their_plane_there() -> None:
    assert problem_of("puma560").scene.mounting.below == pytest.approx(26.45 * 0.0254, abs=1e-5)
    assert problem_of("scara").scene.mounting.below == pytest.approx(0.026)
    assert problem_of("planar_2r").scene.mounting is None  # its shape is not known


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


@pytest.mark.long
def test_the_tool_is_part_of_the_arm_but_for_its_end() -> None:
    tool = {"tool": {"xyz": ["0 m", "0 m", "0.4 m"]}}
    plate = {"name": "plate", "kind": "box", "size": ["0.2 m", "0.2 m", "10 mm"], "xyz": ["0.7 m", "0.1 m", "0.25 m"]}
    through = problem_of("ur10", (0.7, 0.1, 0.1), {"obstacles": [plate]}, robot=tool)
    assert not po.PostureSelector(through, compiled=False).feasible(6)
    block = {**plate, "size": ["0.2 m", "0.2 m", "0.1 m"], "xyz": ["0.7 m", "0.1 m", "0.05 m"]}  # the target is on it
    assert po.select_posture(problem_of("ur10", (0.7, 0.1, 0.1), {"obstacles": [block]}, robot=tool)).q.size
    thick = {"tool": {**tool["tool"], "radius": "45 mm"}}
    (capsule,) = [c for c in problem_of("ur10", robot=thick).scene.placed.capsules if c.joint == "tool"]
    assert capsule.radius == 0.045
    assert capsule.end == pytest.approx((0.0, 0.0, -0.09))


def dh_ur5(cell=None):
    """A UR5 by its numbers (Universal Robots), which say nothing of its shape, at a hole beside it."""
    a, d = [0, -0.425, -0.39225, 0, 0, 0], [0.089459, 0, 0, 0.10915, 0.09465, 0.0823]
    alpha = [90, 0, 0, 90, -90, 0]
    joints = [{"name": f"J{i + 1}", "a": f"{a[i]} m", "d": f"{d[i]} m", "alpha": f"{alpha[i]} deg"} for i in range(6)]
    task = {"kind": "insert", "position": ["0.4 m", "0.2 m", "0.2 m"], "direction": [0, 0, -1]}
    document = {"robot": {"kind": "dh", "joints": joints}, "uncertainty": {"repeatability": "0.1 mm"}, "task": task}
    return po.problem_from_dict(document if cell is None else {**document, "cell": cell})


def test_an_elbow_below_the_base_is_said_where_nothing_tells_what_the_arm_stands_on() -> None:
    problem = dh_ur5()
    below = np.radians([40.7, 156.7, 120.8, 172.5, 90.0, 0.0])  # a posture that was once delivered without a word
    danger = problem.scene.mounting_statement(below)
    assert (danger.id, danger.severity, danger.about) == ("collision.link-below-base", "danger", "J2")
    assert danger.values["depth"].value == pytest.approx(0.079, abs=5e-4)  # 425 sin 156.7° − 89.459
    assert not problem.scene.mounting_note(np.radians([40.7, -115.8, -93.1, 118.9, -90.0, 0.0]))
    for cell in ({"mounting": "none"}, {"mounting": {"below": "0 m"}}, {"obstacles": [TABLE]}, "none"):
        other = dh_ur5(cell).scene.mounting_statement(below)
        assert other is None or other.id != "collision.link-below-base"
    kept = po.PostureSelector(dh_ur5({"mounting": {"below": "0 m"}}), compiled=False).solve()
    assert not dh_ur5().scene.mounting_note(kept.q)
    assert dh_ur5().scene.mounting is None  # only said: no plane is assumed


def test_a_tool_point_below_the_base_tells_that_no_table_is_there() -> None:
    straight_down = np.radians([0.0, 60.0, 0.0, 30.0, 90.0, 0.0])
    assert not dh_ur5().scene.mounting_note(straight_down)
