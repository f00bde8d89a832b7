"""What a compensation keeps to: nearness, limits, order, units, marks; how it ends where targets cannot be reached."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import posture_opt as po
from posture_opt.compensation.nearest_postures import rotation_vectors
from tests.helpers.command_line import invoke

CORRECTIONS = {"shoulder_lift.a": "0.8 mm", "elbow.theta": "0.05 deg", "wrist_2.alpha": "0.03 deg"}
PLAY = {"kind": "backlash", "joint": "shoulder_pan", "estimate": {"width": "0.4 mrad"}}
SAG = {"kind": "joint_compliance", "joint": "elbow", "estimate": {"compliance": "10 urad/(N m)"}}


def ur10(*effects: dict, **more: object) -> Any:
    robot = {"kind": "preset", "name": "ur10", "corrections": CORRECTIONS}
    return po.problem_from_dict({
        "name": "arm", "robot": robot, "effects": list(effects), **more,
        "uncertainty": {"repeatability": "0.02 mm"},
    })  # fmt: skip


def postures(count: int, seed: int = 0) -> np.ndarray:
    q = np.random.default_rng(seed).uniform(-1.2, 1.2, (count, 6))
    q[:, 2] = np.abs(q[:, 2]) + 0.4
    q[:, 4] = np.abs(q[:, 4]) + 0.4
    return q


def table(problem: Any, q: np.ndarray, **more: object) -> dict[str, object]:
    return {f"{name} [rad]": q[:, j] for j, name in enumerate(problem.robot.joint_names)} | more


def test_the_order_of_the_targets_decides_from_which_side_a_joint_arrives() -> None:
    """Backlash: the same targets backwards need other values of that joint, by its whole width; stated sides do not."""
    problem, q = ur10(PLAY), postures(12)
    forth, back = (po.compensate(problem, table(problem, rows)) for rows in (q, q[::-1]))
    change = forth.q[1:-1, 0] - back.q[::-1][1:-1, 0]
    turning = np.sign(np.diff(q[:, 0]))[:-1] == np.sign(np.diff(q[:, 0]))[1:]
    assert np.abs(change[turning]) == pytest.approx(4e-4, rel=0.02)
    assert np.abs(change[~turning]) == pytest.approx(0, abs=2e-6)
    stated = {"shoulder_pan.approach": np.ones(12)}
    forth, back = (po.compensate(problem, table(problem, rows, **stated)) for rows in (q, q[::-1]))
    assert np.allclose(forth.q, back.q[::-1], atol=1e-5)


def test_where_nobody_says_the_side_half_the_backlash_is_left() -> None:
    problem, q = ur10(PLAY), postures(1)
    unknown = po.compensate(problem, table(problem, q))
    known = po.compensate(problem, table(problem, q, **{"shoulder_pan.approach": [1.0]}))
    lever = np.linalg.norm(np.asarray(problem.arm.jacobian(q[0]))[:3, 0])
    assert np.sqrt(unknown.left[0] ** 2 - known.left[0] ** 2) == pytest.approx(2e-4 * lever, rel=0.02)
    task = {"kind": "insert", "position": ["0.6 m", "0.2 m", "0.3 m"], "approach": {"shoulder_pan": 1}}
    # Joint values are rounded beside the scatter, which differs a little between the two.
    assert po.compensate(ur10(PLAY, task=task), table(problem, q)).left[0] == pytest.approx(known.left[0], rel=1e-4)


def test_payload_and_joint_columns_alone() -> None:
    """Joint columns alone mean the drawn arm; more load needs more lift."""
    problem, q = ur10(SAG), postures(8)
    light, heavy = (po.compensate(problem, table(problem, q, **{"payload [kg]": np.full(8, m)})) for m in (0.0, 8.0))
    T = np.asarray(po.Arm(problem.nominal).pose(q))
    assert np.allclose(light.wanted.position, T[:, :3, 3])
    for mass, found in ((0.0, light), (8.0, heavy)):
        reached = np.asarray(problem.arm.under(replace(problem.arm.inputs, payload=mass)).pose(found.q))
        assert np.abs(reached[:, :3, 3] - T[:, :3, 3]).max() < 2e-6  # rounded joint values
        turned = rotation_vectors(reached[:, :3, :3] @ T[:, :3, :3].transpose(0, 2, 1))
        assert np.abs(turned).max() < 2e-6
    assert np.abs(light.q - heavy.q).max() > 1e-4


def test_a_planar_arm_and_a_slide() -> None:
    """Coordinates that the arm cannot change may be left out; mm for slides; orientations as near as it can."""
    planar = po.problem_from_dict({
        **po.load_problem("insert_planar_2r").to_dict(), "name": "planar",
    })  # fmt: skip
    section = planar.to_dict()
    section["robot"]["corrections"] = {"joint1.a": "2 mm", "joint2.theta": "0.1 deg"}
    planar = po.problem_from_dict(section)
    found = po.compensate(planar, {"x [m]": [0.9, 1.2], "y [m]": [0.4, 0.6]})
    for q, x in zip(found.q, ([0.9, 0.4, 0], [1.2, 0.6, 0]), strict=True):
        assert np.linalg.norm(np.asarray(planar.arm.position(q)) - x) < 1e-4
    section = po.load_problem("insert_scara").to_dict()
    joints = po.load_problem("insert_scara").robot.joints
    section["robot"]["corrections"] = {f"{joints[0].name}.a": "1 mm", f"{joints[1].name}.alpha": "1 mrad"}
    scara = po.problem_from_dict(section)
    near = np.array([[(j.lower + 2 * j.upper) / 3 for j in joints]])
    found = po.compensate(scara, {f"{j.name} [{j.unit}]": near[:, k] for k, j in enumerate(joints)})
    assert found.after.off[0] < 1e-5
    assert 1e-4 < found.after.turned[0] < 3e-3


def test_rows_and_units_of_the_file_are_kept(tmp_path: Path) -> None:
    path = tmp_path / "targets.csv"
    path.write_text("pose, z [m], y [cm], x [mm]\nb, 0.300, 20, 600\na, 0.250, -10.0, 550\n")
    (tmp_path / "arm.yaml").write_text(ur10(SAG).to_yaml())
    answer = invoke("compensate", path, "--problem", tmp_path / "arm.yaml", "--out", tmp_path / "out", "--no-plots")
    assert answer.exit_code == 0, answer.output
    rows = list(csv.reader((tmp_path / "out" / "compensated.csv").read_text().splitlines()))
    names = [f"{name} [deg]" for name in ur10().robot.joint_names]
    assert rows[0] == [*names, "pose", "z [m]", "y [cm]", "x [mm]", "off [mm]", "left [mm]"]
    assert [row[6:10] for row in rows[1:]] == [["b", "0.300", "20", "600"], ["a", "0.250", "-10.0", "550"]]
    q = np.radians([[float(cell) for cell in row[:6]] for row in rows[1:]])
    reached = np.asarray(ur10(SAG).arm.position(q))
    assert np.abs(reached - [[0.6, 0.2, 0.3], [0.55, -0.1, 0.25]]).max() < 5e-6
    assert all(float(row[-1]) > 0 for row in rows[1:])


@pytest.mark.conformance
def test_what_cannot_be_reached_is_told_by_line_and_nothing_is_written(tmp_path: Path) -> None:
    path, out = tmp_path / "targets.csv", tmp_path / "out"
    path.write_text("x [mm], y [mm], z [mm]\n600, 200, 300\n\n2600, 0, 300\n0, 0, 5000\n")
    (tmp_path / "arm.yaml").write_text(ur10(SAG).to_yaml())
    answer = invoke("compensate", path, "--problem", tmp_path / "arm.yaml", "--out", out)
    assert answer.exit_code == 3
    assert "2 of 3 targets cannot be reached" in answer.stderr
    assert f"{path}:4: the target lies at least" in answer.stderr
    assert f"{path}:5: the target lies at least" in answer.stderr
    assert not out.exists()
    with pytest.raises(po.errors.NoSolutionError) as error:
        po.compensate(ur10(SAG), path)
    assert error.value.solution.reached.tolist() == [True, False, False]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("x [mm], y [mm]\n1, 2\n", "the column z is missing"),
        ("shoulder_pan [deg], x [mm], y [mm], z [mm]\n1, 2, 3, 4\n", "the column of this joint is missing"),
        ("qw, qx, qy, qz\n1, 0, 0, 0\n", "nothing says where to go"),
        ("x [mm], y [mm], z [mm], qw\n1, 2, 3, 1\n", "the quaternion lacks qx, qy, qz"),
        ("x [mm], y [mm], z [mm], target\n1, 2, 3, a\n", "targets have no such column"),
        ("x, y [mm], z [mm]\n1, 2, 3\n", "the column has no unit"),
        ("X [mm], Y [mm], Z [mm]\n1, 2, 3\n", r"unknown 'X' \(did you mean x\?\)"),
        ("x [mm], y [mm], z [mm]\n", "no row behind the header"),
    ],
)
def test_targets_that_cannot_be_read(text: str, said: str, tmp_path: Path) -> None:
    (tmp_path / "targets.csv").write_text(text)
    with pytest.raises(po.errors.InputError, match=said):
        po.compensate(ur10(), tmp_path / "targets.csv")


@pytest.mark.long
def test_targets_of_another_frame_are_told_at_once() -> None:
    """The mistake after a calibration with a tracker: targets in the robot's frame, a base 2.5 m off in the file."""
    base = {"xyz": ["2.5 m", "-0.8 m", "0.15 m"], "rpy": ["0 deg", "0 deg", "0 deg"]}
    problem = po.problem_from_dict({"robot": {"kind": "preset", "name": "ur10", "base": base}})
    targets = {"x [mm]": [650.0] * 3, "y [mm]": [270.0, 0.0, -100.0], "z [mm]": [230.0] * 3}
    with pytest.raises(po.errors.NoSolutionError, match="3 of 3 targets") as failed:
        po.compensate(problem, targets)
    assert '--base "0, 0, 0"' in str(failed.value)
    assert "(2500, -800, 150) mm" in str(failed.value)
    inside = po.problem_from_dict({"robot": {"kind": "preset", "name": "ur10"}})
    assert po.compensate(inside, targets).reached.all()


