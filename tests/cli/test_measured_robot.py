"""``calibrate`` and ``diagnose`` of a robot without a problem file: one is made, and says the same when it is named."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import posture_opt as po
from posture_opt.problem.measured_robot import problem_of_measured_robot
from tests.helpers.command_line import invoke
from tests.helpers.real_arms import DATA, long_on_real_arms
from tests.helpers.shipped import PROBLEMS

LOADED = PROBLEMS / "ur10_measured.csv"


def document(result: Any) -> dict[str, Any]:
    assert result.exit_code == 0, result.stderr
    found = json.loads(result.stdout)
    found.pop("notes")
    return dict(found)


def counted(file: Path, stem: str) -> Path:
    """The measurements of the loaded arm with joints that are only counted."""
    head, *rows = LOADED.read_text(encoding="utf-8").splitlines()
    names = [f"{stem}{k + 1} [deg]" for k in range(6)]
    file.write_text("\n".join([", ".join([*names, *head.split(", ")[6:]]), *rows]) + "\n", encoding="utf-8")
    return file


def test_the_file_that_is_made_says_the_same_and_is_never_replaced(tmp_path: Path) -> None:
    data = counted(tmp_path / "data.csv", "q")
    words = ["calibrate", data, "--robot", "ur10", "--out", tmp_path / "out", "--no-plots", "--json", "--no-plan"]
    words += ["--folds", "2"]
    made = invoke(*words)
    again = invoke(
        "calibrate", data, "--problem", tmp_path / "out" / "problem.yaml", "--json", "--no-plan", "--folds", "2"
    )
    assert document(made) == document(again)
    problem = po.load_problem(tmp_path / "out" / "problem.yaml")
    assert problem.robot.base_free
    assert problem.robot.tool_free
    assert problem.robot.joint_names[0] == "q1"
    assert problem.robot.joints[0].mass == 7.1
    # 110 postures, none of them twice: nothing tells the instrument from the arm.
    assert problem.measurement is None
    assert document(made)["residual_rms"]["calibrated"] < 0.25e-3 < document(made)["residual_rms"]["nominal"]
    (tmp_path / "out" / "problem.yaml").write_text("name: mine\n", encoding="utf-8")
    result = invoke(*words)
    assert result.exit_code == 2
    assert "problem.yaml exists and says something else" in result.stderr
    assert (tmp_path / "out" / "problem.yaml").read_text(encoding="utf-8") == "name: mine\n"


@pytest.mark.long
def test_without_a_folder_it_stands_in_the_current_one_and_is_never_replaced(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    file = tmp_path / "ur10_measured_problem.yaml"
    invoke("calibrate", LOADED, "--robot", "ur10", "--json", "--no-plan")
    assert not file.exists()
    first = invoke("calibrate", LOADED, "--robot", "ur10").stdout
    assert "ur10_measured_problem.yaml is the problem file of this call" in first
    assert len(first.splitlines()) <= 45
    edited = file.read_text(encoding="utf-8") + "task: {kind: insert, direction: [0, 0, -1]}\n"
    file.write_text(edited, encoding="utf-8")
    assert "exists and was left as it is" in invoke("calibrate", LOADED, "--robot", "ur10", "--no-plan").stdout
    assert file.read_text(encoding="utf-8") == edited
    assert po.load_problem(file).task is not None


@pytest.mark.long
def test_diagnose_does_the_same(tmp_path: Path) -> None:
    result = invoke("diagnose", LOADED, "--robot", "ur10", "--out", tmp_path / "out", "--no-plots", "--json")
    found = document(result)
    assert ("joint_compliance", "elbow") in [(e["kind"], e["target"]) for e in found["effects"]]
    assert {file.name for file in (tmp_path / "out").iterdir()} >= {"problem.yaml", "extended.yaml", "diagnosis.json"}


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        ("A [deg], B [deg], C [deg], D [deg], E [deg], F [deg]", "shoulder_pan, shoulder_lift, elbow"),
        ("q1 [deg], q2 [deg], q3 [deg], q4 [deg], q5 [deg]", 'data: {columns: {shoulder_pan: "q1"'),
    ],
)
def test_columns_of_no_joint_are_named(tmp_path: Path, columns: str, message: str) -> None:
    cells = ", ".join("1" for _ in range(columns.count(",") + 4))
    file = tmp_path / "data.csv"
    file.write_text(f"{columns}, x [mm], y [mm], z [mm]\n{cells}\n", encoding="utf-8")
    result = invoke("calibrate", file, "--robot", "ur10", "--out", tmp_path / "out")
    assert result.exit_code in (2, 4)
    assert message in result.stderr
    assert not (tmp_path / "out").exists()


@pytest.mark.long
def test_a_foreign_file_is_read_by_its_heads_on_the_command_line(tmp_path: Path) -> None:
    """What a tracker in Germany saved: heads of its own, decimal commas, a line before the header, Latin-1."""
    head, *rows = LOADED.read_text(encoding="utf-8").splitlines()
    names = [name.split(" ")[0] for name in head.split(", ")[:6]]
    heads = [*(f"Achse {k + 1} [°]" for k in range(6)), "Pos X [mm]", "Pos Y [mm]", "Pos Z [mm]", *head.split(", ")[9:]]
    lines = ["Prüfer;Müller", ";".join([*heads, "Güte"])]
    lines += [";".join([*(cell.strip().replace(".", ",") for cell in row.split(",")), "gut"]) for row in rows]
    file = tmp_path / "messung.csv"
    file.write_bytes("\r\n".join(lines).encode("latin-1"))
    words = [f"{name}=Achse {k + 1} [°]" for k, name in enumerate(names)] + [f"{a}=Pos {a.upper()}" for a in "xyz"]
    options = [word for pair in words for word in ("--column", pair)]
    plain = invoke("calibrate", LOADED, "--robot", "ur10", "--json")
    found = invoke("calibrate", file, "--robot", "ur10", *options, "--out", tmp_path / "out", "--no-plots", "--json")
    assert document(found)["residual_rms"] == pytest.approx(document(plain)["residual_rms"], rel=1e-9)
    again = invoke("calibrate", file, "--problem", tmp_path / "out" / "problem.yaml", "--json")
    assert document(again) == document(found)
    refused = invoke("calibrate", file, "--robot", "ur10")
    assert refused.exit_code == 2
    (told,) = refused.stderr.splitlines()
    assert "missing x [mm], y [mm], z [mm]" in told  # its joints are counted, and take these names
    assert 'data: {columns: {x: "Pos X", y: "Pos Y", z: "Pos Z"}}' in told


@long_on_real_arms
@pytest.mark.parametrize(
    ("data", "robot", "problem"),
    [
        ("jacobi_ur5/grid.csv", "ur5", "jacobi_ur5/problem.yaml"),
        ("mukca_sockets/panda_3.csv", "panda", "mukca_sockets/problem_panda.yaml"),
    ],
)
def test_real_arms_are_calibrated_as_well_without_a_file(data: str, robot: str, problem: str) -> None:
    made = document(invoke("calibrate", DATA / data, "--robot", robot, "--json", "--no-plan"))
    stated = document(invoke("calibrate", DATA / data, "--problem", DATA / problem, "--json", "--no-plan"))
    for name in ("nominal", "calibrated"):
        assert made["residual_rms"][name] == pytest.approx(stated["residual_rms"][name], rel=0.02)


def test_payload_and_frames_are_kept_whatever_the_columns_are_called() -> None:
    names = [f"q{i}" for i in range(1, 7)]
    rng = np.random.default_rng(0)
    table = pd.DataFrame(rng.uniform(-1, 1, (12, 6)), columns=[f"{name} [rad]" for name in names])
    table[["x [m]", "y [m]", "z [m]"]] = rng.uniform(-1, 1, (12, 3))
    section: dict[str, Any] = {
        "kind": "preset",
        "name": "ur10",
        "payload": "8 kg",
        "base": {"xyz": ["1 m", "0 m", "0 m"]},
    }
    made = problem_of_measured_robot(section, table)
    assert made.robot.joint_names == tuple(names)
    assert made.robot.payload == 8.0
    assert not made.robot.base_free
