"""Errors of workpiece and features in what a task says, against own kinematics, rigid motions and random draws."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
import trimesh

import posture_opt as po
from posture_opt.selection.select_posture import task_objective
from tests.helpers.brute_force import elementary
from tests.helpers.said import said

JOINTS = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
SIGMA = np.array([0.1, 0.08, 0.12, 0.2, 0.2, 0.3]) * 1e-3
POSITION, ANGLE, FEATURE = 0.05e-3, np.radians(0.02), 0.02e-3
ERRORS = {"workpiece": {"position": "0.05 mm", "angle": "0.02 deg"}, "feature": {"position": "0.02 mm"}}
DRAWS = 40_000
CORNERS = ((60, 40, 0), (-60, 40, 10), (-60, -40, 0), (60, -40, 20))


def problem(errors=ERRORS, **task):
    stated = {"sigma": {f"{name}.theta": f"{s * 1e3:g} mrad" for name, s in zip(JOINTS, SIGMA, strict=True)}}
    return po.problem_from_dict({
        "robot": {"kind": "preset", "name": "ur10e", "tool": {"xyz": ["0 m", "0 m", "150 mm"]}},
        "uncertainty": stated | errors,
        "task": {"kind": "insert", **task},
    })  # fmt: skip


def on_plate():
    features = [{"name": f"hole {k}", "position": [f"{v} mm" for v in corner]} for k, corner in enumerate(CORNERS, 1)]
    placed = {"workpiece": {"x": "600 mm", "y": "-150 mm", "z": "100 mm", "yaw": "30 deg"}}
    return problem(features=features, clearance="0.15 mm", **placed)


def moved(found, errors):
    """(N, 4, 4) own tool poses at the posture of an answer, with joint errors (N, n)."""
    T = np.tile(np.eye(4), (len(errors), 1, 1))
    for f in found.optimisation_problem.robot.factors:
        value = np.full(len(errors), f.nominal)
        T = T @ elementary(f.kind, f.axis, value if f.joint is None else value + found.q[f.joint] + errors[:, f.joint])
    return T


def turns(vectors):
    """(N, 3, 3) rotation matrices of rotation vectors, by the series of the exponential."""
    K = np.zeros((len(vectors), 3, 3))
    K[:, 0, 1], K[:, 0, 2], K[:, 1, 2] = -vectors[:, 2], vectors[:, 1], -vectors[:, 0]
    K -= K.transpose(0, 2, 1)
    return np.eye(3) + K + K @ K / 2 + K @ K @ K / 6


def seen_from_hole(found, origin, errors, shared, own, back=0.0):
    """(N, 3) shift of the tool, ``back`` [m] behind its tip, from where it would be in its hole, in the hole's axes."""
    at = np.array(found.target.lower)
    t, R = shared
    nominal, T = moved(found, np.zeros((1, 6)))[0], moved(found, errors)
    assert np.allclose(nominal[:3, 3], at, atol=1e-6)
    nominal_point, points = nominal[:3, 3] - back * nominal[:3, 2], T[:, :3, 3] - back * T[:, :3, 2]
    # The tool in the frame of the workpiece that has moved, less where it is without errors.
    in_part = np.einsum("nji,nj->ni", R, points - origin - t)
    return in_part - own - (nominal_point - origin)


def drawn(rng):
    """Joint errors, shift and turn of the workpiece, shift of the feature."""
    normal = rng.standard_normal
    shared = POSITION * normal((DRAWS, 3)), turns(ANGLE * normal((DRAWS, 3)))
    return SIGMA * normal((DRAWS, 6)), shared, FEATURE * normal((DRAWS, 3))


def hits(shift, clearance):
    return np.linalg.norm(shift[:, :2], axis=1) <= clearance  # all holes look down


def within_error(p, share):
    return abs(p - share) < 4 * np.sqrt(share * (1 - share) / DRAWS)


@pytest.fixture(scope="module")
def single():
    return po.select_posture(problem(position=["0.6 m", "0.2 m", "0.1 m"], clearance="0.15 mm"))