def test_postures_beyond_the_limits_are_refused() -> None:
    q = postures(2)
    q[1, 2] = 7.0
    with pytest.raises(po.errors.InputError, match=r"2: elbow: 7 rad lies beyond its limits"):
        po.compensate(ur10(), table(ur10(), q))


ARM = "insert_planar_2r_calibrated"
ROWS = (("50.5", "-40.25", "1200.5", "300.25"), ("45.5", "-30.75", "1250.5", "350.75"))
HEADERS = ("joint1 [{}]", "joint2 [{}]", "x [mm]", "y [mm]")


def compensated(folder: Path, separator: str, decimal: str, degree: str, encoding: str = "utf-8") -> list[list[str]]:
    """The cells of ``compensated.csv`` for targets in these marks."""
    rows = [[header.format(degree) for header in HEADERS], *([v.replace(".", decimal) for v in row] for row in ROWS)]
    if separator == decimal:
        rows[1:] = [[f'"{cell}"' for cell in row] for row in rows[1:]]
    path = folder / "targets.csv"
    path.write_text("".join(separator.join(row) + "\n" for row in rows), encoding=encoding)
    answer = invoke("compensate", path, "--problem", ARM, "--out", folder / "out", "--no-plots")
    assert answer.exit_code == 0, answer.output
    text = (folder / "out" / "compensated.csv").read_text(encoding="utf-8")
    return list(csv.reader(text.splitlines(), delimiter=separator))


