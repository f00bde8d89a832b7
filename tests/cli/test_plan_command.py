"""``optimize-posture plan-measurements`` from end to end."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result

from tests.helpers.command_line import invoke
from tests.helpers.folders import names as names_in
from tests.helpers.simulated_arm import SimulatedArm

TABLE = (("j1", "revolute", 0.0, 0.0, 1.0, 0.0), ("j2", "revolute", 0.0, 0.0, 0.8, 0.0))
PROBLEM = """
name: Planar arm
robot:
  kind: dh
  joints:
    - {name: j1, type: revolute, a: 1 m, limits: [-170 deg, 170 deg]}
    - {name: j2, type: revolute, a: 0.8 m, limits: [-170 deg, 170 deg]}
uncertainty:
  sigma: {j1.theta: 1 mrad, j2.theta: 1 mrad, j2.a: 1 mm}
  measurement: {position: 0.05 mm}
task: {kind: insert, direction: [0, -1, 0], position: [0.9 m, 0.4 m, 0 m]}
"""
STILL = PROBLEM.replace("a: 1 m", "a: 0 m").replace("a: 0.8 m", "a: 0 m").partition("uncertainty")[0]


def run(*words: object) -> Result:
    return invoke("plan-measurements", *words)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("plan")
    rng = np.random.default_rng(0)
    q = rng.uniform(-2.5, 2.5, (30, 2))
    points = SimulatedArm(TABLE, {"j2.a": 1e-3}).points(q)[:, :2] + rng.normal(0, 5e-5, (30, 2))
    rows = np.column_stack([np.degrees(q), 1e3 * points])
    np.savetxt(place / "data.csv", rows, delimiter=", ", header="j1 [deg], j2 [deg], x [mm], y [mm]", comments="")
    (place / "problem.yaml").write_text(PROBLEM, encoding="utf-8")
    (place / "still.yaml").write_text(STILL, encoding="utf-8")
    return place


@pytest.fixture(scope="module")
def written(folder: Path) -> tuple[Path, Result]:
    words = ["--problem", folder / "problem.yaml", "--given", folder / "data.csv", "--count", 8, "--for", "task"]
    return folder / "out", run(*words, "--out", folder / "out", "--no-plots")


def test_the_files_hold_the_plan(written: tuple[Path, Result]) -> None:
    out, result = written
    assert result.exit_code == 0, result.stderr
    assert set(names_in(out)) == {"plan.csv", "plan_points.csv", "plan.json", "report.txt", "report.html"}
    document = json.loads((out / "plan.json").read_text(encoding="utf-8"))
    assert document["purpose"] == "task"
    assert document["count"] == 8
    assert document["given"] == 30
    head, *lines = (out / "plan.csv").read_text(encoding="utf-8").splitlines()
    assert head == "j1 [deg], j2 [deg]"
    planned = np.radians([[float(cell) for cell in line.split(",")] for line in lines])
    np.testing.assert_allclose(planned, [list(p["posture"].values()) for p in document["postures"]], atol=1e-12)
    points = np.loadtxt(out / "plan_points.csv", delimiter=",", skiprows=1)
    np.testing.assert_allclose(points[:, 1:], 1e3 * SimulatedArm(TABLE).points(planned), atol=0.006)
    std = document["task"]["std"]
    assert 0 < std["after"] < std["random"] < std["before"]
    assert {"O1", "O2", "O3", "O4", "O5"} == set(document["observability"]["after"])


def test_a_preset_needs_no_file_and_keeps_above_its_table() -> None:
    result = run(
        "--robot",
        "ur5e",
        "--count",
        12,
        "--link-height",
        "100 mm",
        "--max",
        "1 m, 0 m, 1 m",
        "--json",
        "--candidates",
        300,
    )
    assert result.exit_code == 0, result.stderr
    document = json.loads(result.stdout)
    assert min(p["tool"][2] for p in document["postures"]) >= 0.1 - 1e-9
    assert max(p["tool"][1] for p in document["postures"]) <= 0
    assert document["task"] is None


@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        (["--count", "0"], 2, "--count"),
        (["--count", "2"], 2, "--count: 2 postures are too few for"),
        (["--for", "speed"], 2, "--for"),
        (["--given", "dta.csv"], 2, "no such file"),
        (["--link-height", "5"], 2, "--link-height"),
        (["--min", "1 m, 0 m"], 2, "--min: a corner has three coordinates"),
        (["--min", "1 m, 0 m, 0 m", "--max", "0 m, 1 m, 1 m"], 2, "the box is empty"),
        (["--min", "5 m, 0 m, 0 m"], 3, "with the tool point in the box"),
        (["--problem", "still.yaml"], 4, "no parameter can be determined"),
        (["--problem", "still.yaml", "--for", "task"], 2, "states no task to plan for"),
    ],
)
def test_what_cannot_be_done_is_said_and_leaves_nothing(
    folder: Path, tmp_path: Path, words: list[str], code: int, message: str
) -> None:
    words = [str(folder / word) if word.endswith((".yaml", ".csv")) else word for word in words]
    given = [] if "--problem" in words else ["--problem", folder / "problem.yaml"]
    result = run(*given, "--out", tmp_path / "out", *words)
    assert result.exit_code == code, result.stderr
    assert message in result.stderr
    assert result.stdout == ""
    assert not list(tmp_path.iterdir())
