"""What is checked against what, and what the rows of the optimisation problem believe of it."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

import posture_opt as po
from posture_opt.collision.scene import SELF_CLEARANCE_ROW, SEPARATION_M, Scene, narrowest
from posture_opt.collision.smooth_bounds import BOUND_SLACK_M, SOFT_MINIMUM_WIDTH_M
from posture_opt.model.compiled import BatchFunction
from posture_opt.robot.posture import drawn_between
from tests.helpers import brute_force
from tests.helpers.cells import GROUND, LAMP, POST, TABLE, problem_in_cell
from tests.helpers.variants import conformance

COUNT = 35_000  # of each arm
TOLERANCE = 2e-6  # m: taken off the rows for what a solver leaves of them


@pytest.mark.parametrize("preset", conformance(["panda", "scara"], ["scara"]))
def test_rows_are_never_optimistic_and_little_pessimistic(preset: str) -> None:
    """At random postures, group by group, against the exact distances."""
    scene = problem_in_cell(preset, TABLE, POST, LAMP, GROUND, clearance="10 mm").scene
    q = ca.SX.sym("q", scene.robot.n)
    rows = scene.rows(q)
    believed = BatchFunction(ca.Function("rows", [q], [ca.vertcat(*(row.bound for row in rows))]), compiled=False)
    Q = np.random.default_rng(7).uniform(*drawn_between(scene.robot), (COUNT, scene.robot.n))
    found, distances = believed(Q), scene.distances(Q)
    names, checked = [obstacle.name for obstacle in scene.obstacles], 0
    for k, row in enumerate(rows):
        columns = [
            i
            for i, (_, b) in enumerate(scene.pairs)
            if row.name == (f"clearance to {b}" if b in names else SELF_CLEARANCE_ROW)
        ]
        true = distances[:, columns].min(axis=1)
        apart = true > -0.002  # deeper, where centre lines of thin capsules cross, a line takes the place of the root
        assert np.all(found[apart, k] <= true[apart])
        assert np.all(found[true < 0, k] < 0)
        near = (true >= 0) & (true < scene.margin + SEPARATION_M / 2)
        most = BOUND_SLACK_M + SOFT_MINIMUM_WIDTH_M / 2 * np.ceil(np.log2(len(columns) + 1)) + TOLERANCE
        assert np.max(true[near] - found[near, k], initial=0.0) <= most
        assert most < 0.005
        checked += int(near.sum())
    assert checked > COUNT / 10
    assert [row.name for row in rows][:2] == ["clearance to table", "clearance to post"]


def test_neighbours_are_not_checked_and_what_stands_still_meets_no_obstacle() -> None:
    scene = problem_in_cell("ur5e", TABLE, POST).scene
    names = ("base", *scene.robot.joint_names)
    for a, b in scene.pairs:
        if b in names:
            assert abs(names.index(a) - names.index(b)) > 1
        else:
            assert a != "base"


def test_what_overlaps_in_every_posture_is_not_checked() -> None:
    """A collar round the wrist that the forearm's capsule always reaches into, and one that it does not."""

    def scene(radius):
        shape = [
            {"joint": "elbow", "from": ["0 m", "0 m", "0 m"], "to": ["0.4 m", "0 m", "0 m"], "radius": "40 mm"},
            {"joint": "wrist_2", "from": ["0 m", "0 m", "0 m"], "to": ["0 m", "0 m", "0 m"], "radius": radius},
        ]
        robot = {"kind": "preset", "name": "ur5e", "shape": {"replace": shape}}
        return po.problem_from_dict({"robot": robot, "cell": {"mounting": "none"}}).scene

    assert scene("500 mm").pairs == ()
    assert scene("500 mm").left_out == (("elbow", "wrist_2"),)
    assert scene("40 mm").pairs == (("elbow", "wrist_2"),)


def held(scene):
    """Pairs that keep less than the clearance -> the distance that they keep [m]."""
    return {names: d for names, d in zip(scene.pairs, scene.required, strict=True) if d < scene.margin}


