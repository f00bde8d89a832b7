"""Paths as motions: steps within the limits, closed paths, constant speed, against kinematics of two links."""

from __future__ import annotations

import math

import numpy as np
import pytest

import posture_opt as po
from tests.helpers import factors
from tests.helpers.said import said

SLOW = {"joint1": "60 deg/s", "joint2": "90 deg/s"}


def links(count=2, limit=180, velocity=None):
    joints = [{"name": f"joint{k + 1}", "a": "1 m", "limits": [f"{-limit} deg", f"{limit} deg"]} for k in range(count)]
    return {"kind": "dh", "joints": joints, **({} if velocity is None else {"velocity": velocity})}


def problem(points, robot=None, **task):
    robot = links() if robot is None else robot
    sigma = {f"joint{k + 1}.theta": f"{0.1 * (k + 1)} deg" for k in range(len(robot["joints"]))}
    listed = [[f"{v:.9f} m" for v in point] for point in points]
    task = {"kind": "trace", "points": listed, "spacing": "9 m", **task}  # at these points alone
    return po.problem_from_dict({"robot": robot, "uncertainty": {"sigma": sigma}, "task": task})


def tool(Q):
    """(K, 2) tool points of links of 1 m, joints (K, n) in rad."""
    turned = np.cumsum(Q, axis=1)
    return np.column_stack([np.cos(turned).sum(axis=1), np.sin(turned).sum(axis=1)])


def ring(count, centre=(0.0, 0.0), radius=1.2, turn=2 * math.pi):
    """(count, 3) points of an arc that begins at +x; a whole turn of it ends where it begins."""
    angle = np.linspace(0, turn, count)
    points = np.column_stack([centre[0] + radius * np.cos(angle), centre[1] + radius * np.sin(angle), 0 * angle])
    if turn == 2 * math.pi:
        points[-1] = points[0]
    return points


def rates(document, Q):
    """(K − 1, n) |dq/dt| by differences [rad/s]."""
    return np.abs(np.diff(Q, axis=0)) / np.diff(document["times"])[:, None]


def postures(document):
    return np.array([list(point["posture"].values()) for point in document["path"]])


def test_highest_speed_is_where_the_first_joint_meets_its_limit():
    points = ring(8, (0.9, 0.5), 0.4, 4.0)
    found = po.select_posture(problem(points, links(velocity=SLOW), speed="highest"))
    document = found.to_json()
    Q, limits = postures(document), np.radians([60, 90])
    np.testing.assert_allclose(tool(Q), points[:, :2], atol=1e-7)
    used = rates(document, Q) / limits
    assert used.max() == pytest.approx(1, abs=1e-9)
    assert document["limiting_joint"] == f"joint{np.unravel_index(used.argmax(), used.shape)[1] + 1}"
    gone = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    np.testing.assert_allclose(document["times"], gone / document["speed"], rtol=1e-7)
    assert document["speed"] == document["highest_speed"]
    assert document["closed"] is False


def test_without_known_speeds_only_a_stated_one_has_times():
    points = ring(5, (0.9, 0.5), 0.4, 2.0)
    document = po.select_posture(problem(points)).to_json()
    assert (document["times"], document["speed"], document["limiting_joint"]) == (None, None, None)
    document = po.select_posture(problem(points, speed="20 mm/s")).to_json()
    assert document["times"][-1] == pytest.approx(np.linalg.norm(np.diff(points, axis=0), axis=1).sum() / 0.02)
    with pytest.raises(
        po.errors.InputError, match=r"task.speed: no largest speed of a joint is known – add robot: velocity"
    ):
        po.select_posture(problem(points, speed="highest"))


def test_a_stated_speed_is_kept_by_another_motion_where_the_best_one_is_too_slow():
    """Past the base the arm with its elbow bent is fast; the least spread is bought with steps near the base."""
    points = np.column_stack([np.linspace(-0.5, 0.5, 6), np.full(6, 0.35), np.zeros(6)])
    robot = links(3, velocity={"joint1": "90 deg/s", "joint2": "90 deg/s", "joint3": "90 deg/s"})
    free = po.select_posture(problem(points, robot, largest_step="80 deg"))
    asked = 1.15 * free.law.highest
    kept = po.select_posture(problem(points, robot, largest_step="80 deg", speed=f"{asked} m/s"))
    document = kept.to_json()
    Q = postures(document)
    np.testing.assert_allclose(tool(Q), points[:, :2], atol=1e-7)
    assert rates(document, Q).max() <= math.radians(90) * (1 + 1e-6)
    assert np.diff(document["times"]) == pytest.approx(0.2 / asked)
    assert kept.sigma_max >= free.sigma_max * (1 - 1e-6)


def test_a_speed_that_no_motion_keeps_is_refused_with_one_that_does():
    points = ring(7, (0.9, 0.5), 0.4, 3.0)
    with pytest.raises(
        po.errors.NoSolutionError, match=r"between points \d and \d, and .* is its limit: set speed:"
    ) as caught:
        po.select_posture(problem(points, links(velocity=SLOW), speed="5 m/s"))
    offered = caught.value.solution.reasons[0].message.rpartition("set speed: ")[2]
    document = po.select_posture(problem(points, links(velocity=SLOW), speed=offered)).to_json()
    assert (rates(document, postures(document)) / np.radians([60, 90])).max() <= 1
    assert caught.value.exit_code == 3


