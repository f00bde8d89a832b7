"""What an arm stands on: nothing reaches through it, and where a task cannot do without, that is said first."""

from __future__ import annotations

import numpy as np
import pytest

import posture_opt as po
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
