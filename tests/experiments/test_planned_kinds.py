"""Plans for plates and wires: postures at which their places can be measured, judged by a simulator of its own."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import posture_opt as po
from tests.helpers.cameras import TOOL_SCENE, Scene, camera_problem, camera_table, grid
from tests.helpers.instruments import (
    ANCHORS,
    MOUNTING,
    PLANES,
    SOCKETS,
    TrueArm,
    distance_table,
    level_table,
    mixed_table,
    plane_table,
    socket_table,
)
from tests.helpers.pairs import SECOND_BASE, pair_problem, pair_table, tool_at, ur10_problem

SIGMA = 2e-5
TOLERANCE = 5e-4  # m or rad, of every parameter of the arm


def problem(*kinds: str) -> po.Problem:
    return ur10_problem({kind: "0.02 mrad" if kind == "level" else "0.02 mm" for kind in kinds})


def information(read: Callable[[TrueArm], np.ndarray], own: np.ndarray) -> float:
    """Log determinant of what readings (m,) tell of the geometry of an arm, in its tolerances.

    The unknowns of the instrument, by which readings change as ``own`` (m, u) says, are known to 10 mm or mrad.
    """
    here, step = read(TrueArm()), 1e-6
    rows = []
    for k in range(24):
        errors = np.zeros(24)
        errors[k] = step
        rows.append((read(replace(TrueArm(), errors=errors.reshape(6, 4))) - here) / step)
    J = np.column_stack([*np.array(rows) * TOLERANCE, own * 1e-2]) / SIGMA
    M = np.eye(J.shape[1]) + J.T @ J
    return float(np.linalg.slogdet(M)[1])


def of_places(code: np.ndarray, shown: np.ndarray) -> np.ndarray:
    """(N d, P u) of ``shown`` (N, d, u), what a reading changes by with each unknown of its own place."""
    n, d, u = shown.shape
    found = np.zeros((n, d, code.max() + 1, u))
    found[np.arange(n), :, code] = shown
    return found.reshape(n * d, -1)


def level_axes(q: np.ndarray) -> np.ndarray:
    """(N, 3) heights of the axes of the inclinometer."""
    return TrueArm().pose(q)[:, 2, :3] @ MOUNTING


def test_planned_postures_are_within_the_range_of_the_level() -> None:
    rng = np.random.default_rng(33)
    arm, given = TrueArm.drawn(rng), problem("level")
    table = level_table(arm, rng, 200, SIGMA)
    near = np.max(np.abs([table["level_x [deg]"], table["level_y [deg]"]]), axis=0) < 30  # type: ignore[arg-type]
    near &= np.cumsum(near) <= 16
    data = po.read_measurements({key: np.asarray(column)[near] for key, column in table.items()}, given)
    plan = po.plan_measurements(given, 8, given=data, candidates=50)
    assert np.all(np.abs(np.degrees(np.arcsin(level_axes(plan.q)[:, :2]))) < 30.1)
    before = set(np.sign((arm.pose(data.q)[:, :3, :3] @ MOUNTING)[:, 2, 2]))
    assert set(np.sign(level_axes(plan.q)[:, 2])) <= before
    assert plan.places == ()
    assert plan.gain > 1


def test_planned_touches_reach_the_sockets_from_where_they_were_reached() -> None:
    rng = np.random.default_rng(34)
    arm, given = TrueArm.drawn(rng), problem("position")
    data = po.read_measurements(socket_table(arm, rng, 5, SIGMA), given)
    plan = po.plan_measurements(given, 10, given=data, candidates=50)
    code = np.array([int(name.removeprefix("socket")) for name in plan.places])
    assert np.all(np.linalg.norm(arm.point(plan.q) - SOCKETS[code], axis=1) < 2e-3)
    for k in set(code):
        axis, used = arm.pose(plan.q[code == k])[:, :3, 2], arm.pose(data.q[data.point == k])[:, :3, 2]
        assert np.all((axis > used.min(axis=0) - 0.01) & (axis < used.max(axis=0) + 0.01))

    def worth(q: np.ndarray, code: np.ndarray) -> float:
        own = of_places(code, np.tile(np.eye(3), (len(q), 1, 1)))
        return information(lambda a: a.point(q).ravel(), own)

    random = [worth(data.q[rows], data.point[rows]) for rows in (rng.permutation(len(data))[:10] for _ in range(5))]
    assert worth(plan.q, code) > np.median(random)


@pytest.mark.long
def test_what_is_known_before_a_plan_is_what_a_calibration_of_the_same_rows_knows() -> None:
    """Without tolerances of parts, the size of the arm was known to 10 mm, and its error at a task to millimetres."""
    rng = np.random.default_rng(34)
    arm, given = (
        TrueArm.drawn(rng),
        problem("position").replace(task={"kind": "hold", "position": ["0.7 m", "0 m", "0.4 m"]}),
    )
    data = po.read_measurements(socket_table(arm, rng, 5, SIGMA), given)
    plan = po.plan_measurements(given, 8, given=data, candidates=40)
    found = po.calibrate(given, data, plan=False, folds=2)
    known = {p.name: float(std) for p, std in zip(found.parameters, found.std, strict=True)}
    before = {p.name: float(std) for p, std in zip(plan.parameters, plan.before.std, strict=True) if np.isfinite(std)}
    assert len(before) > 10
    ratios = np.array([std / known[name] for name, std in before.items()])
    assert np.median(ratios) == pytest.approx(1.0, abs=0.05)
    assert np.all((ratios > 0.7) & (ratios < 1.5))  # small parts of what nothing determines are counted differently
    assert plan.after.task < plan.before.task < 2e-3


@pytest.mark.long
def test_two_arms_touch_in_planned_postures_and_nothing_else_meets(tmp_path: Path) -> None:
    rng = np.random.default_rng(35)
    one, two = TrueArm.drawn(rng), TrueArm()
    held = tool_at("30 mm", "-20 mm", "120 mm", free=False)
    given = pair_problem(tmp_path, tool_at("30 mm", "-20 mm", "120 mm"), held, held=True)
    data = po.read_measurements(pair_table(one, two, rng, 24, SIGMA), given)
    plan = po.plan_measurements(given, 8, given=data, candidates=50)
    assert [joint.name for joint in plan.second] == [f"right.{name}" for name in given.robot.joint_names]
    second = np.stack([joint.values for joint in plan.second], axis=1)
    there = two.point(second) @ SECOND_BASE[:3, :3].T + SECOND_BASE[:3, 3]
    assert np.all(np.linalg.norm(one.point(plan.q) - there, axis=1) < 2e-3)
    elbows = TrueArm(tool=np.array([0.0, 0.0, 0.0])).point(second) @ SECOND_BASE[:3, :3].T + SECOND_BASE[:3, 3]
    assert np.all(np.linalg.norm(elbows - TrueArm(tool=np.zeros(3)).point(plan.q), axis=1) > 0.05)
    assert plan.gain > 1
    header = plan.to_csv().splitlines()[0]
    assert "right.elbow [deg]" in header
    again = {name.strip(): [] for name in header.split(",")}
    for line in plan.to_csv().splitlines()[1:]:
        for name, cell in zip(again, line.split(","), strict=True):
            again[name].append(float(cell))
    read = po.read_measurements(again, given)
    assert np.allclose(read.reading, second, atol=1e-4)
    assert set(plan.to_json()["postures"][0]["second"]) == {joint.name for joint in plan.second}


@pytest.mark.long
def test_each_posture_of_mixed_instruments_is_for_one_of_them_by_its_rule() -> None:
    rng = np.random.default_rng(36)
    arm, given = TrueArm.drawn(rng), problem("distance", "level", "plane")
    tables = {
        "wire": distance_table(arm, rng, 8, SIGMA), "tilt": level_table(arm, rng, 15, SIGMA),
        "plates": plane_table(arm, rng, 8, SIGMA, 0.0),
    }  # fmt: skip
    data = po.read_measurements(mixed_table(tables), given)
    plan = po.plan_measurements(given, 16, given=data, candidates=150)
    assert {*plan.instruments} <= {*tables}
    assert len({*plan.instruments}) > 1
    lengths = np.asarray(tables["wire"]["distance [m]"])
    for q, point, name, place in zip(plan.q, arm.point(plan.q), plan.instruments, plan.places, strict=True):
        if name == "wire":
            far = np.linalg.norm(point - ANCHORS[int(place.removeprefix("bar"))])
            assert lengths.min() - 5e-3 < far < lengths.max() + 5e-3
        elif name == "plates":
            normal, distance = PLANES[int(place.removeprefix("plate"))]
            assert abs(point @ normal - distance) < 2e-3
        else:
            assert place == ""
            assert np.all(np.isfinite(level_axes(q[None])))
    assert plan.gain > 1
    counted = ", ".join(f"{plan.instruments.count(n)} for {n}" for n in sorted(set(plan.instruments)))
    for part in counted.split(", "):
        assert part in " ".join(plan.report().split())
    assert plan.to_csv().splitlines()[0].replace(" ", "").endswith("instrument,anchor,plane")


def test_planned_lengths_are_within_the_stroke_that_was_used() -> None:
    rng = np.random.default_rng(31)
    arm, given = TrueArm.drawn(rng), problem("distance")
    data = po.read_measurements(distance_table(arm, rng, 15, SIGMA), given)
    plan = po.plan_measurements(given, 8, given=data, candidates=60)
    code = np.array([int(name.removeprefix("bar")) for name in plan.places])
    length = np.linalg.norm(arm.point(plan.q) - ANCHORS[code], axis=1)
    for k in set(code):
        used = data.reading[data.point == data.point_names.index(f"bar{k}"), 0]
        assert np.all(length[code == k] > used.min() - 5e-3)
        assert np.all(length[code == k] < used.max() + 5e-3)
    assert plan.gain > 1
    header, first = plan.to_csv().splitlines()[:2]
    assert header.endswith((",anchor", ", anchor"))
    assert first.rpartition(",")[2].strip() == plan.places[0]
    assert [one["place"] for one in plan.to_json()["postures"]] == list(plan.places)


# --- Postures planned for a camera: a simulator of its own sees the whole board from each, and no link hides it -------

SMALL = grid(3, 4, 0.05)
SCENES = {"cell": replace(Scene(), corners=SMALL), "tool": replace(TOOL_SCENE, corners=SMALL)}


def given(where: str, folder: Path, n: int) -> tuple[po.Problem, po.Measurements, TrueArm]:
    """A problem, n pictures of the whole board, and the arm that took them."""
    rng = np.random.default_rng(2)
    arm = TrueArm.drawn(rng)
    text = camera_problem(folder, SCENES[where])
    text["data"]["markers"]["board"]["chessboard"] = {"rows": 3, "columns": 4, "square": "50 mm"}  # type: ignore[index]
    problem = po.problem_from_dict(text, folder)
    return problem, po.read_measurements(camera_table(arm, rng, n, 0.2, SCENES[where]), problem), arm


@pytest.mark.long
def test_the_whole_board_is_seen_from_planned_postures(tmp_path: Path) -> None:
    problem, data, arm = given("tool", tmp_path, 15)
    scene = SCENES["tool"]
    plan = po.plan_measurements(problem, 8, given=data, candidates=120)
    assert plan.places == ("left",) * 8
    assert plan.gain > 1
    head, *rows = plan.to_csv().splitlines()
    assert head.endswith("camera, marker")
    assert [row.split(", ")[-2:] for row in rows] == [["left", f"board/{k}"] for k in range(12)] * 8
    fronts = []
    for q in (plan.q, np.unique(data.q, axis=0)):
        for pose in arm.pose(q):
            assert scene.camera.seen(scene.pixels(pose)).all()
            world = scene.board if scene.on_tool else pose @ scene.board
            eye = (pose @ scene.camera.pose if scene.on_tool else scene.camera.pose)[:3, 3]
            middle = world[:3, :3] @ scene.corners.mean(axis=0) + world[:3, 3]
            fronts.append(float((middle - eye) @ world[:3, 2] / np.linalg.norm(middle - eye)))
            assert 0.6 < np.linalg.norm(middle - eye) < 1.5  # as far as given pictures, and so as large
    assert min(fronts) > 0.4 or max(fronts) < -0.4  # all from the same side, none edge on


def test_a_plan_for_a_recheck_reads_lengths_to_the_anchors_of_the_given_rows() -> None:
    rng = np.random.default_rng(37)
    arm, given = TrueArm.drawn(rng), problem("distance")
    data = po.read_measurements(distance_table(arm, rng, 8, SIGMA), given)
    plan = po.plan_measurements(given, 6, given=data, purpose="recheck", candidates=40)
    code = np.array([int(name.removeprefix("bar")) for name in plan.places])
    length = np.linalg.norm(arm.point(plan.q) - ANCHORS[code], axis=1)
    assert np.all(length < data.reading.max() + 5e-3)
    assert {p.name for p in plan.parameters if p.group == "place"} >= {f"anchor[bar{k}].x" for k in range(4)}
    assert plan.gain > 1
