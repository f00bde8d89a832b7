"""Paths: the best motion against brute force, steps, closed paths and speeds against independent kinematics."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

import posture_opt as po
from posture_opt.selection.program.task_path import TaskPath, between, tangents
from tests.helpers import factors
from tests.helpers.changes import changed
from tests.helpers.path_brute_force import across, bottleneck, reached, tangents_of
from tests.helpers.planar_2r import exact, postures_at
from tests.helpers.said import said
from tests.helpers.shipped import shipped_tasks
from tests.helpers.variants import conformance

PLANAR = {
    "kind": "dh",
    "joints": [
        {"name": f"joint{k}", "type": "revolute", "a": "1 m", "alpha": "0 deg", "d": "0 m", "theta": "0 deg",
         "limits": ["-180 deg", "180 deg"]}
        for k in (1, 2)
    ],
}  # fmt: skip
SIGMA = {"joint1.theta": "1 deg", "joint2.theta": "3 deg", "joint1.a": "10 mm", "joint2.a": "10 mm"}
COVARIANCE = np.diag([math.radians(1) ** 2, math.radians(3) ** 2, 1e-4, 1e-4])


def metres(points):
    return [[f"{v:.9f} m" for v in point] for point in points]


def arc(count, centre=(1.0, 0.5), radius=0.3):
    """(count, 3) points of a half circle in the plane."""
    angle = np.linspace(0, np.pi, count)
    return np.column_stack([centre[0] + radius * np.cos(angle), centre[1] + radius * np.sin(angle), 0 * angle])


def planar(points, **task):
    return po.problem_from_dict({
        "robot": PLANAR, "uncertainty": {"sigma": SIGMA},
        "task": {"kind": "trace", "points": metres(points), "spacing": "9 m", **task},  # at these points alone
    })  # fmt: skip


def preset(name, points, axis=None, **task):
    axes = {} if axis is None else {"axes": [list(axis)] * len(points)}
    return po.problem_from_dict({
        "robot": {"kind": "preset", "name": name},
        "task": {"kind": "trace", "points": metres(points), "spacing": "9 m", **axes, **task},
    })  # fmt: skip


def bent(start, middle, end, count):
    """(count, 3) points of a quadratic Bézier curve."""
    s = np.linspace(0, 1, count)[:, None]
    return (1 - s) ** 2 * np.array(start) + 2 * s * (1 - s) * np.array(middle) + s**2 * np.array(end)


def test_planar_motion_is_the_best_of_all_sequences_of_elbows():
    points = arc(7)
    found = po.select_posture(planar(points))
    both = postures_at(points[:, :2])  # (2, 7, 2)
    t = tangents_of(points)[:, :2]
    normal = np.column_stack([-t[:, 1], t[:, 0]])
    best = math.inf
    for elbows in itertools.product((0, 1), repeat=len(points)):
        Q = both[list(elbows), range(len(points))]
        if np.max(np.abs(np.diff(Q, axis=0))) <= found.largest_step:
            C = exact(Q, COVARIANCE)
            best = min(best, math.sqrt(np.max(np.einsum("ki,kij,kj->k", normal, C, normal))))
    assert found.critical.sigma_max == pytest.approx(best, rel=1e-8)  # points are written with nine digits
    assert found.status == "optimal"


@pytest.mark.conformance
def test_panda_is_as_good_as_its_self_motion_searched_on_a_grid():
    """Six effective joints and five rows: one freedom, of which joint 3 is the coordinate."""
    points = bent((0.45, -0.3, 0.2), (0.6, 0.0, 0.35), (0.45, 0.35, 0.3), 6)
    problem = preset("panda", points, (0, 0, -1))
    found = po.select_posture(problem)
    robot, rng = problem.robot, np.random.default_rng(0)
    sigma, layers, costs = np.sqrt(np.diag(problem.sources.covariance)), [], []
    for point, tangent in zip(points, tangents_of(points), strict=True):
        held = np.repeat(np.radians(np.arange(-166, 166, 4.0)), 8)
        Q = rng.uniform(robot.lower, robot.upper, (len(held), 7))
        Q[:, 2], Q[:, 6] = held, 0
        layers.append(reached(robot, Q, point, np.array([0, 0, -1.0]), [0, 1, 3, 4, 5]))
        costs.append(across(robot, layers[-1], tangent, sigma))
    best = bottleneck(layers, costs, found.largest_step, ignored=(6,))
    # The grid stands 2° off its optimum at most; first order is good to 1e-6 of these scatters.
    assert found.critical.sigma_max <= best * (1 + 1e-4)
    assert found.critical.sigma_max >= max(cost.min() for cost in costs) * 0.98


def test_ur10_finds_the_best_of_its_eight_branches():
    points = bent((0.5, -0.4, 0.3), (0.9, 0.1, 0.1), (0.45, 0.45, 0.4), 5)
    axis = np.array([0.3, 0.1, -1.0]) / np.linalg.norm([0.3, 0.1, -1.0])
    problem = preset("ur10", points, axis).replace(cell={"mounting": "none"})  # all branches, those below the base too
    found = po.select_posture(problem)
    robot, rng = problem.robot, np.random.default_rng(0)
    sigma, layers, costs = np.sqrt(np.diag(problem.sources.covariance)), [], []
    for point, tangent in zip(points, tangents_of(points), strict=True):
        Q = rng.uniform(-np.pi, np.pi, (250, 6))
        Q[:, 5] = 0
        layers.append(reached(robot, Q, point, axis, [0, 1, 2, 3, 4]))
        costs.append(across(robot, layers[-1], tangent, sigma))
    assert min(map(len, layers)) == 8
    best = bottleneck(layers, costs, found.largest_step, ignored=(5,))
    assert found.critical.sigma_max == pytest.approx(best, rel=1e-5)


@pytest.mark.parametrize(
    "problem",
    [
        pytest.param(
            preset("ur10", bent((0.5, -0.4, 0.3), (0.9, 0.1, 0.1), (0.45, 0.45, 0.4), 9), largest_step="12 deg"),
            marks=pytest.mark.conformance,
        ),
        preset("scara", bent((0.2, -0.15, -0.1), (0.32, 0.0, -0.02), (0.2, 0.15, -0.05), 9)),
    ],
    ids=["ur10 with its axis free", "scara"],
)
def test_the_answer_keeps_its_word(problem):
    """Points, axis, limits and steps by the product of the chain's factors."""
    found, robot = po.select_posture(problem), problem.robot
    T = np.array([factors.pose(robot, q) for q in found.motion.Q])
    np.testing.assert_allclose(T[:, :3, 3], found.path.points, atol=1e-7)
    if problem.task.axes is not None:
        np.testing.assert_allclose(T[:, :3, 2], found.path.axes, atol=1e-6)
    assert np.all(np.array(robot.lower) - 1e-12 <= found.motion.Q)
    assert np.all(np.array(robot.upper) + 1e-12 >= found.motion.Q)
    listed = found.motion.Q[found.path.listed]
    steps = np.abs(np.diff(listed, axis=0)).max()
    assert steps == pytest.approx(found.largest_joint_step, abs=1e-12)
    assert found.smallest_step - 1e-6 <= steps <= found.largest_step + 1e-9
    assert problem.task.largest_step in (None, found.largest_step)
    document = found.to_json()
    assert len(document["path"]) == len(listed) == len(problem.task.points)
    sigmas = [point["critical"]["sigma_max"] for point in document["path"]]
    assert max(sigmas) <= document["sigma_max"] == document["critical"]["sigma_max"] == found.sigma_max
    assert document["sigma_max"] >= document["sigma_max_bound"] * (1 - 1e-9)
    assert document["posture"] == document["path"][0]["posture"]


