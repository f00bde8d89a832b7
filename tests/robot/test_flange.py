"""Poses of a flange without an arm: tool from touches, camera on the flange, in every convention of controllers.

Poses, their conventions and the truth are scipy's.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import posture_opt as po

CONVENTIONS = {
    ("qw", "qx", "qy", "qz"): lambda R: np.roll(R.as_quat(), 1, axis=1),
    ("rx [rad]", "ry [rad]", "rz [rad]"): lambda R: R.as_rotvec(),
    ("roll [deg]", "pitch [deg]", "yaw [deg]"): lambda R: R.as_euler("xyz", degrees=True),
    ("a [deg]", "b [deg]", "c [deg]"): lambda R: R.as_euler("ZYX", degrees=True),
    ("w [deg]", "p [deg]", "r [deg]"): lambda R: R.as_euler("xyz", degrees=True),
}
TOOL_MM = np.array([12.0, -35.0, 168.0])
CAMERA_MM = np.array([35.0, -60.0, 85.0])


def flange_poses(rng: np.random.Generator, count: int) -> tuple[Rotation, np.ndarray]:
    """Rotations, and places (count, 3) [mm], of a flange that looks down within 60 deg."""
    tilt = Rotation.from_rotvec(rng.uniform(-0.6, 0.6, (count, 3)))
    return tilt * Rotation.from_euler("x", 180, degrees=True), rng.uniform(
        [300, -200, 300], [600, 200, 600], (count, 3)
    )


def loaded(folder: Path, section: str = "") -> po.Problem:
    (folder / "problem.yaml").write_text(
        "name: flange\nrobot: {kind: flange}\nuncertainty: {measurement: {position: 0.1 mm"
        + (", orientation: 0.5 mrad}}\n" if section else "}}\n")
        + section,
        encoding="utf-8",
    )
    return po.load_problem(folder / "problem.yaml")


def found_at(calibration: po.Calibration, name: str) -> tuple[float, float]:
    """Value and standard error of a parameter [mm or rad]."""
    (row,) = [p for p in calibration.to_json()["parameters"] if p["name"] == name]
    factor = 1e3 if row["unit"] == "m" else 1.0
    return row["estimate"] * factor, row["std"] * factor


@pytest.mark.parametrize(("columns", "count"), [*((names, 12) for names in CONVENTIONS), (next(iter(CONVENTIONS)), 4)])
def test_the_tool_is_found_from_touches_of_one_spike(tmp_path: Path, columns: tuple[str, ...], count: int) -> None:
    rng = np.random.default_rng(count)
    R, _ = flange_poses(rng, count)
    flange = np.array([450.0, 30.0, 100.0]) - R.apply(TOOL_MM) + 0.03 * rng.standard_normal((count, 3))
    table: dict[str, list[object]] = {"point": ["spike"] * count}
    table |= {f"flange_{axis} [mm]": [*flange[:, k]] for k, axis in enumerate("xyz")}
    table |= {f"flange_{name}": [*CONVENTIONS[columns](R)[:, k]] for k, name in enumerate(columns)}
    problem = loaded(tmp_path)
    calibration = po.calibrate(problem, po.read_measurements(table, problem), plan=False)
    # Linear least squares of R t + p = spike, by numpy alone.
    A = np.column_stack([R.as_matrix().reshape(-1, 3), np.tile(-np.eye(3), (count, 1))])
    own = np.linalg.lstsq(A, -flange.ravel(), rcond=None)[0][:3]
    for axis, value in zip("xyz", own, strict=True):
        assert found_at(calibration, f"tool.{axis}")[0] == pytest.approx(value, abs=0.02)
    said = {statement["id"] for statement in calibration.to_json()["statements"]}
    assert {"calibration.frames-found", "calibration.frame-found"} <= said
    assert "calibration.nominal-kept-no-gain" not in said


def seen_board() -> tuple[dict[str, list[float]], np.ndarray]:
    """20 poses of a board, seen by a camera at `CAMERA_MM` on the flange; places (20, 3) of the flange [mm]."""
    rng = np.random.default_rng(3)
    R, p = flange_poses(rng, 20)
    camera, at = Rotation.from_euler("xyz", [2, -3, 91], degrees=True), CAMERA_MM
    board, board_at = Rotation.from_euler("z", 40, degrees=True), np.array([500.0, 100.0, 20.0])
    seen_by = R * camera
    seen = seen_by.inv() * board
    place = seen_by.inv().apply(board_at - (p + R.apply(at))) + 0.1 * rng.standard_normal(p.shape)
    seen = seen * Rotation.from_rotvec(5e-4 * rng.standard_normal(p.shape))
    table: dict[str, list[float]] = {}
    for prefix, turns, places in (("flange_", R, p), ("", seen, place)):
        table |= {f"{prefix}{axis} [mm]": [*places[:, k]] for k, axis in enumerate("xyz")}
        table |= {f"{prefix}r{axis} [rad]": [*turns.as_rotvec()[:, k]] for k, axis in enumerate("xyz")}
    return table, p


def test_a_camera_on_the_flange_is_found_from_poses_of_a_board(tmp_path: Path) -> None:
    table, _ = seen_board()
    problem = loaded(tmp_path, "data: {frame: camera}\n")
    calibration = po.calibrate(problem, po.read_measurements(table, problem), plan=False)
    for axis, true in zip("xyz", CAMERA_MM, strict=True):
        value, std = found_at(calibration, f"tool.{axis}")
        assert abs(value - true) < 3.5 * std
        assert std < 0.3
    for name, true in zip(("roll", "pitch", "yaw"), np.radians([2, -3, 91]), strict=True):
        value, std = found_at(calibration, f"tool.{name}")
        assert abs(value - true) < 3.5 * std
    calibration.save(tmp_path / "out", figures=False)
    again = po.load_problem(tmp_path / "out" / "calibrated.yaml")
    assert again.robot.tool[0].nominal == pytest.approx(found_at(calibration, "tool.x")[0] / 1e3, abs=1e-9)
    recheck = po.recheck(again, po.read_measurements(table, again)).to_json()
    assert recheck["statements"][0]["id"] == "changes.unchanged"


def test_exchanged_columns_are_named_and_new_poses_of_the_flange_are_planned(tmp_path: Path) -> None:
    table, p = seen_board()
    problem = loaded(tmp_path, "data: {frame: camera}\n")
    with pytest.raises(po.errors.InputError, match="nothing is left"):
        po.recheck(problem, po.read_measurements(table, problem))
    exchanged = {**table, "flange_x [mm]": table["flange_y [mm]"], "flange_y [mm]": table["flange_x [mm]"]}
    metres = {**table, "flange_x [mm]": [value / 1e3 for value in table["flange_x [mm]"]]}
    for wrong, said in ((exchanged, "flange_x and flange_y are exchanged"), (metres, "numbers of flange_x are m")):
        with pytest.raises(po.errors.InputError, match=said):
            po.read_measurements(wrong, problem)
    plan = po.plan_measurements(problem, 6, given=po.read_measurements(table, problem), candidates=200)
    for k, axis in enumerate("xyz"):
        planned = [row[f"flange_{axis}"] for row in plan.postures]
        assert p[:, k].min() / 1e3 - 1e-4 <= min(planned) <= max(planned) <= p[:, k].max() / 1e3 + 1e-4


def test_half_an_orientation_of_the_flange_is_named(tmp_path: Path) -> None:
    problem = loaded(tmp_path)
    table = {
        "point": ["spike"], "flange_x [mm]": [1], "flange_y [mm]": [1], "flange_z [mm]": [1], "flange_rx [rad]": [0],
    }  # fmt: skip
    with pytest.raises(po.errors.InputError, match="flange_ry, flange_rz"):
        po.read_measurements(table, problem)
    del table["flange_rx [rad]"]
    with pytest.raises(po.errors.InputError, match="flange_yaw"):
        po.read_measurements(table, problem)


def test_a_flange_has_no_posture_to_choose() -> None:
    task = {"kind": "insert", "position": ["0.1 m", "0 m", "0 m"]}
    document = {"robot": {"kind": "flange"}, "uncertainty": {"sigma": {"tool.x": "0.1 mm"}}, "task": task}
    with pytest.raises(po.errors.InputError, match="no posture to choose"):
        po.select_posture(po.problem_from_dict(document))
