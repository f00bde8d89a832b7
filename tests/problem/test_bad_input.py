"""Bad problem files: each names file, line, key and a hint, all faults of a file at once, with exit code 2."""

from __future__ import annotations

import copy
import math
import re
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import posture_opt as po
from posture_opt.problem.yaml_source import parse_yaml

ROBOT = """\
name: A test
robot:
  kind: dh
  joints:
    - {name: joint1, type: revolute, a: 1 m}
    - {name: joint2, type: revolute, a: 1 m}
"""


def faults(folder: Path, text: str) -> list[str]:
    """The lines of the message that loading ``text`` raises, without the folder."""
    path = folder / "problem.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(po.errors.InputError) as caught:
        po.load_problem(path)
    assert caught.value.exit_code == 2
    return str(caught.value).replace(f"{folder}/", "").splitlines()


CASES = {
    # what is added to ROBOT: line, key and message, hint
    "unknown key": ("tsk: {kind: insert}", 7, "tsk: unknown key", "did you mean 'task'"),
    "unknown key inside": ("task: {kind: insert, dirction: [0, 0, 1]}", 7, "task.dirction: unknown key", "'direction'"),
    "missing unit": ("task: {kind: insert, position: [1, 0 m, 0 m]}", 7, "task.position[0]: the length has", "1 m"),
    "wrong dimension": ("uncertainty:\n  sigma:\n    joint1.a: 1 deg", 9, "sigma.joint1.a: 'deg' is not", "10 mm"),
    "unknown unit": ("uncertainty:\n  sigma:\n    joint1.a: 1 mmm", 9, "sigma.joint1.a: unknown unit 'mmm'", "10 mm"),
    "nan": ("task:\n  kind: insert\n  direction: [0, .nan, 1]", 9, "task.direction[1]: nan is not a finite", ""),
    "infinite": ("task:\n  kind: insert\n  tilt: .inf", 9, "task.tilt: inf is not a finite", "1 deg"),
    "nan with a unit": ("uncertainty: {sigma: {joint1.a: nan mm}}", 7, "'nan mm' is not a finite number", "10 mm"),
    "zero direction": ("task: {kind: insert, direction: [0, 0, 0]}", 7, "task.direction: a direction of", "[0, 0, -1]"),
    "two targets": (
        "task:\n  kind: insert\n  position: [1 m, 0 m, 0 m]\n  region: {min: [0 m, 0 m, 0 m], max: [1 m, 1 m, 1 m]}",
        7,
        "task: position and region are both given",
        "keep one",
    ),
    "negative sigma": ("uncertainty:\n  sigma: {joint1.a: -1 mm}", 8, "deviation -1 mm is negative", "write 1 mm"),
    "unknown parameter": ("uncertainty: {sigma: {joint1.thet: 1 deg}}", 7, "no such parameter", "'joint1.theta'"),
    "correlation above 1": (
        "uncertainty:\n  sigma: {joint1.a: 1 mm, joint2.a: 1 mm}\n  correlation:\n    - [joint1.a, joint2.a, 1.5]",
        10,
        "uncertainty.correlation[0]: the correlation 1.5 lies outside",
        "",
    ),
    "correlation without sigma": (
        "uncertainty: {sigma: {joint1.a: 1 mm}, correlation: [[joint1.a, joint2.a, 0.5]]}",
        7,
        "uncertainty.correlation[0]: 'joint2.a' has no sigma",
        "add it under sigma",
    ),
    "sigma and covariance": (
        "uncertainty: {sigma: {joint1.a: 1 mm}, covariance: none.csv}",
        7,
        "uncertainty.covariance: covariance and sigma are both given",
        "leave out",
    ),
    "not positive semidefinite": (
        "uncertainty:\n  sigma: {joint1.a: 1 mm, joint2.a: 1 mm, joint1.theta: 1 deg}\n"
        "  correlation: [[joint1.a, joint2.a, 0.9], [joint2.a, joint1.theta, 0.9], [joint1.a, joint1.theta, -0.9]]",
        9,
        # -0.8: the correlation matrix has the eigenvalues 1.9 (twice) and 1 - 2 * 0.9
        "smallest eigenvalue of the correlation matrix -0.8",
        "make them smaller",
    ),
    "unknown task": ("task: {kind: insrt}", 7, "task.kind: 'insrt' is not known here", "'insert'"),
    "task without kind": (
        "task: {direction: [0, 0, 1]}",
        7,
        "task.kind: is missing",
        "write kind: custom | dispense | drill",
    ),
    "unknown effect": (
        "effects: [{kind: joint_complience, joint: joint1}]",
        7,
        "'joint_complience' is not known here",
        "'joint_compl",
    ),
    "effect of no joint": ("effects: [{kind: backlash}]", 7, "effects[0].joint: is missing", ""),
    "effect of another arm": ("effects: [{kind: backlash, joint: elbow}]", 7, "no joint 'elbow'", "joint1, joint2"),
    "estimate of nothing": (
        "effects: [{kind: backlash, joint: joint1, estimate: {hight: 1 mrad}}]",
        7,
        "has no parameter 'hight'",
        "width",
    ),
    "estimate without unit": ("effects: [{kind: backlash, joint: joint1, estimate: {width: 1}}]", 7, "no unit", "deg"),
    "side of no joint": ("task: {kind: insert, approach: {elbow: 1}}", 7, "no such joint", "joint1"),
    "temperature of no unit": ("task: {kind: insert, temperature: 25}", 7, "is no temperature", "23.5 degC"),
    "unknown solver": ("solver: {kind: ipop}", 7, "solver.kind: 'ipop' is not known here", "'ipopt'"),
    "no starts": ("solver: {starts: 0}", 7, "solver.starts: must be 1 or greater, not 0", ""),
    "a word for a number": ("solver: {starts: many}", 7, "solver.starts: 'many' is not a whole number", ""),
    "too short": ("task: {kind: insert, direction: [0, 1]}", 7, "task.direction: 2 entries, 3 expected", ""),
    "text for a section": ("task: insert", 7, "task: 'insert' is not a mapping", ""),
    "duplicate key": (
        "task: {kind: insert}\ntask: {kind: drill}",
        8,
        "task: the key is given twice, first in line 7",
        "",
    ),
    "beyond a bound": ("task: {kind: insert, tilt: 100 deg}", 7, "task.tilt: must be 90 deg or less", ""),
}