def test_a_pair_that_cannot_have_the_clearance_keeps_what_it_can() -> None:
    """Links 5 and 7 of a Panda are never 30 mm apart, and sometimes overlap: they stay checked."""
    robot = {"kind": "preset", "name": "panda"}
    scene = po.problem_from_dict({"robot": robot, "cell": {"clearance": "30 mm"}}).scene
    ((names, kept),) = held(scene).items()
    assert names == ("panda_joint5", "panda_joint7")
    Q = np.random.default_rng(11).uniform(*drawn_between(scene.robot), (2000, 7))
    away = scene.distances(Q)[:, [k for k, pair in enumerate(scene.pairs) if pair == names]].min(axis=1)
    assert away.max() < 0.03
    assert away.min() < 0
    assert 0.4 < np.mean(away >= kept) < 0.7  # about half of all postures have it
    assert np.all(scene.slack(Q)[away < kept] < 0)


def test_of_an_assumed_tool_the_axis_counts_and_what_it_would_touch_is_said() -> None:
    robot = {"kind": "preset", "name": "irb1200", "tool": {"xyz": ["0 m", "0 m", "190 mm"]}}
    scene = po.problem_from_dict({"robot": robot, "cell": {"clearance": "10 mm"}}).scene
    assert min(scene.required) >= 0
    Q = np.random.default_rng(3).uniform(*drawn_between(scene.robot), (500, 6))
    near = [q for q in Q if scene.slack(q)[0] >= 0 and scene.within_tool(q[None])]
    assert near
    for q in near[:5]:
        assert scene.clearance(q).own.distance >= 0
        assert [one.id for one in scene.statements(q[None])].count("collision.tool-touches") == 1


def test_the_shoulder_near_its_table_keeps_what_it_can() -> None:
    scene = problem_in_cell("ur10", {**TABLE, "size": ["2 m", "2 m", "20 mm"]}, clearance="50 mm").scene
    kept = held(scene)
    assert 0 <= kept["shoulder_pan", "table"] < 0.05
    required = dict(zip(scene.pairs, scene.required, strict=True))
    assert required["elbow", "table"] == 0.05


def test_a_held_part_is_checked() -> None:
    shape = [{"joint": "tool", "from": ["0 m", "0 m", "0 m"], "to": ["0 m", "0 m", "0.3 m"], "radius": "20 mm"}]
    scene = problem_in_cell("ur5e", TABLE, shape={"replace": shape}).scene
    assert ("tool", "table") in scene.pairs
    q = np.array([0.3, -1.2, 1.5, -1.8, -1.6, 0.2])
    assert scene.clearance(q).distance == pytest.approx(brute_force.clearance(scene, q), abs=1e-8)
    added = problem_in_cell("ur5e", TABLE, shape={"add": shape}).scene
    assert len(added.robot.shape) == len(problem_in_cell("ur5e", TABLE).robot.shape) + 1


def test_an_arm_of_unknown_shape_is_checked_against_obstacles_alone() -> None:
    robot = {"kind": "preset", "name": "planar_2r"}
    post = {**POST, "xyz": ["0.6 m", "0.5 m", "0 m"]}
    bare = po.problem_from_dict({"robot": robot})
    among = po.problem_from_dict({"robot": robot, "cell": {"obstacles": [post]}})
    assert bare.scene.clearance([0.1, 0.2]) is None
    assert among.scene.assumed
    assert {b for _, b in among.scene.pairs} == {"post"}
    found = among.scene.clearance([0.0, np.pi / 2])
    assert found.between == ("joint2", "post")
    assert found.distance == pytest.approx(0.4 - 0.06 - 0.04 * 2.0)


