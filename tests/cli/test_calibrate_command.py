"""``optimize-posture calibrate`` from end to end, on measurements of an arm with a hidden error."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import Result

from tests.helpers.command_line import invoke
from tests.helpers.planar_2r import position
from tests.helpers.planar_files import PLANAR, write

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


def parameters(document: dict[str, Any]) -> dict[str, dict[str, Any]]:
    return {entry["name"]: entry for entry in document["parameters"]}


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
