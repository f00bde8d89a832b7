"""Measurements that do not suffice, or that do not belong to the arm: each its own message, and what to do."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import posture_opt as po
from posture_opt.calibration.estimation.fit import agreeing_rows
from tests.helpers.free_arms import BASE, SIX, TOOL, hidden_errors, problem_of, rows, simulated_points
from tests.helpers.real_arms import DATA, long_on_real_arms
from tests.helpers.variants import conformance

NOISE = 2e-5  # m


def measured(q: np.ndarray, rng: np.random.Generator, errors: dict[str, float], base: np.ndarray = BASE) -> np.ndarray:
    return simulated_points(SIX, q, base, TOOL, errors) + rng.normal(0, NOISE, (len(q), 3))


@pytest.fixture
def setting() -> tuple[Any, np.ndarray, np.random.Generator, dict[str, float]]:
    rng = np.random.default_rng(1)
    errors = hidden_errors(SIX, rng, ("j2",))
    return problem_of(SIX), rng.uniform(-2.5, 2.5, (80, 6)), rng, errors


def test_a_set_that_moves_one_joint_tells_nothing_of_the_arm_and_names_the_others(setting: Any) -> None:
    problem, q, rng, errors = setting
    one = np.tile(q[0], (80, 1))
    one[:, 0] = q[:, 0]
    still = math.degrees(q[0, 2])
    with pytest.raises(po.errors.InsufficientDataError, match=f"no parameter of the arm itself.*j3 at {still:.4g} deg"):
        po.calibrate(problem, rows(problem, one, measured(one, rng, errors)))


def test_a_constant_joint_is_named_and_the_rest_is_found(setting: Any) -> None:
    problem, q, rng, errors = setting
    q[:, 2] = 0.5
    result = po.calibrate(problem, rows(problem, q, measured(q, rng, errors)))
    assert any("stood still: j3 at 28.65 deg" in note for note in result.notes)
    assert result.calibrated.rms < 3 * NOISE < result.nominal.rms
    full = problem_of(SIX)
    moving = setting[2].uniform(-2.5, 2.5, (80, 6))
    assert po.calibrate(full, rows(full, moving, measured(moving, rng, errors))).fixed.sum() > result.fixed.sum()


def test_another_robots_file_is_refused(setting: Any) -> None:
    _, q, rng, errors = setting
    table = [("j1", 0.0, 0.1273, 0.0, np.pi / 2), ("j2", 0.0, 0.0, -0.612, 0.0), ("j3", 0.0, 0.0, -0.5723, 0.0)]
    table += [("j4", 0.0, 0.1639, 0.0, np.pi / 2), ("j5", 0.0, 0.1157, 0.0, -np.pi / 2), ("j6", 0.0, 0.0922, 0.0, 0.0)]
    other = problem_of(table)
    with pytest.raises(po.errors.InputError, match=r"even calibrated, the arm misses.*another robot's file"):
        po.calibrate(other, rows(other, q, measured(q, rng, errors)))


def test_a_stated_base_that_the_data_contradict_is_named_and_freed(setting: Any) -> None:
    _, q, rng, errors = setting
    tool = {"xyz": ["30 mm", "-50 mm", "120 mm"]}
    stated = problem_of(SIX, robot={"base": {"xyz": ["0 m", "0 m", "0 m"]}, "tool": tool})
    moved = po.calibrate(stated, rows(stated, q, measured(q, rng, errors)))
    assert [c.cause.kind for c in moved.contradictions] == ["base_frame"]
    assert moved.calibrated.rms < 3 * NOISE
    x, _, _ = moved.contradictions[0].estimate["x"]
    assert abs(x - BASE[0, 3]) < 1e-3  # what the errors of the geometry leave open
    assert "calibration.frame-contradicted" in {s["id"] for s in moved.to_json()["statements"]}
    # In the stated frame the same arm calibrates, and the frames are no unknowns.
    result = po.calibrate(stated, rows(stated, q, measured(q, rng, errors, np.eye(4))))
    assert not result.contradictions
    assert not any(p.group in ("base", "tool") for p in result.parameters)
    assert result.calibrated.rms < 3 * NOISE


def test_a_zero_that_is_far_off_is_found_for_all_that_parts_are_better_made(setting: Any) -> None:
    problem, q, rng, errors = setting
    off = q + np.array([0, 0, 0, 0.6, 0, 0])  # what was commanded reads 34 deg more than where the joint stood
    result = po.calibrate(problem, rows(problem, off, measured(q, rng, errors)))
    i = [p.name for p in result.parameters].index("j4.theta")
    assert abs(result.x[i] - errors["j4.theta"] + 0.6) < 4 * result.std[i]
    assert result.calibrated.rms < 3 * NOISE


def touching(lengths: list[str]) -> tuple[Any, po.Measurements]:
    """An arm in the plane whose tool touches two points, 30 times."""
    joints = [{"name": f"j{i}", "type": "revolute", "a": length} for i, length in enumerate(lengths)]
    problem = po.problem_from_dict({"robot": {"kind": "dh", "joints": joints}})
    q = np.random.default_rng(5).uniform(-180, 180, (30, len(lengths)))
    heads = {f"j{i} [deg]": column for i, column in enumerate(q.T)}
    return problem, po.read_measurements({**heads, "point": ["a", "b"] * 15}, problem)


def test_touched_points_do_not_tell_how_the_sizes_of_robots_vary() -> None:
    problem, data = touching(["1 m", "1 m"])
    robots = replace(data, robot=np.repeat([0, 1, 2], 10), robot_names=("A", "B", "C"))
    with pytest.raises(
        po.errors.InsufficientDataError, match="how sizes vary from one to the next: state a known distance"
    ):
        po.calibrate_batch(problem, robots)


# --- Errors of several targets of one posture that agree are the arm's, and no outliers -------------------------------

SAG = np.array([0.0, 0.0, -2.0])


class Rows(SimpleNamespace):
    """Columns of a table."""

    q: np.ndarray

    def __len__(self) -> int:
        return len(self.q)


def session(postures: int = 12, targets: int = 3) -> tuple[Any, np.ndarray]:
    """Each target in each posture, off by noise."""
    rng = np.random.default_rng(1)
    q = np.repeat(rng.uniform(-1, 1, (postures, 6)), targets, axis=0)
    data: Any = Rows(
        q=q, pose=np.repeat(np.arange(postures), targets), target=np.tile(np.arange(targets), postures),
        target_names=[f"t{i}" for i in range(targets)],
    )  # fmt: skip
    return data, rng.normal(0, 0.02, (len(q), 3))


def test_three_reflectors_that_sag_together_are_kept() -> None:
    data, errors = session()
    errors[3:6] += SAG
    gross = np.linalg.norm(errors, axis=1) > 0.2
    assert agreeing_rows(data, errors, gross).tolist() == gross.tolist()


def test_one_reflector_that_was_knocked_is_an_outlier() -> None:
    data, errors = session()
    errors[3] += SAG
    errors[7] += SAG  # another posture
    gross = np.linalg.norm(errors, axis=1) > 0.2
    assert not agreeing_rows(data, errors, gross).any()


# --- An arm that was measured with the preset of its sister: the report says whose link lengths the data have ---------

# Universal Robots, DH parameters for calculations of kinematics and dynamics: d and a of each joint [m].
LENGTHS = {
    "ur10": ([0.1273, 0, 0, 0.163941, 0.1157, 0.0922], [0, -0.612, -0.5723, 0, 0, 0]),
    "ur10e": ([0.1807, 0, 0, 0.17415, 0.11985, 0.11655], [0, -0.6127, -0.57155, 0, 0, 0]),
    "ur5e": ([0.1625, 0, 0, 0.1333, 0.0997, 0.0996], [0, -0.425, -0.3922, 0, 0, 0]),
}
TWISTS = [np.pi / 2, 0, 0, np.pi / 2, -np.pi / 2, 0]
JOINTS = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
TOOL_PRESET = np.array([0.03, 0.0, 0.1, 1.0])


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
    return (T @ TOOL_PRESET)[:, :3]


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


@pytest.mark.parametrize("free", [True, False])
def test_an_arm_of_the_next_generation_is_told(free: bool, tmp_path: Path) -> None:
    found = calibrated(tmp_path, "ur10e", "ur10", free)
    other = found.to_json()["other_preset"]
    assert other["name"] == "ur10e"
    assert other["residual_rms"]["preset"] < 1e-3 < 5e-3 < other["residual_rms"]["stated"]
    assert other["lengths"]["wrist_1.d"] == {"stated": 0.163941, "preset": 0.17415}
    assert "calibration.other-preset" in {s["id"] for s in found.to_json()["statements"]}


@pytest.mark.parametrize(("true", "stated"), conformance([("ur10", "ur10"), ("ur10e", "ur10e")], [("ur10e", "ur10e")]))
def test_an_arm_of_its_own_preset_is_of_no_other(true: str, stated: str, tmp_path: Path) -> None:
    found = calibrated(tmp_path, true, stated, True)
    assert found.other_preset is None
    assert "other_preset" not in found.to_json()


# --- Touches show no length: what only moves the places or the tool must not pass for growth of the arm ---------------


@long_on_real_arms
def test_no_length_of_a_real_arm_is_off_by_more_than_a_decimetre() -> None:
    folder = DATA / "mukca_sockets"
    problem = po.load_problem(folder / "problem_panda.yaml")
    found = po.diagnose(problem, po.read_measurements(folder / "panda_3.csv", problem))
    geometry = [finding for finding in found.effects if finding.effect is None and finding.noise is None]
    sizes = [value for finding in geometry for value, _, unit in finding.estimate.values() if unit == "m"]
    assert geometry
    assert all(abs(size) < 0.1 for size in sizes)


def planar_touches(rng: np.random.Generator, stated: float) -> po.Calibration:
    """An arm of two links of 1 m touches three points twelve times each; one of their distances is stated wrongly."""
    places = {"a": (1.2, 0.3), "b": (0.4, 1.1), "c": (-0.9, 0.7)}
    rows: dict[str, list[float | str]] = {"point": [], "joint1 [rad]": [], "joint2 [rad]": []}
    for name, place in places.items():
        for k in range(12):
            x, y = np.array(place) + rng.normal(0, 5e-5, 2)
            bend = (-1) ** k * np.arccos((x * x + y * y - 2) / 2)
            rows["point"].append(name)
            rows["joint1 [rad]"].append(np.arctan2(y, x) - bend / 2)
            rows["joint2 [rad]"].append(bend)
    ab, bc = (float(np.linalg.norm(np.subtract(places[i], places[j]))) for i, j in (("a", "b"), ("b", "c")))
    problem = po.problem_from_dict({
        "robot": {"kind": "dh", "joints": [{"name": f"joint{i}", "a": "1 m"} for i in (1, 2)]},
        "uncertainty": {"measurement": {"position": "0.05 mm"}},
        "data": {"distances": [["a", "b", f"{ab + stated} m"], ["b", "c", f"{bc} m"]]},
    })  # fmt: skip
    return po.calibrate(problem, po.read_measurements(rows, problem))


def test_a_distance_that_is_stated_wrongly_is_doubted() -> None:
    wrong = planar_touches(np.random.default_rng(4), 2e-3)
    right = planar_touches(np.random.default_rng(4), 0.0)
    said = [{s["id"] for s in found.to_json()["statements"]} for found in (wrong, right)]
    assert ["calibration.distance-doubted" in ids for ids in said] == [True, False]


def test_an_arm_without_lengths_does_not_tell_its_size_by_touching() -> None:
    problem, data = touching(["0 m", "0 m"])
    with pytest.raises(po.errors.InsufficientDataError, match=r"size of this arm.*distances: \[\[a, b, 50 mm\]\]"):
        po.calibrate(problem, data)


def test_a_diagnosis_says_it_too(tmp_path: Path) -> None:
    calibration = calibrated(tmp_path, "ur5e", "ur10e", True)
    found = po.diagnose(calibration.request.problem, calibration.request.data, plan=False, flips=99)
    assert found.to_json()["other_preset"]["name"] == "ur5e"
    assert "calibration.other-preset" in {s["id"] for s in found.to_json()["statements"]}
