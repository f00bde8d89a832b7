"""Logs as they come: of ROS, of motion capture, of spreadsheets with decimal commas."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import posture_opt as po

UR5E = {"robot": {"kind": "preset", "name": "ur5e", "base": "free", "tool": "free"}}
NAMES = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")


def rows(count: int = 12) -> tuple[np.ndarray, np.ndarray]:
    rng, arm = np.random.default_rng(1), po.Arm.from_problem(po.problem_from_dict(UR5E))
    q = rng.uniform(-2, 2, (count, 6))
    return q, np.array([arm.pose(v)[:3, 3] for v in q])


def written(path: Path, head: str, q: np.ndarray, x: np.ndarray, before: str = "") -> Path:
    body = [before + ",".join(f"{v:.6f}" for v in (*a, *b)) for a, b in zip(q, x, strict=True)]
    path.write_text("\n".join([head, *body]) + "\n")
    return path


def test_a_stamp_that_nobody_named_is_not_used(tmp_path: Path) -> None:
    q, x = rows()
    columns = {name: f"field.position{k}" for k, name in enumerate(NAMES)}
    head = ",".join(["%time", *columns.values(), "x", "y", "z"])
    path = written(tmp_path / "bag.csv", head, q, x, "1700000000000000000,")
    units = dict.fromkeys(NAMES, "rad") | dict.fromkeys("xyz", "m")
    assert (
        po.read_measurements(path, po.problem_from_dict({**UR5E, "data": {"columns": columns, "units": units}})).time
        is None
    )
    timed = {"columns": {**columns, "time": "time"}, "units": {**units, "time": "ns"}}
    assert po.read_measurements(path, po.problem_from_dict({**UR5E, "data": timed})).time == pytest.approx(1.7e9)


def test_names_of_joints_inside_of_headers_are_proposed(tmp_path: Path) -> None:
    q, x = rows()
    titles = [f"/joint_states/{name}_joint/{what}" for name in NAMES for what in ("position", "velocity")]
    path = written(tmp_path / "log.csv", ",".join([*titles, "x", "y", "z"]), np.repeat(q, 2, axis=1), x)
    with pytest.raises(po.errors.InputError) as caught:
        po.read_measurements(path, po.problem_from_dict(UR5E))
    assert 'elbow: "/joint_states/elbow_joint/position"' in str(caught.value)
    assert 'velocity"' not in caught.value.issues[0].hint


def test_hidden_markers_are_left_out_and_counted(tmp_path: Path) -> None:
    q, x = rows()
    head = ",".join([*(f"{name} [rad]" for name in NAMES), "x [m]", "y [m]", "z [m]"])
    path = written(tmp_path / "mocap.csv", head, q, x)
    lines = path.read_text().splitlines()
    lines[4] = ",".join([*lines[4].split(",")[:6], "", "", ""])
    path.write_text("\n".join(lines))
    data = po.read_measurements(path, po.problem_from_dict(UR5E))
    assert len(data) == 11
    assert data.unmeasured == (5,)
    assert "1 row without any measurement is left out (first line 5)" in data.reading_statements[0].text
    lines[4] += "1"  # z alone
    path.write_text("\n".join(lines))
    with pytest.raises(po.errors.InputError, match="the cell is empty"):
        po.read_measurements(path, po.problem_from_dict(UR5E))


def test_several_markers_in_a_row_and_joints_outside_of_the_chain_say_what_to_do(tmp_path: Path) -> None:
    q, x = rows()
    table = {f"{name} [rad]": q[:, k] for k, name in enumerate(NAMES)}
    with pytest.raises(po.errors.InputError, match="one row a marker"):
        po.read_measurements(
            table | {f"{a}{k} [m]": x[:, 0] for k in (1, 2) for a in "xyz"}, po.problem_from_dict(UR5E)
        )
    urdf = (
        '<robot name="r"><link name="a"/><link name="b"/><link name="c"/>'
        '<joint name="torso_1_joint" type="prismatic"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/>'
        '<limit lower="0" upper="1" effort="1" velocity="1"/></joint>'
        '<joint name="torso_2_joint" type="revolute"><parent link="b"/><child link="c"/><axis xyz="0 0 1"/>'
        '<limit lower="-3" upper="3" effort="1" velocity="1"/></joint></robot>'
    )
    (tmp_path / "r.urdf").write_text(urdf)
    robot = {"kind": "urdf", "file": str(tmp_path / "r.urdf"), "base_link": "b", "tip_link": "c"}
    with pytest.raises(po.errors.InputError, match="not between base_link and tip_link"):
        po.read_measurements(
            {
                "torso_1_joint [m]": [0, 0],
                "torso_2_joint [rad]": [0, 1],
                "x [m]": [0, 0],
                "y [m]": [0, 0],
                "z [m]": [0, 0],
            },
            po.problem_from_dict({"robot": robot}),
        )


def test_targets_that_are_copies_are_remarked_on() -> None:
    q, x = rows()
    table = {f"{name} [rad]": np.tile(q[:, k], 2) for k, name in enumerate(NAMES)}
    table |= {f"{axis} [m]": np.tile(x[:, k], 2) for k, axis in enumerate("xyz")} | {
        "target": np.repeat(["a", "b"], 12)
    }
    assert any("to the last digit" in text for text in po.read_measurements(table, po.problem_from_dict(UR5E)).warnings)


def test_paths_and_covariances_with_decimal_commas(tmp_path: Path) -> None:
    (tmp_path / "path.csv").write_text("x [mm];y [mm]\n600,5;100\n700,25;150\n")
    (tmp_path / "c.csv").write_text(
        "name;joint1.theta [mrad];joint2.theta [mrad]\njoint1.theta;1,5;0,2\njoint2.theta;0,2;2\n"
    )
    (tmp_path / "far.csv").write_text("x [m], y [m]\n600.5, 100\n700.25, 150\n")
    joints = [{"name": f"joint{k}", "a": "0.5 m"} for k in (1, 2)]
    problem = {
        "robot": {"kind": "dh", "joints": joints}, "uncertainty": {"covariance": str(tmp_path / "c.csv")},
        "task": {"kind": "trace", "path": str(tmp_path / "path.csv")},
    }  # fmt: skip
    found = po.problem_from_dict(problem)
    assert found.task.points[1] == pytest.approx((0.70025, 0.15, 0))
    with pytest.raises(po.errors.InputError, match="the numbers look like mm"):
        po.problem_from_dict({**problem, "task": {"kind": "trace", "path": str(tmp_path / "far.csv")}})