@pytest.mark.long
def test_one_target_is_the_origin_of_its_workpiece(single):
    arm = po.propagate(single.problem, single.q)
    plain = po.propagate(problem({}, position=["0.6 m", "0.2 m", "0.1 m"]), single.q)
    assert np.array_equal(arm.covariance, plain.covariance)  # the arm does not err more for it
    added = (POSITION**2 + FEATURE**2) * np.eye(3)
    assert np.allclose(single.covariance, arm.covariance + added, rtol=1e-12)
    assert single.sigma_max == pytest.approx(np.sqrt(np.linalg.eigvalsh(single.covariance[:2, :2])[-1]), rel=1e-9)
    assert arm.for_task.critical.sigma_max == pytest.approx(single.sigma_max, rel=1e-12)
    value = task_objective(single.problem)[0](single.q)[0]
    assert float(value) == pytest.approx(single.sigma_max**2, rel=2e-4)
    errors, shared, own = drawn(np.random.default_rng(1))
    share = np.mean(hits(seen_from_hole(single, single.target.lower, errors, shared, own), 0.15e-3))
    assert within_error(single.success_probability, share)
    cloud = po.simulate(single.problem, single.q, n=20_000, seed=3)
    assert abs(cloud.success - share) < 4 * np.sqrt(share * (1 - share) * (1 / DRAWS + 1 / cloud.n))
    assert np.allclose(cloud.relative.covariance, single.covariance, rtol=0.05, atol=1e-10)


def test_budget_bound_and_what_helps_name_the_workpiece(single):
    shares = {share.parameter: share.share for share in single.budget}
    assert sum(shares.values()) == pytest.approx(1.0, abs=1e-9)
    assert shares["workpiece.position"] == pytest.approx((POSITION / single.sigma_max) ** 2, rel=1e-6)
    assert shares["feature.position"] == pytest.approx((FEATURE / single.sigma_max) ** 2, rel=1e-6)
    assert shares["workpiece.angle"] == 0.0
    lever = np.linalg.norm(single.target.lower[:2])
    floor = np.sqrt((SIGMA[0] * lever) ** 2 + POSITION**2 + FEATURE**2)
    assert single.lower_bound.sigma == pytest.approx(floor, rel=1e-6)
    halved = next(one for one in single.improvements if getattr(one, "parameter", "") == "workpiece.position")
    assert halved.sigma == POSITION
    assert halved.sigma_max == pytest.approx(np.sqrt(single.sigma_max**2 - 0.75 * POSITION**2), rel=1e-9)
    (calibrated,) = [one for one in single.improvements if one.change == "calibrate"]
    assert calibrated.sigma_max > np.hypot(POSITION, FEATURE)  # which no calibration of the arm removes
    stated = single.to_json()["workpiece_errors"]
    assert stated.pop("origin") == pytest.approx([0.6, 0.2, 0.1], abs=1e-6)
    assert stated == pytest.approx({"position": POSITION, "angle": ANGLE, "feature": FEATURE})
    text = single.report(full=True)
    assert "workpiece position 0.05 mm, workpiece angle 0.349 mrad, feature position 0.02 mm" in text
    assert re.search(r"halve σ +workpiece.position +0.025 mm", text)


@pytest.mark.long
def test_the_angle_tilts_the_hole_of_a_peg():
    errors = {"workpiece": {"angle": "0.1 deg"}}
    found = po.select_posture(
        problem(errors, position=["0.6 m", "0.2 m", "0.1 m"], clearance="0.15 mm", length="60 mm")
    )
    rng = np.random.default_rng(2)
    joints, angle = SIGMA * rng.standard_normal((DRAWS, 6)), np.radians(0.1)
    shared = np.zeros(3), turns(angle * rng.standard_normal((DRAWS, 3)))
    ends = [seen_from_hole(found, found.target.lower, joints, shared, 0.0, back) for back in (0.0, 0.06)]
    peg = found.task_spread.peg
    for critical, shift in zip((peg.tip, peg.top), ends, strict=True):
        sampled = np.sqrt(np.linalg.eigvalsh(np.cov(shift[:, :2].T))[-1])
        assert critical.sigma_max == pytest.approx(sampled, rel=0.01)
    assert peg.top.sigma_max > 0.95 * 0.06 * angle  # without the tilt of the hole it would be less
    assert within_error(found.success_probability, np.mean(hits(ends[0], 0.15e-3) & hits(ends[1], 0.15e-3)))
    shares = {share.parameter: share.share for share in found.budget}
    assert sum(shares.values()) == pytest.approx(1.0, abs=1e-9)
    assert shares["workpiece.angle"] == pytest.approx((0.06 * angle / found.sigma_max) ** 2, rel=1e-4)