@pytest.mark.parametrize("case", CASES)
def test_fault_names_line_key_and_hint(case: str, tmp_path: Path) -> None:
    added, line, message, hint = CASES[case]
    found = faults(tmp_path, ROBOT + added + "\n")
    assert len(found) == 1, "one cause, one message"
    assert found[0].startswith(f"problem.yaml:{line}: ")
    assert message in found[0]
    assert hint in found[0]
    assert not re.search(r"pydantic|Input should|literal\[|function-|extra_forbidden", found[0])


@pytest.mark.parametrize(
    ("joint", "message"),
    [
        (
            "{name: a, type: revolute, a: 1 m, limits: [90 deg, -90 deg]}",
            "robot.joints[0].limits: the limits are crossed",
        ),
        (
            "{name: a, type: revolut, a: 1 m}",
            "robot.joints[0].type: 'revolut' is not known here – did you mean 'revolute'",
        ),
        ("{nam: a, type: revolute, a: 1 m}", "robot.joints[0].nam: unknown key – did you mean 'name'?"),
        ("{type: revolute, a: 1 m}", "robot.joints[0].name: is missing"),
        ("{name: a, type: revolute, a: 1}", "robot.joints[0].a: the length has no unit (here 1) – write 1 mm or 1 m"),
        ("{name: 7, type: revolute, a: 1 m}", "robot.joints[0].name: 7 is not a text – put it in quotes: '7'"),
    ],
)
def test_fault_in_a_joint(joint: str, message: str, tmp_path: Path) -> None:
    (found,) = faults(tmp_path, f"robot:\n  kind: dh\n  joints:\n    - {joint}\n")
    assert found.startswith("problem.yaml:4: ")
    assert message in found


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "problem.yaml: the file is empty"),
        ("# only a comment\n", "problem.yaml: the file is empty"),
        ("- a\n- b\n", "problem.yaml:1: the file holds a list"),
        ("hello\n", "problem.yaml:1: the file holds a single value"),
        ("a: 1\nb: [1, 2\nc: 3\n", "problem.yaml:3: not YAML"),
        ("a:\n\t- b\n", "problem.yaml:2: not YAML"),
        ("a: 1\n---\nb: 2\n", "problem.yaml:2: the file holds several YAML documents"),
        ("a: &a [*a]\n", "problem.yaml:1: a: an alias (*name) contains itself"),
        ("[" * 5_000, "problem.yaml: the file is nested too deeply"),
        ("a: b\x00c\n", "problem.yaml:1: not YAML: the character U+0000"),
        ("name: x\n", "problem.yaml:1: robot: is missing – write for example robot: {kind: preset"),
    ],
)
def test_file_that_is_no_problem_file(text: str, message: str, tmp_path: Path) -> None:
    found = faults(tmp_path, text)
    assert len(found) == 1
    assert found[0].startswith(message)


