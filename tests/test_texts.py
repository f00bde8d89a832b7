"""No file brings a name that ends a line, and no cell of a CSV file is computed by a spreadsheet."""

from __future__ import annotations

import copy
import csv
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import posture_opt as po
from posture_opt.texts import csv_line, unguarded
from posture_opt.uncertainty.uncertainty_section import covariance_text, read_covariance
from tests.helpers.command_line import invoke

REFUSED = ["\n", "\r", "\t", "\0", "\x1b", "\x7f", "\x85", "\u2028", "\u2029", "\ud800", "\udfff", "\ufffe"]
PLACES: list[tuple[str | int, ...]] = [
    ("name",), ("robot", "joints", 0, "name"), ("robot", "joints", 0, "a"), ("cell", "obstacles", 0, "name"),
    ("task", "features", 0, "name"), ("task", "clearance"), ("task", "kind"),
    ("uncertainty", "measurement", "position"),
]  # fmt: skip
FILE: dict[str, Any] = {
    "name": "n",
    "robot": {"kind": "dh", "joints": [{"name": f"j{k}", "type": "revolute", "a": "1 m"} for k in (1, 2)]},
    "uncertainty": {"sigma": {"j2.theta": "1 deg"}, "measurement": {"position": "0.1 mm"}},
    "cell": {"obstacles": [{"name": "o", "kind": "sphere", "radius": "0.1 m", "xyz": ["3 m", "3 m", "3 m"]}]},
    "task": {
        "kind": "insert", "direction": [0, -1, 0], "clearance": "1 mm",
        "features": [{"name": "f", "position": ["1 m", "0 m", "0 m"]}],
    },
}  # fmt: skip


@pytest.mark.parametrize("character", REFUSED)
def test_every_text_of_a_problem_is_refused_with_its_key(character: str) -> None:
    for place in PLACES:
        data = copy.deepcopy(FILE)
        entry: Any = data
        for part in place[:-1]:
            entry = entry[part]
        entry[place[-1]] = f"{entry[place[-1]]}{character}x"
        with pytest.raises(po.errors.InputError) as caught:
            po.problem_from_dict(data)
        (mine,) = [issue for issue in caught.value.issues if issue.key == place]
        assert f"U+{ord(character):04X}" in mine.message
        assert mine.hint
        str(caught.value).encode()


def test_names_in_yaml_urdf_and_csv_are_refused_with_their_line(tmp_path: Path) -> None:
    (tmp_path / "p.yaml").write_text('robot: {kind: preset, name: planar_2r}\ntask:\n  kind: "insert\\n#"\n')
    with pytest.raises(
        po.errors.InputError, match=r"p\.yaml:3: task\.kind: the text holds a line break \(U\+000A\) – write it"
    ):
        po.load_problem(tmp_path / "p.yaml")
    (tmp_path / "a.urdf").write_text(
        '<robot name="r&#10;cell: none">\n<link name="b"/><link name="t"/>\n<joint name="j&#10;x: 1" type="revolute">'
        '<parent link="b"/><child link="t"/><limit lower="-1" upper="1"/></joint></robot>'
    )
    answer = invoke("new", tmp_path / "a.urdf")
    assert answer.exit_code == 2
    assert answer.output.count("U+000A") == 2
    assert "a.urdf:3" in answer.output
    (tmp_path / "d.csv").write_text('joint1 [deg], joint2 [deg], x [m], y [m],pose\n1,2,3,4,"a\nb"\n1,2,3,4,c\u2028d\n')
    with pytest.raises(po.errors.InputError, match=r"U\+000A(.|\n)*U\+2028"):
        po.read_measurements(tmp_path / "d.csv", po.load_problem("insert_planar_2r_measured"))


def test_the_starter_of_a_urdf_quotes_its_names(tmp_path: Path) -> None:
    """A colon, a comment sign or a quote in a name leaves the starter a problem file."""
    links = '<link name="b"/><link name="m"/><link name="t #"/>'
    joint = '<joint name="{}" type="revolute"><parent link="{}"/><child link="{}"/>{}</joint>'
    end = '<origin xyz="0.3 0 0"/><axis xyz="0 0 1"/><limit lower="-3" upper="3"/>'
    joints = joint.format("null", "b", "m", end) + joint.format("- 'j' #2", "m", "t #", end)
    (tmp_path / "a.urdf").write_text(f'<robot name="Robot: mk2 #">{links}{joints}</robot>')
    answer = invoke("new", tmp_path / "a.urdf")
    assert answer.exit_code == 0, answer.output
    (tmp_path / "p.yaml").write_text(answer.stdout)
    problem = po.load_problem(tmp_path / "p.yaml")
    assert problem.name == "Insertion with the Robot: mk2 #"
    assert problem.robot.joint_names == ("null", "- 'j' #2")


def test_cells_of_csv_files_are_texts_to_spreadsheets_and_read_back() -> None:
    names = ["=cmd()", "+1+2", "-a", "@b", "c d", "'=d", "a, b", 'q"', "x;y", "plain", "'quoted'", "-1.5", "1,5", ""]
    line = csv_line(names)
    (row,) = csv.reader([line], skipinitialspace=True)
    assert [unguarded(cell) for cell in row] == [name.strip() for name in names]
    assert not any(cell.startswith(("=", "+", "@", "-a")) for cell in row)
    assert "-1.5" in row, "numbers keep their sign"


def test_a_covariance_of_hostile_names_reads_back(tmp_path: Path) -> None:
    names, dimensions = ("=a.theta", "b, c.a"), {"=a.theta": "angle", "b, c.a": "length"}
    text = covariance_text(names, np.array([[1.0, 0.1], [0.1, 2.0]]), ["rad", "m"])
    found, covariance = read_covariance(tmp_path / "c.csv", dimensions, text)
    assert found == names
    assert covariance.tolist() == [[1.0, 0.1], [0.1, 2.0]]
