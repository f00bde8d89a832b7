"""Poses of a board that a camera on the tool reports, beside other instruments, of a simulator of its own."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import posture_opt as po
from posture_opt.measurements.kinds import BoardPose, Seen
from posture_opt.measurements.kinds.kind import stacked
from tests.helpers.cameras import TOOL_SCENE, board_table
from tests.helpers.instruments import (
    TrueArm,
    deviations,
    misplaced,
    mixed_table,
    plane_table,
    postures,
    tracker_table,
)

SIGMAS = 5e-5, 1e-4  # of a coordinate [m] and of a turn [rad], in the camera
TURNED = np.array([[0.8, -0.6, 0, 1.0], [0.6, 0.8, 0, -2.0], [0, 0, 1, 0.5], [0, 0, 0, 1]])  # T_tracker_base


def problem(*, orientation: bool = True, **robot: object) -> po.Problem:
    tool = {"xyz": ["30 mm", "-20 mm", "120 mm"], "rpy": ["0 deg", "0 deg", "0 deg"], "free": True}
    stated = {"plane": "0.02 mm", "position": "0.05 mm", **({"orientation": "0.1 mrad"} if orientation else {})}
    return po.problem_from_dict(
        {
            "robot": {"kind": "preset", "name": "ur10", "tool": tool, **robot},
            "uncertainty": {"measurement": stated},
            "data": {"frame": "camera"},
        }
    )


def table(arm: TrueArm, rng: np.random.Generator, n: int, *, tracked: bool = False) -> dict[str, list[object]]:
    """n poses of the board, and as many touches of each of three plates, or positions of a tracker."""
    other = tracker_table(arm, rng, n, SIGMAS[0], TURNED) if tracked else plane_table(arm, rng, n, 2e-5, 0.0)
    own = {"tracker" if tracked else "probe": other, "eye": board_table(arm, rng, n, SIGMAS)}
    sided = arm.backlash[1] > 0
    return mixed_table({k: {c: v for c, v in t.items() if sided or "approach" not in c} for k, t in own.items()})


def calibrated(seed: int, n: int, *, tracked: bool) -> tuple[po.Calibration, TrueArm]:
    rng = np.random.default_rng(seed)
    arm = TrueArm.drawn(rng)
    given = problem(base="free") if tracked else problem()
    data = po.read_measurements(table(arm, rng, n, tracked=tracked), given)
    return po.calibrate(given, data, plan=False), arm


def test_derivatives_are_those_of_differences() -> None:
    """About a reading of a board that is where the model has it: errors of orientations are small."""
    rng, n, h = np.random.default_rng(3), 9, 1e-6
    position, R = rng.uniform(-1, 1, (n, 3)), Rotation.from_quat(rng.normal(size=(n, 4))).as_matrix()
    values = np.broadcast_to(rng.uniform(-0.3, 0.3, 12), (n, 12))
    T = np.tile(np.eye(4), (n, 1, 1))
    T[:, :3, :3], T[:, :3, 3] = R, position

    def frame(own: np.ndarray) -> np.ndarray:
        found = np.eye(4)
        found[:3, :3], found[:3, 3] = Rotation.from_euler("xyz", own[3:]).as_matrix(), own[:3]
        return found

    seen = np.linalg.inv(T @ frame(values[0, :6])) @ frame(values[0, 6:])
    turn = Rotation.from_matrix(seen[:, :3, :3]).as_quat(scalar_first=True)
    reading = np.concatenate([seen[:, :3, 3], turn], axis=1)
    kind = BoardPose()

    def rows(shift: np.ndarray, turn: np.ndarray, more: np.ndarray) -> Seen:
        moved = Rotation.from_rotvec(turn).as_matrix() @ R
        columns = [list(moved[:, :, j].T) for j in range(3)]
        return Seen(list((position + shift).T), columns, reading, np.zeros(n, dtype=int), values + more)

    def error(*at: np.ndarray) -> np.ndarray:
        return stacked(kind.error(rows(*at)), n)

    zero, none = np.zeros(3), np.zeros(12)
    assert np.allclose(error(zero, zero, none), 0, atol=1e-12)
    for e in np.eye(3):
        for v, w in ((e, zero), (zero, e)):
            numeric = (error(h * v, h * w, none) - error(-h * v, -h * w, none)) / (2 * h)
            assert np.allclose(stacked(kind.slope(rows(zero, zero, none), v, w), n), numeric, atol=1e-7)
    for axis, e in enumerate(np.eye(12)):
        numeric = (error(zero, zero, h * e) - error(zero, zero, -h * e)) / (2 * h)
        assert np.allclose(stacked(kind.unknown_slope(rows(zero, zero, none), axis), n), numeric, atol=1e-7)


@pytest.mark.long
@pytest.mark.parametrize("tracked", [False, pytest.param(True, marks=pytest.mark.conformance)])
def test_a_camera_and_another_instrument_teach_one_arm(tracked: bool) -> None:
    found, arm = calibrated(81, 16, tracked=tracked)
    assert 0.7 < found.variance < 1.4
    values = {p.name: p.nominal + v for p, v in zip(found.parameters, found.x, strict=True)}
    q = postures(np.random.default_rng(99), 60)
    assert misplaced(values, q, arm.point(q)) < 8e-5
    document = found.to_json()["instruments"]["eye"]
    assert (document["kind"], document["rows"], document["sigma"]) == ("pose", 16, 5e-5)
    assert document["scatter"] == pytest.approx(SIGMAS[0], rel=0.4)
    assert document["orientation"]["scatter"] == pytest.approx(SIGMAS[1], rel=0.4)
    frames = document["unknowns"]["eye"]
    # The camera is where it is on the tool, less what the ends of the arm and the tool hide.
    assert np.allclose([frames["camera"][a] for a in "xyz"], TOOL_SCENE.camera.pose[:3, 3], atol=3e-3)
    turns = [frames["camera"][a] for a in ("roll", "pitch", "yaw")]
    assert np.allclose(Rotation.from_euler("xyz", turns).as_matrix(), TOOL_SCENE.camera.pose[:3, :3], atol=3e-3)
    assert np.allclose([frames["board"][a] for a in "xyz"], TOOL_SCENE.board[:3, 3], atol=3e-3)
    # What nothing tells from where camera and board are is named.
    report = " ".join(found.report().split())
    assert "eye.board.z" in report.split("What the data do not determine")[1]
    assert "eye: camera" in report


@pytest.mark.conformance
def test_intervals_hold_the_truth() -> None:
    inside: list[bool] = []
    for seed in range(82, 86):
        found, arm = calibrated(seed, 16, tracked=seed % 2 == 1)
        inside += (np.abs(deviations(found, arm)) < 1.96).tolist()
    assert len(inside) > 60
    assert 0.88 < np.mean(inside) < 0.995


@pytest.mark.conformance
def test_backlash_is_named() -> None:
    rng = np.random.default_rng(86)
    arm = TrueArm.drawn(rng, backlash=(2, 1e-3))
    found = po.diagnose(problem(), po.read_measurements(table(arm, rng, 12), problem()), plan=False)
    assert (found.effects[0].kind, found.effects[0].target) == ("backlash", "elbow")