def test_a_line_that_is_given_by_its_ends_is_followed_between_them():
    """Coarse, it led from one branch into another, and the tool off the line by 432 mm."""
    points = np.array([[0.5, -0.3, 0.25], [-0.2, -0.3, 0.25]])
    problem = preset("ur10e", points, (0, 0, -1)).replace(task__spacing=None, cell="none")
    found, near = po.select_posture(problem), po.select_posture(problem.replace(task__spacing="20 mm"))
    assert found.breaks == ()
    assert len(found.to_json()["path"]) == 2
    assert found.critical.sigma_max == pytest.approx(near.critical.sigma_max, rel=1e-6)
    assert found.off_line < 5e-3
    between = found.law.highest / near.law.highest  # joints are as fast between the points as dense points say
    assert between == pytest.approx(1, abs=0.015)


def test_two_points_with_a_free_axis_keep_to_their_bound():
    """So few candidates stand near the optimum that the motion finds better postures than any of them."""
    found = po.select_posture(preset("ur10", np.array([[0.45, -0.2, 0.25], [0.48, -0.1, 0.25]])))
    # The criterion rounds the corner where both axes are equal by some 1e-8.
    assert found.critical.sigma_max >= found.bound * (1 - 1e-6)


def test_look_ahead_beats_following_the_first_point():
    """The lecture's arm: the elbow that is best at the first point is the worse one at the last."""
    found = po.select_posture(planar(arc(9, centre=(0.9, 0.6), radius=0.5)))
    assert found.naive.each.largest_step > found.largest_joint_step
    assert found.naive.onward is None or found.naive.onward.sigma.max() >= found.motion.sigma.max() * (1 - 1e-9)