@pytest.mark.long
def test_features_share_the_draw_of_their_workpiece():
    found = po.select_posture(on_plate())
    rng, origin = np.random.default_rng(4), np.array([0.6, -0.15, 0.1])
    joints, shared, _ = drawn(rng)
    every = np.ones(DRAWS, dtype=bool)
    for one in found.stations:
        shift = seen_from_hole(one, origin, joints, shared, FEATURE * rng.standard_normal((DRAWS, 3)))
        hit = hits(shift, 0.15e-3)
        assert within_error(one.success_probability, np.mean(hit))
        assert np.allclose(np.cov(shift.T), one.covariance, rtol=0.03, atol=0.01 * np.trace(one.covariance))
        every &= hit
    share = np.mean(every)
    error = np.sqrt(share * (1 - share) / DRAWS)
    assert abs(found.success.probability - share) < 4 * np.hypot(error, found.success.standard_error)
    assert abs(found.success.product - share) > 5 * error  # as if the workpiece were drawn anew at each


def test_one_feature_alone_keeps_its_lever():
    task = {"kind": "insert", "direction": [0, -1, 0], "workpiece": {"x": "1.2 m", "y": "0.5 m"},
            "features": [{"name": "a", "position": ["0 m", "60 mm", "0 m"]},
                         {"name": "b", "position": ["0 m", "-60 mm", "0 m"]}]}  # fmt: skip
    planar = po.load_problem("insert_planar_2r").replace(
        task=task, uncertainty={"sigma": {"joint1.theta": "0.1 mrad", "joint2.theta": "0.1 mrad"}, **ERRORS}
    )
    both = po.select_posture(planar)
    found = po.compare_plans({"nominal": planar, "calibrated": planar})
    assert found.arms["nominal"].judged["calibrated"].sigma_max == pytest.approx(both.sigma_max, rel=1e-4)
    assert {share.parameter: share.share for share in both.budget}["workpiece.angle"] > 0.01


def test_points_of_a_path_lie_on_the_workpiece():
    points = [[f"{x} mm", "100 mm", "200 mm"] for x in (550, 600, 650)]
    task = {"kind": "weld", "points": points, "tilt": "0 deg"}
    for placed, origin in (({}, (0.6, 0.1, 0.2)), ({"workpiece": {}}, (0.0, 0.0, 0.0))):
        found = po.select_posture(problem(**task, **placed))
        for one in found.points:
            lever = one.target.lower - origin
            turned = ANGLE**2 * (lever @ lever * np.eye(3) - np.outer(lever, lever))
            arm = po.propagate(found.problem, one.q).covariance
            assert np.allclose(one.covariance, arm + turned + (POSITION**2 + FEATURE**2) * np.eye(3), rtol=1e-9)
        assert found.motion.sigma == pytest.approx(found.sigmas, rel=1e-3)  # what the search compares
        assert placed or "middle of the path" in found.report(full=True)


@pytest.mark.parametrize(
    ("errors", "said"),
    [
        ({"workpiece": {}}, "neither position nor angle"),
        ({"workpiece": {"angle": "8 deg"}}, "5 deg"),
        ({"workpiece": {"position": "-1 mm"}}, "uncertainty"),
        ({"feature": {}}, "position"),
        ({"feature": {"angle": "1 deg"}}, "angle"),
    ],
)
def test_what_is_no_error_of_a_workpiece_is_refused(errors, said):
    with pytest.raises(po.errors.InputError, match=said):
        problem(errors, position=["0.6 m", "0.2 m", "0.1 m"])