def test_foreign_tag_is_not_executed(tmp_path: Path) -> None:
    found = faults(tmp_path, ROBOT + f"data: !!python/object/apply:os.mkdir ['{tmp_path}/made']\n")
    assert not (tmp_path / "made").exists()
    assert any("problem.yaml:7: data" in line for line in found)


def test_alias_bomb_is_refused_at_once(tmp_path: Path) -> None:
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]" for i in range(1, 10)]  # 10^10 entries
    start = time.perf_counter()
    (found,) = faults(tmp_path, "\n".join(lines))
    assert time.perf_counter() - start < 5  # s; unfolding all of it would fill any memory
    assert "the aliases (*name) of the file unfold to more than" in found


def test_huge_file_is_refused_unread(tmp_path: Path) -> None:
    path = tmp_path / "huge.yaml"
    with path.open("wb") as stream:
        stream.truncate(100_000_000)
    start = time.perf_counter()
    with pytest.raises(po.errors.InputError, match="larger than 1 MB"):
        po.load_problem(path)
    assert time.perf_counter() - start < 0.5  # s; reading and parsing it would take minutes


def test_places_that_are_no_files(tmp_path: Path) -> None:
    (tmp_path / "arm.yaml").write_text(ROBOT)
    with pytest.raises(
        po.errors.InputError, match=r"no such file: .*amr\.yaml – did you mean .*arm\.yaml in the same folder\?"
    ):
        po.load_problem(tmp_path / "amr.yaml")
    with pytest.raises(po.errors.InputError, match="this is a folder"):
        po.load_problem(tmp_path)
    (tmp_path / "latin.yaml").write_bytes(b"name: x\nrobot: caf\xe9\n")
    with pytest.raises(po.errors.InputError, match=r"latin\.yaml:2: not UTF-8 text \(byte 0xe9\)"):
        po.load_problem(tmp_path / "latin.yaml")


def test_all_faults_of_all_sections_at_once(tmp_path: Path) -> None:
    text = (
        "robot: {kind: preset, name: planar2r}\n"
        "uncertainty: {sigma: {joint1.a: -1 mm, joint2.a: 1}}\n"
        "task: {kind: insrt, direction: [0, 0, 0], clearance: 0 mm}\n"
        "solver: {starts: 0}\n"
        "efects: []\n"
        "name: a\n"
        "name: b\n"
    )
    found = faults(tmp_path, text)
    lines = [int(line.split(":")[1]) for line in found]
    assert lines == sorted(lines), "in the order of the file"
    keys = [line.split(": ")[1] for line in found]
    assert sorted(keys) == [
        "efects",
        "name",
        "robot.name",
        "solver.starts",
        "task.clearance",
        "task.direction",
        "task.kind",
        "uncertainty.sigma.joint1.a",
        "uncertainty.sigma.joint2.a",
    ]


@pytest.mark.parametrize(
    ("robot", "name", "hint"),
    [
        ("ur10e", "wrist_1.thta", "did you mean 'wrist_1.theta'? wrist_1 has theta, d, a, alpha, beta"),
        ("ur10e", "wrst_1.theta", "did you mean 'wrist_1.theta'? parameters have: base, shoulder_pan, "),
        ("ur10e", "hand.grip", "parameters have: base, shoulder_pan, "),
        ("ur10f", "wrist_1.thta", "did you mean 'wrist_1.theta'? wrist_1 has "),  # the robot itself is not known
    ],
)
def test_unknown_parameter_offers_those_of_its_joint_first(robot: str, name: str, hint: str, tmp_path: Path) -> None:
    text = f"robot: {{kind: preset, name: {robot}}}\nuncertainty: {{sigma: {{{name}: 0.02 deg}}}}\n"
    found = faults(tmp_path, text)[-1]
    start = f"problem.yaml:2: uncertainty.sigma.{name}: the robot has no such parameter – {hint}"
    assert found.startswith(start)
    assert found.count(",") < 13, "a short list"


