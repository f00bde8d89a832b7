"""An arm that was measured with the preset of its sister: the report says whose link lengths the data have."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import posture_opt as po

# Universal Robots, DH parameters for calculations of kinematics and dynamics: d and a of each joint [m].
LENGTHS = {
    "ur10": ([0.1273, 0, 0, 0.163941, 0.1157, 0.0922], [0, -0.612, -0.5723, 0, 0, 0]),
    "ur10e": ([0.1807, 0, 0, 0.17415, 0.11985, 0.11655], [0, -0.6127, -0.57155, 0, 0, 0]),
    "ur5e": ([0.1625, 0, 0, 0.1333, 0.0997, 0.0996], [0, -0.425, -0.3922, 0, 0, 0]),
}
TWISTS = [np.pi / 2, 0, 0, np.pi / 2, -np.pi / 2, 0]
JOINTS = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
TOOL = np.array([0.03, 0.0, 0.1, 1.0])


def positions(q: np.ndarray, d: np.ndarray, a: np.ndarray) -> np.ndarray:
    """(N, 3) by the textbook's product of DH matrices."""
    T = np.tile(np.eye(4), (len(q), 1, 1))
    for j, alpha in enumerate(TWISTS):
        c, s, ca, sa = np.cos(q[:, j]), np.sin(q[:, j]), np.cos(alpha), np.sin(alpha)
        A = np.zeros((len(q), 4, 4))
        A[:, 0] = np.stack([c, -s * ca, s * sa, a[j] * c], axis=1)
        A[:, 1] = np.stack([s, c * ca, -c * sa, a[j] * s], axis=1)
        A[:, 2, 1:] = [sa, ca, d[j]]
        A[:, 3, 3] = 1
        T = T @ A
    return (T @ TOOL)[:, :3]


def calibrated(folder: Path, true: str, stated: str, free: bool) -> po.Calibration:
    """A real arm of its type: lengths and zeros off by some tenths of a millimetre and of a milliradian."""
    rng = np.random.default_rng(3)
    q = rng.uniform(-2.2, 2.2, (100, 6))
    d, a = (np.array(v) + rng.normal(0, 3e-4, 6) * (np.array(v) != 0) for v in LENGTHS[true])
    points = positions(q + rng.normal(0, 5e-4, 6), d, a) + rng.normal(0, 5e-5, (100, 3))
    if free:
        points = points @ np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1.0]]) + [1.0, 2.0, 0.5]
    head = ", ".join([*(f"{name} [deg]" for name in JOINTS), "x [mm], y [mm], z [mm]"])
    file = folder / "data.csv"
    np.savetxt(file, np.hstack([np.degrees(q), 1e3 * points]), fmt="%.7f", delimiter=",", header=head, comments="")
    frames = {"base": "free", "tool": "free"} if free else {"tool": {"xyz": ["30 mm", "0 mm", "100 mm"]}}
    robot = {"kind": "preset", "name": stated, **frames}
    problem = po.problem_from_dict({"robot": robot, "uncertainty": {"measurement": {"position": "0.05 mm"}}})
    return po.calibrate(problem, po.read_measurements(file, problem), plan=False)


def test_an_arm_of_the_next_generation_is_told(tmp_path: Path) -> None:
    found = calibrated(tmp_path, "ur10e", "ur10", False)
    other = found.to_json()["other_preset"]
    assert other["name"] == "ur10e"
    assert other["residual_rms"]["preset"] < 1e-3 < 5e-3 < other["residual_rms"]["stated"]
    assert other["lengths"]["wrist_1.d"] == {"stated": 0.163941, "preset": 0.17415}
    assert "calibration.other-preset" in {s["id"] for s in found.to_json()["statements"]}


def test_an_arm_of_its_own_preset_is_of_no_other(tmp_path: Path) -> None:
    found = calibrated(tmp_path, "ur10e", "ur10e", True)
    assert found.other_preset is None
    assert "other_preset" not in found.to_json()


@pytest.mark.long
def test_a_diagnosis_says_it_too(tmp_path: Path) -> None:
    calibration = calibrated(tmp_path, "ur5e", "ur10e", True)
    found = po.diagnose(calibration.request.problem, calibration.request.data, plan=False, flips=99)
    assert found.to_json()["other_preset"]["name"] == "ur5e"
    assert "calibration.other-preset" in {s["id"] for s in found.to_json()["statements"]}