# --- A workpiece with a shape: kept clear of where it is fixed, checked where it was put, in the scene in any case ----

WALL = {"file": "wall.stl", "unit": "mm"}


def wall(folder: Path) -> None:
    """A block of 60 x 40 x 100 mm beside the hole at the origin: 30 mm away from it along x."""
    trimesh.creation.box((60, 40, 100)).apply_translation([60, 0, 0]).export(folder / "wall.stl")


def planar(folder: Path, **workpiece: object) -> po.Problem:
    """The lecture's arm with links of 20 mm radius, and a part with one hole."""
    data = po.load_problem("insert_planar_2r").to_dict()
    data["robot"]["shape"] = {"radius": "20 mm"}
    data["task"] = {
        "kind": "insert", "direction": [0, -1, 0], "workpiece": {"x": "1.2 m", "y": "0.4 m", **workpiece},
        "features": [{"name": "hole", "position": ["0 m", "0 m", "0 m"]}],
    }  # fmt: skip
    (folder / "problem.yaml").write_text(po.problem_from_dict({**data}, folder=folder).to_yaml(), encoding="utf-8")
    return po.load_problem(folder / "problem.yaml")


def faces(problem: po.Problem) -> np.ndarray:
    (part,) = (obstacle for obstacle in problem.scene.obstacles if obstacle.name == "workpiece")
    return part.facets(np.full(3, -9.0), np.full(3, 9.0)).reshape(-1, 3)


def test_a_fixed_workpiece_is_an_obstacle_at_its_place(tmp_path: Path) -> None:
    wall(tmp_path)
    turned = planar(tmp_path, yaw="90 deg", **WALL)
    corners = faces(turned)  # a quarter turn: x of the part is y of the world
    np.testing.assert_allclose(corners.min(axis=0), [1.18, 0.43, -0.05], atol=1e-9)
    np.testing.assert_allclose(corners.max(axis=0), [1.22, 0.49, 0.05], atol=1e-9)


@pytest.mark.long
def test_the_arm_keeps_clear_of_a_fixed_workpiece(tmp_path: Path) -> None:
    wall(tmp_path)
    beside, free = po.select_posture(planar(tmp_path, **WALL)), po.select_posture(planar(tmp_path))
    assert beside.clearance is not None
    assert beside.clearance.cell is not None
    assert beside.clearance.cell.distance > 0
    assert beside.sigma_max >= free.sigma_max - 1e-9  # one more requirement cannot help


@pytest.mark.long
def test_a_workpiece_that_is_put_is_checked_there(tmp_path: Path) -> None:
    wall(tmp_path)
    problem = planar(tmp_path, x=["1.1 m", "1.2 m"], **WALL)
    assert problem.part is None
    found = po.select_posture(problem)
    assert found.placement is not None
    corners = faces(found.problem)
    assert corners[:, 0].min() == pytest.approx(found.placement.w[0] + 0.03, abs=1e-9)
    assert any("chosen without looking at it" in str(note) for note in found.notes)
    hit = found.clearance.cell.distance <= 0
    assert hit == ("collision.workpiece-hit" in said(found))


def test_its_file_goes_along_and_faults_are_named(tmp_path: Path) -> None:
    wall(tmp_path)
    files = planar(tmp_path, **WALL).files("copy")
    assert files["copy_workpiece.stl"] == (tmp_path / "wall.stl").read_bytes()
    with pytest.raises(po.errors.InputError, match="no such file") as caught:
        planar(tmp_path, file="none.stl", unit="mm")
    assert caught.value.issues[0].key == ("task", "workpiece", "file")
    with pytest.raises(po.errors.InputError, match="the unit of the lengths in the file is missing"):
        planar(tmp_path, file="wall.stl")