def test_urdf_that_does_not_exist(tmp_path: Path) -> None:
    (found,) = faults(tmp_path, "robot:\n  kind: urdf\n  file: none.urdf\n  base_link: base\n  tip_link: tool\n")
    assert found == "problem.yaml:3: robot.file: none.urdf: no such file"
    (tmp_path / "arm.urdf").write_text("<robot")
    text = "robot: {kind: urdf, file: am.urdf}\n"
    (found,) = faults(tmp_path, text)
    assert found == "problem.yaml:1: robot.file: am.urdf: no such file – did you mean arm.urdf in the same folder?"
    (found,) = faults(tmp_path, text.replace("am.", "arm."))
    assert found.startswith("problem.yaml:1: robot.file: arm.urdf:1: the file is not XML: ")
    with (tmp_path / "arm.urdf").open("wb") as stream:
        stream.truncate(100_000_000)
    (found,) = faults(tmp_path, text.replace("am.", "arm."))
    assert found.startswith("problem.yaml:1: robot.file: arm.urdf: the file is larger than 50 MB")


def test_urdf_named_relative_to_a_folder_says_where_it_was_looked_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(po.errors.InputError) as caught:
        po.problem_from_dict({"robot": {"kind": "urdf", "file": "none.urdf"}})
    assert str(caught.value).startswith(f"robot.file: none.urdf (in {tmp_path}): no such file")


def covariance_faults(folder: Path, table: str) -> list[str]:
    (folder / "cov.csv").write_text(table, encoding="utf-8")
    return faults(folder, ROBOT + "uncertainty: {covariance: cov.csv}\n")


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ("", "cov.csv: the covariance file is empty"),
        ("name, joint1.a [mm]\n", "cov.csv:1: no row for joint1.a"),
        ("name, joint1.a\njoint1.a, 1\n", "cov.csv:1: joint1.a: the column has no unit – write joint1.a [m]"),
        ("name, joint1.a [deg]\njoint1.a, 1\n", "cov.csv:1: joint1.a: 'deg' is not a unit of length"),
        ("name, joint1.b [mm]\njoint1.b, 1\n", "cov.csv:1: joint1.b: the robot has no such parameter – did you mean"),
        ("name, joint1.a [mm]\njoint1.a, nan\n", "cov.csv:2: joint1.a: column 2 holds no finite number"),
        ("name, joint1.a [mm]\njoint1.a, 1, 2\n", "cov.csv:2: joint1.a: 2 numbers in the row, 1 columns"),
        (
            "name, joint1.a [mm], joint2.a [mm]\njoint1.a, 1, 0.5\njoint2.a, 0.4, 1\n",
            "cov.csv:1: not symmetric: row joint1.a, column joint2.a and the reverse differ by 20 %",
        ),
        (
            "name, joint1.a [mm], joint2.a [mm]\njoint1.a, 1e155, 1e155\njoint2.a, 0, 1e155\n",  # its squares overflow
            "cov.csv:1: not symmetric: row joint1.a, column joint2.a and the reverse differ by 100 %",
        ),
        (
            "name, joint1.a [mm], joint2.a [mm]\njoint1.a, 1, 2\njoint2.a, 2, 1\n",
            "problem.yaml:7: uncertainty.covariance: the correlation of joint1.a and joint2.a is 2",
        ),
        (
            "name, joint1.a [mm]\njoint1.a, -1\n",
            "problem.yaml:7: uncertainty.covariance: negative variance of joint1.a",
        ),
    ],
)
def test_fault_in_a_covariance_file(table: str, message: str, tmp_path: Path) -> None:
    (found,) = covariance_faults(tmp_path, table)
    assert found.startswith(message)


@pytest.mark.parametrize("section", ["uncertainty: {covariance: other}", "task: {kind: trace, path: other}"])
@pytest.mark.parametrize(
    "content",
    [
        "root:x0r:0:0:/bin/sh\nbin:x0r:1:1\n", "name, x0rkey [mm]\nx0rkey, 1\n", "x [mm], y [mm]\n1, x0r\n2, 3\n",
        "name, joint1.a [mm]\njoint1.a, x0r\nx0r, 1\n", 'name, "x0r\n', "x0r\0", "x0r\n\xff\n", "password = x0r\n",
        "name, x0r.a [mm], x0r.b [mm]\nx0r.a, 1, 0.73\nx0r.b, 0.74, 1\n",
    ],
)  # fmt: skip
def test_errors_of_a_named_file_do_not_print_it(section: str, content: str, tmp_path: Path) -> None:
    """A problem of somebody else may name any file: what is in it is not theirs to see."""
    (tmp_path / "other").write_bytes(content.encode("latin-1"))
    found = faults(tmp_path, ROBOT + section + "\n")
    assert found
    assert not any(secret in line for line in found for secret in ("x0r", "root", "password", "0.73", "0.74"))
    assert all("other" in line for line in found)