def test_a_joint_with_wide_limits_turns_on_past_half_a_turn():
    angle = np.linspace(-2.6, 2.9, 23) + 0.7
    points = np.column_stack([0.7 * np.cos(angle), 0.7 * np.sin(angle), 0 * angle + 0.2])
    found = po.select_posture(preset("ur10", points, (0, 0, -1)))
    assert math.degrees(np.ptp(found.motion.Q[:, 0])) == pytest.approx(math.degrees(5.5), abs=3)
    assert found.largest_joint_step < math.radians(20)


@pytest.mark.long
def test_a_step_that_is_too_small_is_refused_with_the_least_that_does():
    points = bent((0.45, -0.3, 0.2), (0.6, 0.0, 0.35), (0.45, 0.35, 0.3), 5)
    with pytest.raises(
        po.errors.NoSolutionError, match=r"from point \d to point \d .* set largest_step: [\d.]+ deg"
    ) as caught:
        po.select_posture(preset("panda", points, (0, 0, -1), largest_step="3 deg"))
    least = caught.value.solution.smallest_step
    assert caught.value.solution.reasons[0].amount == pytest.approx(least - math.radians(3))
    able = math.ceil(math.degrees(least) * 10) / 10
    assert po.select_posture(preset("panda", points, (0, 0, -1), largest_step=f"{able} deg")).status != "infeasible"
    with pytest.raises(po.errors.NoSolutionError):
        po.select_posture(preset("panda", points, (0, 0, -1), largest_step=f"{0.95 * math.degrees(least)} deg"))


def test_a_point_out_of_reach_is_named_with_the_distance():
    points = np.array([[1.0, 0.5, 0], [1.2, 0.5, 0], [2.1, 0, 0], [1.2, 0, 0]])
    with pytest.raises(po.errors.NoSolutionError, match=r"point 3: the target is out of reach by 100 mm"):
        po.select_posture(planar(points))


def test_a_path_off_the_plane_of_the_arm_is_refused_with_its_worst_point():
    points = np.array([[1.0, 0.0, 0.0], [1.0, 0.1, 0.05], [1.0, 0.2, -0.1]])
    with pytest.raises(po.errors.NoSolutionError, match=r"point 3: the target lies 100 mm outside the plane") as caught:
        po.select_posture(planar(points))
    assert caught.value.exit_code == 3
    assert caught.value.solution.reasons[0].amount == pytest.approx(0.1)


def test_a_path_of_too_many_points_is_refused_with_the_number_that_is_accepted(tmp_path):
    points = [["1 m", f"{k} um", "0 m"] for k in range(10_001)]
    with pytest.raises(po.errors.InputError, match="10001 points are more than the 10000") as caught:
        po.problem_from_dict({"robot": PLANAR, "task": {"kind": "trace", "points": points}})
    assert caught.value.exit_code == 2
    file = tmp_path / "long.csv"
    file.write_text("x [m], y [um]\n" + "".join(f"1, {k}\n" for k in range(10_001)))
    with pytest.raises(po.errors.InputError, match="more than the 10000 points"):
        po.problem_from_dict({"robot": PLANAR, "task": {"kind": "trace", "path": str(file)}})
    with pytest.raises(po.errors.InputError, match=r"task.spacing: 200001 points are more than the 10000"):
        po.select_posture(planar([[1, 0, 0], [1.2, 0, 0]], spacing="1 um"))


