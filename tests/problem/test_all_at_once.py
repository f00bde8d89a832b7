"""Wrong files tell all of their mistakes in one run: those too that need the robot, while other sections are wrong."""

from __future__ import annotations

from pathlib import Path

import pytest

import posture_opt as po

FILES: dict[str, tuple[int, str]] = {
    # what is wrong: how many mistakes, the file
    "names in every section, robot with a bad tool": (
        5,
        """robot:
  kind: dh
  joints:
    - {name: joint1, type: revolute, a: 1 m}
    - {name: joint2, type: revolute, a: 1 m}
  tool: {xyz: [0, 0, 100]}
uncertainty:
  sigma: {joint3.theta: 1 deg}
effects:
  - {kind: backlash, joint: joint9, estimate: {width: 1 mrad}}
task:
  kind: insert
  position: [1 m, 0, 0]
  approach: {jont1: 1}
  subject_to:
    - {kind: near_posture, posture: {joint7: 0}, at_most: 10 deg}
""",
    ),
    "misspelt keys within misspelt keys": (
        5,
        """robt: {kind: preset, nmae: planar_2r, tol: {xzy: [0 m, 0 m, 0 m]}}
task: {kind: insert, positon: [1 m, 0 m, 0 m]}
""",
    ),
    "cell and task": (
        4,
        """robot: {kind: preset, name: ur10}
cell:
  obstacles:
    - {name: table, kind: bx, size: [1 m, 1 m, 20 mm]}
  clearance: 20
uncertainty: {sigma: {elbow.x: 1 mm}}
task:
  kind: insert
  position: [0.6 m, 0.2 m, 0.1 m]
  approach: {elbw: 1}
""",
    ),
}


@pytest.mark.parametrize("case", FILES)
def test_all_mistakes_of_a_file_are_told_at_once(case: str, tmp_path: Path) -> None:
    count, text = FILES[case]
    file = tmp_path / "wrong.yaml"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(po.errors.InputError) as caught:
        po.load_problem(file)
    assert len(caught.value.issues) == count, str(caught.value)
    assert all(issue.file == str(file) and issue.line and issue.key for issue in caught.value.issues)
    assert len({issue.key for issue in caught.value.issues}) == count


def test_nothing_is_blamed_for_what_another_section_lacks() -> None:
    """A mass that cannot be read is no missing mass, and parameters of an effect that cannot be read may be right."""
    joint = {"name": "joint1", "a": "1 m", "mass": 3, "com": [0, 0, 0]}
    compliance = {"kind": "joint_compliance", "joint": "joint1", "estimate": {"compliance": "8 urad/(N m)"}}
    data = {
        "robot": {"kind": "dh", "joints": [joint]},
        "uncertainty": {"sigma": {"joint_compliance(joint1).compliance": "1 urad/(N m)"}},
        "effects": [compliance],
    }
    with pytest.raises(po.errors.InputError) as caught:
        po.problem_from_dict(data)
    assert [issue.key for issue in caught.value.issues] == [("robot", "joints", 0, "mass")]


@pytest.mark.parametrize("text", ["9**9**9**9 m", "1 m**99999999", "2 m*9**9", "1 " + "m*" * 50 + "m"])
def test_a_unit_is_a_short_text_of_names_and_never_a_computation(text: str) -> None:
    with pytest.raises(po.errors.InputError, match=r"unknown unit|is not a unit|is not a finite number"):
        po.problem_from_dict({"robot": {"kind": "preset", "name": "planar_2r", "tool": {"xyz": [text, 0, 0]}}})