@pytest.mark.parametrize("preset", ["panda", "scara"])
def test_the_clearance_is_that_of_coal(preset: str) -> None:
    scene = problem_in_cell(preset, TABLE, POST, LAMP, GROUND).scene
    Q = np.random.default_rng(3).uniform(*drawn_between(scene.robot), (60, scene.robot.n))
    apart = [q for q in Q if scene.clearance(q).distance > 1e-3]
    assert len(apart) >= 5
    for q in apart:
        assert scene.clearance(q).distance == pytest.approx(brute_force.clearance(scene, q), abs=2e-8)
    least = scene.clearance(np.array(apart))
    assert least.distance == min(scene.clearance(q).distance for q in apart)


def test_links_of_known_shape_are_checked_against_each_other_whatever_is_known_of_others() -> None:
    """Of a URDF with a link without collision geometry: it alone is named, and stands in against the cell."""
    scene = problem_in_cell("panda", TABLE).scene
    robot = replace(scene.robot, bare_joints=("panda_joint5",), unshaped=("panda_link5",),
                    shape=tuple(c for c in scene.robot.shape if c.joint != "panda_joint5"))  # fmt: skip
    partly = Scene.of(robot, problem_in_cell("panda", TABLE).cell)
    assert ("panda_joint5", "table") in partly.pairs
    own = {pair for pair in scene.pairs[: len(scene.own)] if "panda_joint5" not in pair}
    assert {*partly.pairs[: len(partly.own)]} == own
    assert partly.unchecked == ("panda_link5",)


def test_an_arm_with_a_base_alone_is_checked_with_assumed_links() -> None:
    shape = [{"joint": "base", "from": ["0 m", "0 m", "0 m"], "to": ["0 m", "0 m", "0.1 m"], "radius": "90 mm"}]
    scene = problem_in_cell("ur5e", TABLE, shape={"replace": shape}).scene
    assert scene.assumed
    assert ("elbow", "table") in scene.pairs
    assert scene.mounting is None  # what an arm of unknown shape stands on is not known either


START = np.radians([37.0, -112.0, 128.0, -29.0, 90.0, -26.0])
OBSTACLES = {
    "box": {"kind": "box", "size": ["0.2 m", "0.3 m", "0.1 m"], "rpy": ["20 deg", "40 deg", "10 deg"]},
    "cylinder": {"kind": "cylinder", "radius": "60 mm", "length": "0.5 m", "rpy": ["70 deg", "0 deg", "0 deg"]},
    "sphere": {"kind": "sphere", "radius": "0.1 m"},
}


@pytest.mark.parametrize("kind", OBSTACLES)
def test_the_gap_joins_the_two_surfaces_at_the_least_distance(kind: str) -> None:
    """Its ends are as far apart as the exact distance says; one is on the obstacle, the other so far from it."""
    obstacle = {"name": "thing", "xyz": ["0.55 m", "0.1 m", "0.5 m"], **OBSTACLES[kind]}
    problem = po.load_problem("insert_ur10").replace(cell={"obstacles": [obstacle], "clearance": "20 mm"})
    scene, rng, met = problem.scene, np.random.default_rng(2), 0
    (solid,) = scene.stated_obstacles
    for q in START + rng.uniform(-0.5, 0.5, (12, 6)):
        gap = narrowest(scene, q)
        assert gap is not None
        away = zip(scene.pairs, scene.distances(q)[0], scene.required, strict=True)
        assert gap.distance == min(d for pair, d, least in away if pair[1] == "thing" and least >= scene.margin)
        if gap.distance > 1e-3:
            assert np.linalg.norm(gap.end - gap.start) == pytest.approx(gap.distance, abs=1e-7)
            assert float(solid.distance(gap.end, gap.end)) == pytest.approx(0.0, abs=1e-7)
            assert float(solid.distance(gap.start, gap.start)) == pytest.approx(gap.distance, abs=1e-6)
            met += 1
    assert met >= 6


def test_nothing_is_narrow_where_nothing_is_checked() -> None:
    problem = po.load_problem("insert_ur10").replace(cell="none")
    assert narrowest(problem.scene, np.zeros(6)) is None