def test_spacing_adds_points_and_drops_none():
    task = planar([[1, 0, 0], [1.25, 0, 0], [1.3, 0, 0]], spacing="100 mm", axes=[[1, 0, 0], [0, 1, 0], [0, 1, 0]]).task
    path = TaskPath.of(task)
    assert path.listed.tolist() == [True, False, False, True, True]
    assert path.parts.tolist() == [3, 3, 3, 1]
    np.testing.assert_allclose(path.points[path.listed], task.points)
    np.testing.assert_allclose(path.points[1], [1 + 0.25 / 3, 0, 0])
    np.testing.assert_allclose(path.axes[1], [math.cos(math.pi / 6), math.sin(math.pi / 6), 0], atol=1e-12)
    assert np.max(np.diff(path.lengths)) <= 0.1
    np.testing.assert_allclose(between(np.array([0, 0, 1.0]), np.array([1.0, 0, 0]), 0.5), [0.5**0.5, 0, 0.5**0.5])


def test_a_seam_is_followed_at_its_stand_off():
    problem = po.load_problem("weld_planar_2r")
    found = po.select_posture(problem)
    np.testing.assert_allclose(found.path.points - problem.task.points, [[0, 0.01, 0]] * 5, atol=1e-12)
    tool = [point["tool"]["position"] for point in found.to_json()["path"]]
    np.testing.assert_allclose(tool, found.path.points, atol=1e-8)


def test_a_torch_points_along_the_seams_own_axes():
    points = bent((0.6, -0.3, 0.2), (0.8, 0.0, 0.1), (0.6, 0.3, 0.2), 5)
    axes = [[0.2, 0.1 * k, -1.0] for k in range(5)]
    problem = preset("ur10", points).with_task("weld", axes=axes, points=metres(points), standoff="15 mm",
                                                spacing="9 m")  # fmt: skip
    found = po.select_posture(problem)
    d = np.array(axes) / np.linalg.norm(axes, axis=1, keepdims=True)
    for q, axis, point in zip(found.motion.Q, d, points, strict=True):
        T = factors.pose(problem.robot, q)
        np.testing.assert_allclose(T[:3, 2], axis, atol=1e-6)
        np.testing.assert_allclose(T[:3, 3] + 0.015 * axis, point, atol=1e-7)


def test_other_commands_say_that_they_take_one_target():
    problem = po.load_problem("weld_planar_2r")
    with pytest.raises(po.errors.InputError, match="the task has a path"):
        po.PostureSelector(problem)
    with pytest.raises(po.errors.InputError):
        po.map_targets(problem, counts=(3, 3))


SEAMS = [path for path, task in shipped_tasks().items() if task.on_path]


@pytest.mark.parametrize(
    "path",
    conformance(SEAMS, [path for path in SEAMS if path.stem in ("dispense_planar_2r", "trace_scara")]),
    ids=lambda path: path.stem,
)
def test_built_in_seams_come_near_their_bound(path):
    found = po.select_posture(po.load_problem(path))
    assert found.status == "optimal"
    assert not found.reasons
    # Within what was measured when they were written: a Panda's bead costs 2.2 %, the others 1.1 % at most.
    assert found.bound * (1 - 1e-6) <= found.critical.sigma_max <= 1.03 * found.bound


@pytest.mark.conformance
def test_a_placed_path_is_as_good_as_the_best_on_a_grid_of_placements():
    points = arc(4, centre=(0.0, 0.0), radius=0.15)
    free = {"x": ["0.5 m", "1.3 m"], "y": ["-0.2 m", "0.9 m"]}
    found = po.select_posture(planar(points, workpiece=free, largest_step="60 deg"))
    best = math.inf
    t = tangents_of(points)[:, :2]
    normal = np.column_stack([-t[:, 1], t[:, 0]])
    for x, y in itertools.product(np.linspace(0.5, 1.3, 33), np.linspace(-0.2, 0.9, 45)):
        for Q in postures_at(points[:, :2] + [x, y]):  # one elbow for all points
            Q = np.unwrap(Q, axis=0)
            if np.isfinite(Q).all() and np.abs(np.diff(Q, axis=0)).max() <= math.radians(60):
                C = exact(Q, COVARIANCE)
                best = min(best, math.sqrt(np.max(np.einsum("ki,kij,kj->k", normal, C, normal))))
    assert found.critical.sigma_max <= best * 1.001
    assert found.critical.sigma_max >= best * 0.97, "the grid is too coarse to judge"
    w = found.to_json()["workpiece"]
    assert 0.5 <= w["x"] <= 1.3
    assert -0.2 <= w["y"] <= 0.9
    np.testing.assert_allclose(found.path.points, points + np.array([w["x"], w["y"], 0]), atol=1e-9)
    assert found.gain_over(found.central) > 0