@pytest.mark.parametrize("count", [2, pytest.param(3, marks=pytest.mark.long)])
def test_a_closed_path_ends_in_the_posture_in_which_it_begins(count):
    """Three links: one freedom, with which an open motion ends elsewhere."""
    points = ring(7, (0.9, 0.9), 0.35)
    found = po.select_posture(problem(points, links(count), closed=True))
    document = found.to_json()
    Q = postures(document)
    np.testing.assert_allclose(tool(Q), points[:, :2], atol=1e-7)
    np.testing.assert_allclose(Q[-1], Q[0], atol=1e-9)
    assert document["closed"] is True
    assert document["whole_turns"] == {}
    assert np.abs(np.diff(Q, axis=0)).max() <= document["largest_step"] + 1e-9
    if count == 3:
        open_one = po.select_posture(problem(points, links(count))).to_json()
        assert np.abs(postures(open_one)[-1] - postures(open_one)[0]).max() > 1e-3
        assert open_one["closed"] is False
        assert document["sigma_max"] >= open_one["sigma_max"] * (1 - 1e-6)


def test_round_the_base_the_first_joint_ends_a_whole_turn_away():
    found = po.select_posture(problem(ring(13), links(limit=400), closed=True))
    document = found.to_json()
    Q = postures(document)
    assert abs(document["whole_turns"]["joint1"]) == 1
    np.testing.assert_allclose(Q[-1] - Q[0], [2 * math.pi * document["whole_turns"]["joint1"], 0], atol=1e-9)
    assert document["breaks"] == []
    assert said(found)["selection.path-turned"].about == "joint1"


def test_a_path_through_the_base_is_singular_there_and_no_step_leaves_the_limits():
    found = po.select_posture(problem([[0.5, 0, 0], [-0.5, 0, 0]], spacing="50 mm"))
    document = found.to_json()
    (one,) = document["breaks"]
    assert (one["first"], one["last"], one["kind"]) == (1, 2, "singular")
    assert math.pi - 0.1 < one["moved"] < 2 * math.pi  # the first joint turns by a half turn, or the second unwinds
    assert max(document[key] for key in ("largest_joint_step", "largest_step", "smallest_step")) <= 2 * math.pi
    np.testing.assert_allclose(tool(found.motion.Q), found.path.points[:, :2], atol=1e-7)
    apart = np.sort(np.abs(np.diff(found.motion.Q, axis=0)).max(axis=1))
    assert apart[-2] < math.radians(5)
    assert said(found)["selection.path-singular"].about == one["joint"]


def test_spatial_motions_keep_speed_and_close():
    points = ring(9, (0.65, 0.1), 0.15)
    points[:, 2] = 0.25
    listed = [[f"{v:.9f} m" for v in point] for point in points]
    found = po.select_posture(
        po.problem_from_dict({
            "robot": {"kind": "preset", "name": "ur10"}, "cell": "none",
            "task": {"kind": "weld", "points": listed, "spacing": "9 m", "closed": True, "speed": "highest"},
        })
    )  # fmt: skip
    document = found.to_json()
    Q, robot = postures(document), found.problem.robot
    np.testing.assert_allclose([factors.pose(robot, q)[:3, 3] for q in Q], points, atol=1e-7)
    np.testing.assert_allclose(Q[-1], Q[0], atol=1e-9)
    used = rates(document, Q) / np.radians([120, 120, 180, 180, 180, 180])
    assert used.max() == pytest.approx(1, abs=1e-9)
    assert robot.joint_names[np.unravel_index(used.argmax(), used.shape)[1]] == document["limiting_joint"]


@pytest.mark.long
def test_a_long_path_is_as_good_as_all_ways_through_its_elbows():
    """More points than are searched one by one; every way without a jump keeps one of both elbows."""
    points = ring(301, (0.9, 0.6), 0.5, 4.5)
    found = po.select_posture(problem(points))
    best = math.inf
    for sign in (1, -1):
        x, y = points[:, 0], points[:, 1]
        elbow = sign * np.arccos((x**2 + y**2 - 2) / 2)
        first = np.arctan2(y, x) - np.arctan2(np.sin(elbow), 1 + np.cos(elbow))
        along = np.gradient(points[:, :2], axis=0)
        across = np.column_stack([-along[:, 1], along[:, 0]]) / np.linalg.norm(along, axis=1)[:, None]
        J = np.array([[-y, -np.sin(first + elbow)], [x, np.cos(first + elbow)]])
        moved = np.einsum("ajk,ka->kj", J, across) * np.radians([0.1, 0.2])
        best = min(best, float(np.linalg.norm(moved, axis=1).max()))
    assert found.sigma_max == pytest.approx(best, rel=2e-3)  # the ends' tangents, and first order
    np.testing.assert_allclose(tool(found.motion.Q), points[:, :2], atol=1e-7)
    assert len(found.to_json()["path"]) == 301
    assert found.status == "optimal"


@pytest.mark.parametrize(
    ("task", "message"),
    [
        ({"closed": True}, "the path is closed, and its last point is"),
        ({"speed": "0 mm/s"}, "the speed is not above zero"),
        ({"speed": "fast"}, "is not a finite number with a unit"),
        ({"speed": "20 mm"}, "'mm' is not a unit of velocity"),
    ],
)
def test_what_is_no_motion_is_refused(task, message):
    with pytest.raises(po.errors.InputError, match=message):
        problem(ring(5, turn=2.0), **task)
