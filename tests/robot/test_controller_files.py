"""Calibrations that controllers store: the motion is that of their numbers, and frames stand beside the arm."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import posture_opt as po
from posture_opt import problem_from_dict
from posture_opt.problem.starter import calibrated_starter_text

# Deviations of the size that UR5 controllers store, rows of nearly parallel axes 200 m away.
CONF = """\
[mounting]
delta_theta = [ 2.6e-08, -0.2319237, 6.5022221, 0.01288, -6.7e-08, -7.1e-07]
delta_a = [ 0.000143, 0.01116454665, -7.293e-05, 0.00019, 1.5e-06, 0]
delta_d = [ 0.000229, -204.0771054, 203.3923236, 0.6852734, -0.000125, -0.00013]
delta_alpha = [ 0.000261, 0.000478915, 0.00738088, 0.000252, 0.001845, 0]
calibration_status = 2 # 0 == notInitialized / 1 == notLinearised / 2 == Linearised
"""
UR5 = {  # a, alpha, d of Universal Robots' table, theta is zero
    "a": (0, -0.425, -0.39225, 0, 0, 0),
    "alpha": (math.pi / 2, 0, 0, math.pi / 2, -math.pi / 2, 0),
    "d": (0.089159, 0, 0, 0.10915, 0.09465, 0.0823),
}
ORIGINS = """\
kinematics:
  forearm: {x: -0.42517034, y: 0, z: 0, roll: 0.00144432, pitch: -0.000426, yaw: 4.64e-06}
  shoulder: {x: 0, y: 0, z: 0.16271224, roll: -0, pitch: 0, yaw: 5.7e-08}
  upper_arm: {x: 0.000182, y: 0, z: 0, roll: 1.571314866, pitch: 0, yaw: 1.12e-06}
  wrist_1: {x: -0.3926466, y: -0.000403, z: 0.13310631, roll: 0.003027888, pitch: -0.00118572, yaw: -2.57e-06}
  wrist_2: {x: -7.07e-06, y: -0.099603596, z: -3.2e-07, roll: 1.5707995, pitch: 0, yaw: 1.3e-06}
  wrist_3: {x: 1.369e-05, y: 0.09958484, z: 9.52e-05, roll: 1.571752475, pitch: 3.14159265, yaw: 3.14159251}
  hash: calib_0
"""
LINKS = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")


def _turn(axis: str, angle: float) -> np.ndarray:
    c, s = math.cos(angle), math.sin(angle)
    i, j = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
    T = np.eye(4)
    T[i, i], T[i, j], T[j, i], T[j, j] = c, -s, s, c
    return T


def _shift(x: float, y: float, z: float) -> np.ndarray:
    T = np.eye(4)
    T[:3, 3] = x, y, z
    return T


def _stored() -> dict[str, list[float]]:
    lines = (line.split("=", 1) for line in CONF.splitlines() if line.startswith("delta"))
    return {key.strip().removeprefix("delta_"): [float(v) for v in text.strip(" []").split(",")] for key, text in lines}


def _dh_pose(q: np.ndarray) -> np.ndarray:
    T, delta = np.eye(4), _stored()
    for i in range(6):
        a, alpha, d = (UR5[key][i] + delta[key][i] for key in ("a", "alpha", "d"))
        T = T @ _turn("z", q[i] + delta["theta"][i]) @ _shift(a, 0, d) @ _turn("x", alpha)
    return T


def _arm(folder: Path, name: str, text: str, robot: dict):
    (folder / name).write_text(text)
    return problem_from_dict({"robot": {**robot, "file": str(folder / name)}}).arm


def _same_motion(arm, pose_of) -> None:
    for q in np.random.default_rng(3).uniform(-3, 3, (20, 6)):
        np.testing.assert_allclose(arm.pose(q), pose_of(q), atol=1e-9)


def _near(arm, nominal: str) -> None:
    values = problem_from_dict({"robot": {"kind": "preset", "name": nominal}}).robot.parameters
    for name, factor in arm.robot.parameters.items():
        assert abs(factor.nominal - values[name].nominal) < 0.01, name


def test_a_calibration_conf_moves_as_stored_from_frames_beside_the_arm(tmp_path: Path) -> None:
    arm = _arm(tmp_path, "calibration.conf", CONF, {"kind": "preset", "name": "ur5"})
    _same_motion(arm, _dh_pose)
    _near(arm, "ur5")


def test_a_table_of_nearly_parallel_axes_has_its_links_where_the_arm_is(tmp_path: Path) -> None:
    delta = _stored()
    rows = [
        f"J{i + 1};{UR5['a'][i] + delta['a'][i]!r};{UR5['alpha'][i] + delta['alpha'][i]!r};"
        f"{UR5['d'][i] + delta['d'][i]!r};{delta['theta'][i]!r}".replace(".", ",")
        for i in range(6)
    ]
    text = "\n".join(["name;a [m];alpha [rad];d [m];theta [rad]", *rows])
    arm = _arm(tmp_path, "table.csv", text, {"kind": "dh", "shape": {"radius": "50 mm"}})
    _same_motion(arm, _dh_pose)
    assert all(capsule.length < 0.45 for capsule in arm.robot.shape)
    assert arm.robot.length < 1.3


def test_the_yaml_of_a_driver_moves_as_its_origins_say(tmp_path: Path) -> None:
    import yaml

    arm = _arm(tmp_path, "ur5e_calibration.yaml", ORIGINS, {"kind": "preset", "name": "ur5e"})
    found = yaml.safe_load(ORIGINS)["kinematics"]

    def pose(q: np.ndarray) -> np.ndarray:
        T = np.eye(4)
        for link, angle in zip(LINKS, q, strict=True):
            o = found[link]
            turned = _turn("z", o["yaw"]) @ _turn("y", o["pitch"]) @ _turn("x", o["roll"])
            T = T @ _shift(o["x"], o["y"], o["z"]) @ turned @ _turn("z", angle)
        return T

    _same_motion(arm, pose)
    _near(arm, "ur5e")


@pytest.mark.parametrize(
    ("text", "name", "fault"),
    [
        (CONF.replace(", 0]", "]"), "ur5", "6 numbers"),
        (CONF, "xarm7", "7 numbers"),
        (CONF, "xarm6", "of an arm of Universal Robots"),
        ("kinematics: [1, 2]", "ur5", "0 joints are calibrated"),
        ("[mounting]\ndelta_a = [1e300, 0, 0, 0, 0, 0]", "ur5", "is it of another arm"),
        (ORIGINS.replace("-0.42517034", ".nan"), "ur5e", "is no number"),
        (ORIGINS, "planar_2r", "6 joints are calibrated"),
    ],
)
def test_a_file_of_another_arm_is_refused(tmp_path: Path, text: str, name: str, fault: str) -> None:
    with pytest.raises(po.errors.InputError, match=fault):
        _arm(tmp_path, "c.conf", text, {"kind": "preset", "name": name})


def test_a_starter_names_the_preset_that_the_calibration_fits(tmp_path: Path) -> None:
    (tmp_path / "mine.yaml").write_text(ORIGINS)
    text = calibrated_starter_text(tmp_path / "mine.yaml", tmp_path)
    assert "name: ur5e\n" in text
    assert "mine.yaml" in text
    (tmp_path / "calibration.conf").write_text(CONF)
    with pytest.raises(po.errors.InputError, match="'ur5' or 'ur5e'"):
        calibrated_starter_text(tmp_path / "calibration.conf", tmp_path)
