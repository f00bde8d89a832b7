"""``new arm.urdf``: a problem file for a URDF of the user's own, which loads and solves as it is."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

import posture_opt as po
from tests.helpers.command_line import invoke

LINK = '<link name="{0}"/>'
JOINT = (
    '<joint name="{name}" type="{type}"><parent link="{parent}"/><child link="{child}"/>'
    '<origin xyz="{xyz}"/><axis xyz="{axis}"/>{more}</joint>'
)
TURN = '<limit lower="-2.5" upper="2.5" effort="1" velocity="1"/>'
SLIDE = '<limit lower="0" upper="0.04" effort="1" velocity="1"/>'
ROWS = (
    # name, type, parent, child, xyz, axis, more
    ("j1", "revolute", "base", "l1", "0 0 0.3", "0 0 1", TURN),
    ("j2", "revolute", "l1", "l2", "0 0 0.1", "0 1 0", TURN),
    ("j3", "revolute", "l2", "l3", "0 0 0.4", "0 1 0", ""),
    ("j4", "continuous", "l3", "l4", "0 0 0.2", "0 0 1", ""),
    ("j5", "revolute", "l4", "l5", "0 0 0.2", "0 1 0", TURN),
    ("j6", "continuous", "l5", "flange", "0 0 0.1", "0 0 1", ""),
    ("mount", "fixed", "flange", "hand", "0 0 0.05", "0 0 1", ""),
    ("finger1", "prismatic", "hand", "left", "0 0 0.1", "0 1 0", SLIDE),
    ("finger2", "prismatic", "hand", "right", "0 0 0.1", "0 1 0", SLIDE + '<mimic joint="finger1"/>'),
)


def gripper_arm() -> str:
    """Six joints and a hand with two fingers; no masses, meshes of a package that is not there."""
    keys = ("name", "type", "parent", "child", "xyz", "axis", "more")
    links = {row[2] for row in ROWS} | {row[3] for row in ROWS}
    mesh = '<collision><geometry><mesh filename="package://not_there/l2.stl"/></geometry></collision>'
    bodies = [f'<link name="{name}">{mesh}</link>' if name == "l2" else LINK.format(name) for name in sorted(links)]
    joints = "".join(JOINT.format(**dict(zip(keys, row, strict=True))) for row in ROWS)
    return f'<robot name="Own arm">{"".join(bodies)}{joints}</robot>'


def test_the_starter_of_a_urdf_solves_as_it_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "arm.urdf").write_text(gripper_arm(), encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    assert invoke("new", "arm.urdf", "--tip-link", "hand", "--out", "cells/arm.yaml").exit_code == 0
    text = (tmp_path / "cells" / "arm.yaml").read_text(encoding="utf-8")
    assert "\n  file: ../arm.urdf\n" in text
    for said in ("j1  revolute, -143.2 deg to 143.2 deg", "joint j3 has no <limit>", "no <inertial> behind j1"):
        assert said in text
    assert "mesh l2.stl not found" in text
    problem = po.load_problem(tmp_path / "cells" / "arm.yaml")
    assert po.select_posture(problem).status == "optimal"
    assert problem.robot.joint_names == ("j1", "j2", "j3", "j4", "j5", "j6")


HOSTILE = "Robot: mk2 # - [x] &amp;a {&quot;it&apos;s&quot;"
BREAKING = "mesh&#10;cell: none&#10;l2.stl"


def test_names_of_a_urdf_neither_break_nor_inject_yaml(tmp_path: Path) -> None:
    text = gripper_arm().replace("Own arm", HOSTILE).replace('"hand"', '"ha: nd # x"')
    (tmp_path / "arm.urdf").write_text(text.replace("package://not_there/l2.stl", BREAKING), encoding="utf-8")
    written = yaml.safe_load(invoke("new", tmp_path / "arm.urdf").stdout)
    assert written["name"] == 'Insertion with the Robot: mk2 # - [x] &a {"it\'s"'
    assert written["robot"]["tip_link"] == "ha: nd # x"
    assert "cell" not in written


XACRO = '<robot name="a" xmlns:xacro="http://www.ros.org/wiki/xacro">{}</robot>'
UNEXPANDED = {
    "a property": (XACRO.format('<xacro:property name="l" value="1"/>'), "<xacro:property>"),
    "a number": (XACRO.format('<link name="b"/><joint name="${p}j" type="fixed"/>'), '<joint name="${p}j">'),
    "a substitution": ('<robot name="$(arg name)"/>', '<robot name="$(arg name)">'),
}


NAMED = list(zip(UNEXPANDED, ["arm.urdf.xacro", "arm.xacro", "arm.urdf"], strict=True))


@pytest.mark.parametrize(("case", "name"), NAMED)
def test_a_xacro_file_is_told_by_what_is_in_it_wherever_a_urdf_is_read(tmp_path: Path, case: str, name: str) -> None:
    text, found = UNEXPANDED[case]
    file = tmp_path / name
    file.write_text(text, encoding="utf-8")
    problem = tmp_path / "p.yaml"
    problem.write_text(f"robot: {{kind: urdf, file: {name}}}\n", encoding="utf-8")
    there = "arm.urdf" if name != "arm.urdf" else "arm_expanded.urdf"
    for words in (["new", file], ["--task", "insert", "--robot", file], ["--problem", problem]):
        result = invoke(*words)
        assert result.exit_code == 2
        assert f"this is a xacro file, not a URDF: it holds {found}" in result.stderr
        assert f"expand it first: xacro {name} > {there}" in result.stderr
