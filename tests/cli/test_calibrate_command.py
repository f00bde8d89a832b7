"""``optimize-posture calibrate`` from end to end, on measurements of an arm with a hidden error."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import Result

from posture_opt.report.text.screen import SCREEN
from tests.helpers.command_line import invoke
from tests.helpers.planar_2r import position
from tests.helpers.planar_files import PLANAR, write
from tests.helpers.real_arms import DATA, long_on_real_arms

JACOBI = DATA / "jacobi_ur5"
LONGER = 3e-3  # m: what the second link has more than the problem file says
NOISE = 2e-5  # m, of each measured coordinate
OUTLIER = 7  # the row that the instrument got wrong by 50 mm; its line is two more
PROBLEM = (
    PLANAR
    + """uncertainty:
  sigma: {joint1.theta: 1 mrad, joint2.theta: 1 mrad, joint2.a: 10 mm, tool.x: 0.01 mm, tool.y: 0.01 mm}
  measurement: {position: 0.02 mm}
"""
)


def run(*words: object) -> Result:
    return invoke("calibrate", *words)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("calibrate")
    rng = np.random.default_rng(3)
    q = rng.uniform(-2.5, 2.5, (80, 2))
    points = position(q, (1.0, 1.0 + LONGER)) + rng.normal(0, NOISE, (80, 2))
    points[OUTLIER, 0] += 0.05
    write(place / "data.csv", q[:60], points[:60])
    write(place / "other.csv", q[60:], points[60:])
    write(place / "few.csv", q[:3], points[:3])
    write(place / "alike.csv", q[[0] * 40], points[:1] + rng.normal(0, NOISE, (40, 2)))
    write(place / "metres.csv", q[:60], 1e-3 * points[:60])
    (place / "problem.yaml").write_text(PROBLEM, encoding="utf-8")
    return place


@pytest.fixture(scope="module")
def written(folder: Path) -> tuple[Path, Result]:
    out = folder / "out"
    words = ["--problem", folder / "problem.yaml", "--test", folder / "other.csv", "--out", out]
    return out, run(folder / "data.csv", *words, "--full")


def parameters(document: dict[str, Any]) -> dict[str, dict[str, Any]]:
    return {entry["name"]: entry for entry in document["parameters"]}


@pytest.mark.long
def test_the_longer_link_stands_in_the_document(written: tuple[Path, Result]) -> None:
    out, result = written
    assert result.exit_code == 0, result.stderr
    document = json.loads((out / "calibration.json").read_text(encoding="utf-8"))
    link = parameters(document)["joint2.a"]
    assert link["determined"]
    assert link["nominal"] == 1.0
    # The prior's 10 µm of the tool point, beside which 60 rows of 20 µm tell the length; beyond 4 σ: one in 10⁴.
    assert link["std"] == pytest.approx(1e-5, rel=0.1)
    assert abs(link["estimate"] - 1.0 - LONGER) < 4 * link["std"]
    assert document["residual_rms"]["nominal"] == pytest.approx(LONGER, rel=0.01)
    assert document["residual_rms"]["calibrated"] == pytest.approx(np.sqrt(2) * NOISE, rel=0.2)  # χ², 114 of freedom
    assert document["outliers"] == [OUTLIER]
    assert document["outlier_lines"] == [OUTLIER + 2]
    assert document["test"]["nominal"]["rms"] == pytest.approx(LONGER, rel=0.01)
    assert document["test"]["calibrated"]["rms"] < 1.5 * np.sqrt(2) * NOISE


def test_a_frame_that_is_stated_is_known_and_the_longer_link_is_found(folder: Path, tmp_path: Path) -> None:
    problem = tmp_path / "stated.yaml"
    problem.write_text(PROBLEM.replace(", joint2.a: 10 mm, tool.x: 0.01 mm, tool.y: 0.01 mm", ""), encoding="utf-8")
    result = run(folder / "data.csv", "--problem", problem, "--json")
    assert result.exit_code == 0, result.stderr
    document = json.loads(result.stdout)
    found = parameters(document)
    assert not [name for name in found if name.startswith(("base", "tool"))]
    link = found["joint2.a"]
    assert link["determined"]
    assert link["std"] < 5e-6  # 60 rows of 20 µm: 20 µm / √60 = 2.6 µm
    assert abs(link["estimate"] - 1.0 - LONGER) < 4 * link["std"]
    assert link["p_value"] < 1e-6 < 1e-3 < found["joint1.a"]["p_value"]  # the first link is as it was drawn


@long_on_real_arms
@pytest.mark.parametrize(
    ("data", "problem"),
    [
        ("jacobi_ur5/random.csv", "jacobi_ur5/problem.yaml"),
        ("jacobi_wam/grid.csv", "jacobi_wam/problem.yaml"),
        ("mukca_sockets/panda_4.csv", "mukca_sockets/problem_panda_4.yaml"),
        ("ipa_ur10/series_d.csv", "ipa_ur10/problem.yaml"),
    ],
)
def test_real_arms_fit_on_one_screen_too(data: str, problem: str) -> None:
    result = run(DATA / data, "--problem", DATA / problem)
    assert result.exit_code == 0, result.stderr
    assert len(result.stdout.splitlines()) <= SCREEN


def test_an_outlier_makes_no_prior_surer_than_it_is(written: tuple[Path, Result]) -> None:
    tool = parameters(json.loads((written[0] / "calibration.json").read_text(encoding="utf-8")))["tool.x"]
    # The data cannot tell it from the second link: its σ stays the one that was stated.
    assert tool["std"] == pytest.approx(1e-5, rel=0.02)


def test_json_is_the_document_alone_and_priors_can_be_turned_off(folder: Path) -> None:
    result = run(folder / "data.csv", "--problem", folder / "problem.yaml", "--no-priors", "--by", "block", "--json")
    assert result.exit_code == 0, result.stderr
    document = json.loads(result.stdout)
    assert document["cross_validation"] == "block"
    link = parameters(document)["joint2.a"]
    assert not link["determined"]
    assert link["std"] is None
    assert "joint2.a and tool.x move what was measured the same way" in document["undetermined"]
    assert document["residual_rms"]["calibrated"] < 0.02 * document["residual_rms"]["nominal"]
    assert "test" not in document


@pytest.mark.parametrize(
    ("file", "words", "code", "message"),
    [
        ("dta.csv", [], 2, "did you mean"),
        ("metres.csv", [], 2, "the numbers look like m: write x [m], y [m]"),
        ("few.csv", [], 4, "measure at least"),
        ("alike.csv", [], 4, "in 1 pose cannot determine"),
        ("data.csv", ["--test", "nothing.csv"], 2, "no such file: nothing.csv"),
        ("data.csv", ["--by", "place"], 2, "leave out by pose or block"),
        ("data.csv", ["--by", "row"], 2, "--by"),
        ("data.csv", ["--folds", "1"], 2, "--folds"),
        ("data.csv", ["--refit-frames"], 2, "goes with --test"),
    ],
)
def test_what_cannot_be_done_is_said_and_leaves_nothing(
    folder: Path, tmp_path: Path, file: str, words: list[str], code: int, message: str
) -> None:
    out = tmp_path / "out"
    result = run(folder / file, "--problem", folder / "problem.yaml", "--out", out, *words)
    assert result.exit_code == code
    assert message in result.stderr
    assert result.stdout == ""
    assert not list(tmp_path.iterdir())


def test_how_far_the_task_is_from_what_was_measured_is_told(tmp_path: Path) -> None:
    rng = np.random.default_rng(8)
    q = rng.uniform([-0.5, 1.0], [0.5, 2.0], (60, 2))
    write(tmp_path / "data.csv", q, position(q, (1.0, 1.0 + LONGER)) + rng.normal(0, NOISE, q.shape))
    task = "task: {kind: insert, direction: [0, -1, 0], position: [-1 m, 1 m, 0 m]}\n"  # joint1 90 deg, joint2 90 deg
    (tmp_path / "problem.yaml").write_text(PROBLEM + task, encoding="utf-8")
    result = run(tmp_path / "data.csv", "--problem", tmp_path / "problem.yaml", "--json")
    planned = json.loads(result.stdout)["posture"]["calibrated"]
    turned = np.array(list(planned["posture"].values()))
    beyond = max(*(q.min(axis=0) - turned), *(turned - q.max(axis=0)))
    assert planned["from_measured"]["joint"] == "joint1"
    assert planned["from_measured"]["beyond"] == pytest.approx(beyond)
    assert planned["from_measured"]["nearest"] == pytest.approx(np.abs(q - turned).max(axis=1).min())
    assert planned["spread"]["systematic"]["sigma_max"] <= planned["sigma_max"]


@long_on_real_arms
def test_a_real_arm_predicts_another_session() -> None:
    words = ["--problem", JACOBI / "problem.yaml", "--test", JACOBI / "random.csv"]
    result = run(JACOBI / "grid.csv", *words, "--json")
    assert result.exit_code == 0, result.stderr
    document = json.loads(result.stdout)
    # 0.155 mm was published, with a neural network; nothing is refitted here.
    assert document["test"]["calibrated"]["mean"] < 0.105e-3
    assert document["residual_rms"]["calibrated"] < 0.115e-3 < document["residual_rms"]["nominal"]
