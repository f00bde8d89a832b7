"""Every format of an export for every kind of arm, and programs beside the files of other commands."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import posture_opt as po
from posture_opt.export import PROGRAM_FORMATS
from posture_opt.export.export_files import export_kinds
from posture_opt.uncertainty.joint_digits import scatter
from tests.export.programs import READERS
from tests.helpers.command_line import invoke
from tests.helpers.folders import names as names_in
from tests.helpers.variants import conformance

KINDS = list(export_kinds())
PROGRAMS = list(PROGRAM_FORMATS)
ARMS = {
    "insert_panda": [0.3, -0.4, 0.2, -1.9, 0.1, 1.7, 0.6], "insert_ur10": [0.5, -1.9, 1.4, -1.1, 1.5, 0.2],
    "insert_scara": None, "insert_planar_2r": [0.4, 0.9], "insert_urdf_arm": None,
    "insert_ur10_extended": [0.5, -1.9, 1.4, -1.1, 1.5, 0.2],
}  # fmt: skip


def posture(problem: Any, name: str) -> np.ndarray:
    given = ARMS[name]
    robot = problem.robot
    return np.array(given if given else [0.6 * a + 0.4 * b for a, b in zip(robot.lower, robot.upper, strict=True)])


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", conformance(ARMS, ["insert_ur10", "insert_scara", "insert_planar_2r"]))
def test_every_format_is_written_for_every_arm_or_says_why_not(kind: str, name: str) -> None:
    problem = po.load_problem(name)
    if kind == "urscript" and problem.robot.n != 6:
        with pytest.raises(po.errors.InputError, match="use --to jointstate"):
            po.export_files(problem, kind, posture=posture(problem, name))
        return
    found = po.export_files(problem, kind, posture=posture(problem, name))
    again = po.export_files(problem, kind, posture=posture(problem, name))
    assert found == again
    assert found.files
    for file, text in found.files.items():
        assert Path(file).name == file
        assert text.endswith("\n")
        if kind in PROGRAMS:
            assert text.isascii()
    if kind != "c":
        everything = "\n".join(found.files.values())
        named = kind not in ("urscript", "krl", "rapid")
        assert not named or all(joint in everything for joint in problem.robot.joint_names)


@pytest.mark.parametrize("kind", ["urdf", "dh", "krl"])
def test_effects_that_a_format_cannot_hold_are_noted(kind: str) -> None:
    problem = po.load_problem("insert_ur10_extended")
    found = po.export_files(problem, kind, posture=ARMS["insert_ur10_extended"])
    told = " ".join(found.notes)
    assert ("effects" in told) == (kind in ("urdf", "dh"))


@pytest.mark.parametrize("kind", PROGRAMS)
@pytest.mark.parametrize("name", conformance(["insert_ur10", "insert_scara"], ["insert_ur10"]))
def test_rounding_moves_the_tool_by_less_than_a_hundredth_of_its_scatter(kind: str, name: str) -> None:
    """Read back by a reader that shares no code with the writer; also at stretched and folded postures."""
    problem = po.load_problem(name)
    if kind == "urscript" and problem.robot.n != 6:
        pytest.skip("URScript moves six joints")
    rng, robot = np.random.default_rng(3), problem.robot
    for q in rng.uniform(robot.lower, robot.upper, (6, robot.n)):
        files = po.export_files(problem, kind, posture=q, approach=0.0).files
        (read,) = READERS[kind](files, [joint.type for joint in robot.joints])
        moved = np.linalg.norm(np.asarray(problem.arm.position(np.array(read))) - np.asarray(problem.arm.position(q)))
        spread = po.propagate(problem, q)
        assert moved < 0.01 * np.sqrt(np.linalg.eigvalsh(spread.covariance)[-1])
        assert moved < 0.01 * scatter(problem, q)


def test_on_the_command_line(tmp_path: Path) -> None:
    words = ("export", "--problem", "insert_ur10", "--posture", "10 deg, -100 deg, 90 deg, -80 deg, 80 deg, 5 deg")
    answer = invoke(*words, "--to", "krl", "--name", "go", "--wait", "2", "--approach", "0 mm", "--out", tmp_path)
    assert answer.exit_code == 0, answer.output
    assert names_in(tmp_path) == ["go.dat", "go.src"]
    (q,) = READERS["krl"]({name: (tmp_path / name).read_text() for name in names_in(tmp_path)}, ["revolute"] * 6)
    assert np.degrees(q) == pytest.approx([10, -100, 90, -80, 80, 5], abs=1e-9)
    document = json.loads(invoke(*words, "--to", "rapid", "--json").stdout)
    assert set(document) >= {"target", "files", "notes"}
    assert invoke(*words, "--to", "krl", "--name", "1x").exit_code == 2
    assert invoke(*words, "--to", "krl", "--name", "x" * 30).exit_code == 2
    listed = json.loads(invoke("list", "--json").stdout)["exports"]
    assert {row["kind"] for row in listed} == set(KINDS)


ENDS = {"urscript": (".script",), "krl": (".src", ".dat"), "rapid": (".mod",), "jointstate": (".yaml",)}


def read(folder: Path, kind: str, name: str) -> np.ndarray:
    files = {f"{name}{end}": (folder / f"{name}{end}").read_text() for end in ENDS[kind]}
    return np.array(READERS[kind](files, ["revolute"] * 6))


@pytest.mark.parametrize("kind", conformance(READERS, ["krl"]))
def test_a_plan_is_visited_posture_by_posture_with_waits(kind: str, tmp_path: Path) -> None:
    words = ("plan-measurements", "--problem", "insert_ur10", "--count", 4, "--candidates", 60, "--repeats", 2)
    answer = invoke(*words, "--program", kind, "--wait", 3, "--speed", 20, "--out", tmp_path / "plan", "--no-plots")
    assert answer.exit_code == 0, answer.output
    rows = list(csv.reader((tmp_path / "plan" / "plan.csv").read_text().splitlines()[1:]))
    planned = np.radians([[float(cell) for cell in row[:6]] for row in rows])
    assert len(planned) == 8
    found = read(tmp_path / "plan", kind, "measure")
    # The table has all digits of the commands: the program goes to the very same ones.
    assert np.abs(found - planned).max() < 1e-6
    text = "".join((tmp_path / "plan" / f"measure{end}").read_text() for end in ENDS[kind])
    assert "posture 4, round 2" in text
    waits = {"urscript": "sleep(3.0)", "krl": "WAIT SEC 3.0", "rapid": "WaitTime\\InPos, 3.0;"}
    assert kind not in waits or text.count(waits[kind]) == 8


@pytest.mark.parametrize("kind", conformance(READERS, ["urscript"]))
def test_joints_arrive_from_the_sides_that_the_targets_state(kind: str, tmp_path: Path) -> None:
    """The last move of the joint with play before each target goes the way that its column says."""
    path = tmp_path / "targets.csv"
    sides = (1, -1, 1, -1, 1)
    places = ("600, 200, 300", "650, 150, 250", "620, -50, 300", "600, 200, 300", "650, 150, 250")
    rows = [f"{place}, {side}" for place, side in zip(places, sides, strict=True)]
    path.write_text("\n".join(["x [mm], y [mm], z [mm], shoulder_pan.approach", *rows]) + "\n")
    words = ("compensate", path, "--problem", "insert_ur10_extended", "--no-plots")
    answer = invoke(*words, "--out", tmp_path / "out", "--program", kind, "--wait", 2, "--approach", "0 mm")
    assert answer.exit_code == 0, answer.output
    table = list(csv.reader((tmp_path / "out" / "compensated.csv").read_text().splitlines()[1:]))
    targets = np.radians([[float(cell) for cell in row[:6]] for row in table])
    stops = read(tmp_path / "out", kind, "compensated")
    at = [int(np.flatnonzero(np.abs(stops - q).max(axis=1) < 1e-6)[0]) for q in targets]
    pan = stops[:, 0]
    assert [int(np.sign(pan[k] - pan[k - 1])) for k in at] == list(sides)
    assert all(np.abs(pan[k] - pan[k - 1]) > np.radians(1.9) for k in at)
    text = "".join((tmp_path / "out" / f"compensated{end}").read_text() for end in ENDS[kind])
    assert "must arrive" not in text  # the program does
    waits = {"urscript": "sleep(2.0)", "krl": "WAIT SEC 2.0", "rapid": "WaitTime\\InPos, 2.0;"}
    assert kind not in waits or text.count(waits[kind]) == len(sides)  # none at the stops in front
    assert "comes to lines 4, 5, 6 from another side" in " ".join(answer.output.split())
    alone = invoke(*words, "--program", kind)
    assert alone.exit_code == 2
    assert "--program goes with --out" in alone.stderr