def test_a_workpiece_that_stands_moves_and_turns_its_path():
    points = bent((-0.1, -0.1, 0.0), (0.1, 0.0, 0.05), (-0.1, 0.1, 0.0), 4)
    stood = preset("panda", points, (0.1, 0, -1), workpiece={"x": "0.5 m", "z": "0.2 m", "yaw": "30 deg"})
    found = po.select_posture(stood)
    c, s = math.cos(math.pi / 6), math.sin(math.pi / 6)
    R = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    for q, point in zip(found.motion.Q, points, strict=True):
        T = factors.pose(stood.robot, q)
        np.testing.assert_allclose(T[:3, 3], R @ point + [0.5, 0, 0.2], atol=1e-7)
        np.testing.assert_allclose(T[:3, 2], R @ [0.1, 0, -1] / math.hypot(0.1, 1), atol=1e-6)
    assert found.to_json()["workpiece"] == pytest.approx({"x": 0.5, "y": 0, "z": 0.2, "yaw": math.pi / 6})


def behind_a_scara(*across: float) -> po.Problem:
    task = {"kind": "dispense", "points": [[f"{x} m" for x in (-0.15, y, -0.08)] for y in across]}
    return po.problem_from_dict(
        {"robot": {"kind": "preset", "name": "scara"}, "uncertainty": {"repeatability": "0.02 mm"}, "task": task,
         "cell": "none"}
    )  # fmt: skip


def test_a_path_that_fails_is_explained_by_its_worst_point() -> None:
    """Behind a SCARA the point on the axis of symmetry needs most of its first joint."""
    with pytest.raises(po.errors.NoSolutionError, match="point 4: joint1 would have to go to") as caught:
        po.select_posture(behind_a_scara(0.06, 0.022, 0.011, 0.0, -0.011, -0.022, -0.06))
    # The law of cosines at 150 mm, straight behind: the angle that the joint needs.
    first, second = 0.22, 0.13
    shoulder = np.arccos((first**2 + 0.15**2 - second**2) / (2 * first * 0.15))
    beyond = 180 - np.degrees(shoulder) - 140
    (reason,) = caught.value.solution.reasons
    assert np.degrees(reason.amount) == pytest.approx(beyond, abs=0.01)
    # Limits that reach there alone would make the arm turn round in the middle of the path.
    assert not caught.value.solution.relaxations


def test_a_change_of_limits_leads_along_the_whole_path_without_a_break() -> None:
    problem = behind_a_scara(0.06, 0.022, 0.011, 0.0)
    with pytest.raises(po.errors.NoSolutionError) as caught:
        po.select_posture(problem)
    assert caught.value.solution.relaxations
    for relaxation in caught.value.solution.relaxations:
        found = po.select_posture(changed(problem, relaxation))
        assert found.status != "infeasible"
        assert not found.breaks


def test_tangents_bisect_corners_and_go_round_closed_paths():
    corner = np.array([[0, 0, 0], [1, 0, 0], [1, 5, 0.0]])
    np.testing.assert_allclose(tangents(corner), [[1, 0, 0], [0.5**0.5, 0.5**0.5, 0], [0, 1, 0]], atol=1e-12)
    square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 0.0]])
    np.testing.assert_allclose(tangents(square)[[0, -1]], [[0.5**0.5, -(0.5**0.5), 0]] * 2, atol=1e-12)
    back = np.array([[0, 0, 0], [1, 0, 0], [0, 0, 0.0]])
    assert np.abs(tangents(back)[1]) == pytest.approx([1, 0, 0])


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
    assert document["closed"] is False
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