def test_bad_dict_names_keys_without_a_file() -> None:
    with pytest.raises(po.errors.InputError) as caught:
        po.problem_from_dict({"robot": {"kind": "preset", "name": "planar_2r"}, "task": {"kind": "insert", "tilt": 3}})
    assert str(caught.value) == "task.tilt: the angle has no unit (here 3) – write 3 deg or 3 rad"
    with pytest.raises(po.errors.InputError, match="a problem is a mapping of sections, not list"):
        po.problem_from_dict([])  # type: ignore[arg-type]


WHOLE = """\
name: Everything
robot:
  kind: dh
  joints:
    - {name: joint1, type: revolute, a: 1 m, limits: [-90 deg, 90 deg], mass: 1 kg, com: [0 m, 0 m, 0 m], gear_ratio: 9}
    - {name: joint2, type: prismatic, limits: [0 m, 1 m]}
  base: {xyz: [0 m, 0 m, 0 m], rpy: [0 deg, 0 deg, 0 deg]}
  tool: free
  payload: 1 kg
  gravity: [0, 0, -9.81]
uncertainty:
  sigma: {joint1.theta: 1 deg, joint1.a: 1 mm}
  correlation: [[joint1.theta, joint1.a, 0.5]]
  measurement: {position: 1 mm, orientation: 1 deg}
task:
  kind: insert
  direction: [0, 0, -1]
  region: {min: [0 m, 0 m, 0 m], max: [1 m, 1 m, 1 m]}
  tool_axis: [0, 0, 1]
  tilt: 1 deg
  clearance: 1 mm
  criterion: miss
  minimize: [{kind: limit_margin, at_least: 5 deg}]
effects:
  - {kind: backlash, joint: joint1, estimate: {width: 1 mrad}}
  - {kind: cyclic_error, joint: joint1, cycles: 17.5, estimate: {sin: 1 mrad, cos: 0 rad}}
  - {kind: hysteresis, joint: joint1, travel: 0.5 rad}
  - {kind: joint_coupling, joint: joint2, follows: joint1, into: slide}
  - {kind: thermal_growth, length: all}
  - {kind: drift, course: linear, constant: 10 s}
solver: {kind: ipopt, starts: 3, seed: 0}
data: {distances: [[front/0, front/1, 50 mm]]}
"""
JUNK = [None, True, 0, -1, 1.5, math.nan, math.inf, 10**400, "", "x", "1 deg", "-1 mm", "1", "nan m", "1e400 m", "free"]
JUNK += [[], {}, [[]], [{}], [1], ["1 m", "2 m"], {"kind": "x"}, {"a": 1}]
JARGON = r"pydantic|Input|literal\[|function-|Error|None|tuple|dict|valid |<class|\bint\b|\bfloat\b|\bstr\b|unable"


def places(data: Any, place: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    yield place
    entries = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ()
    for key, value in entries:
        yield from places(value, (*place, key))


@pytest.mark.fuzz
def test_junk_anywhere_is_told_in_plain_words() -> None:
    whole = parse_yaml(WHOLE).data
    po.problem_from_dict(whole)
    told: list[po.errors.Issue] = []
    for *around, last in list(places(whole))[1:]:
        for junk in JUNK:
            data = copy.deepcopy(whole)
            entry = data
            for part in around:
                entry = entry[part]
            entry[last] = junk
            try:
                po.problem_from_dict(data)
            except po.errors.InputError as error:
                told += error.issues
    assert len(told) > 1000
    assert all(issue.key for issue in told)
    assert [str(issue) for issue in told if re.search(JARGON, str(issue))] == []


def test_a_capsule_stated_twice_is_refused(tmp_path: Path) -> None:
    capsule = "{joint: elbow, from: [0 m, 0 m, 0 m], to: [0.5 m, 0 m, 0 m], radius: 60 mm}"
    (found,) = faults(tmp_path, f"robot:\n  kind: preset\n  name: ur10e\n  shape:\n  - {capsule}\n  - {capsule}\n")
    assert found.startswith("problem.yaml:6: robot.shape[1]: the same capsule as entry 0")
