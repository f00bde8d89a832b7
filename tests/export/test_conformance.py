"""Every format of an export: it is written for every kind of arm, names its joints, and repeats itself."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import posture_opt as po
from posture_opt.export import PROGRAM_FORMATS
from posture_opt.export.export_files import export_kinds, program_files
from posture_opt.export.robot_program import MotionRequest
from posture_opt.uncertainty.joint_digits import scatter
from tests.export.programs import READERS, answer_program
from tests.helpers.command_line import invoke
from tests.helpers.folders import names as names_in
from tests.helpers.variants import conformance

KINDS = list(export_kinds())
PROGRAMS = list(PROGRAM_FORMATS)
ARMS = {
    "insert_panda": [0.3, -0.4, 0.2, -1.9, 0.1, 1.7, 0.6],
    "insert_ur10": [0.5, -1.9, 1.4, -1.1, 1.5, 0.2],
    "insert_scara": None,
    "insert_planar_2r": [0.4, 0.9],
    "insert_urdf_arm": None,
    "insert_ur10_extended": [0.5, -1.9, 1.4, -1.1, 1.5, 0.2],
}


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


@pytest.mark.parametrize("kind", KINDS)
def test_effects_that_a_format_cannot_hold_are_noted(kind: str) -> None:
    problem = po.load_problem("insert_ur10_extended")
    found = po.export_files(problem, kind, posture=ARMS["insert_ur10_extended"])
    told = " ".join(found.notes)
    assert ("effects" in told) == (kind in ("urdf", "dh"))


@pytest.mark.parametrize("kind", PROGRAMS)
@pytest.mark.parametrize(
    "name", conformance(["insert_panda", "insert_ur10", "insert_scara"], ["insert_ur10", "insert_scara"])
)
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


@pytest.fixture(scope="module")
def plate() -> Any:
    """A plate with several holes under a UR10, planned."""
    return po.select_posture(po.load_problem("insert_ur10_plate"))


@pytest.mark.parametrize("kind", PROGRAMS)
def test_features_and_waits_are_in_the_program(kind: str, plate: Any) -> None:
    answer = plate
    found = program_files(answer_program(answer.problem, answer, MotionRequest(25.0, 1.5, approach=0.0)), kind, "")
    read = READERS[kind](found.files, ["revolute"] * 6)
    wanted = answer.postures[list(answer.order.order)]
    assert np.allclose(read, wanted, atol=1e-5)
    text = "\n".join(found.files.values())
    waits = {"urscript": "sleep(1.5)", "krl": "WAIT SEC 1.5", "rapid": "WaitTime\\InPos, 1.5;"}
    if kind in waits:
        assert text.count(waits[kind]) == len(wanted)
    for name in answer.names:
        assert name in text


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