def numbers(rows: list[list[str]], decimal: str) -> np.ndarray:
    assert all("." not in cell for row in rows for cell in row) or decimal == "."
    return np.array([[float(cell.replace(decimal, ".")) for cell in row] for row in rows])


@pytest.mark.parametrize(("separator", "decimal"), [(";", ","), ("\t", "."), (",", ",")])
def test_separators_and_decimal_marks_come_back(tmp_path: Path, separator: str, decimal: str) -> None:
    plain, other = tmp_path / "plain", tmp_path / "other"
    plain.mkdir(), other.mkdir()
    expected = compensated(plain, ",", ".", "deg")
    found = compensated(other, separator, decimal, "deg")
    assert found[0] == expected[0]
    np.testing.assert_array_equal(numbers(found[1:], decimal), numbers(expected[1:], "."))


@pytest.mark.parametrize("degree", ["Grad", "º"])
def test_degrees_in_other_words_are_degrees_and_come_back(tmp_path: Path, degree: str) -> None:
    found = compensated(tmp_path, ";", ",", degree)
    assert found[0][:2] == [f"joint1 [{degree}]", f"joint2 [{degree}]"]
    inside = np.radians(numbers(found[1:], ",")[:, :2])
    problem = po.load_problem(ARM)
    wanted = [[float(x) / 1e3 for x in row[2:]] for row in ROWS]
    np.testing.assert_allclose([problem.arm.position(q)[:2] for q in inside], wanted, atol=2e-4)
    assert po.problem_from_dict({
        "robot": {"kind": "preset", "name": "planar_2r"}, "uncertainty": {"sigma": {"joint1.theta": f"2 {degree}"}}
    }).sources.sigma[0] == pytest.approx(np.radians(2))  # fmt: skip


def test_a_degree_sign_in_latin_1_is_read(tmp_path: Path) -> None:
    assert compensated(tmp_path, ";", ",", "°", "latin-1")[0][0] == "joint1 [°]"
