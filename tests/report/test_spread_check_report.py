"""What the report says of the predicted spread, as a person reads it, and the figures beside it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from posture_opt.report.page.style import image
from posture_opt.statements import Statement
from posture_opt.validation.spread_check import SpreadCheck
from tests.helpers.command_line import invoke
from tests.helpers.planar_2r import position
from tests.helpers.scattering_arm import NOISE, SCATTER, STATED, arm, checked, measured

PROBLEM = """
robot:
  kind: dh
  joints: [{name: j1, type: revolute, a: 1 m}, {name: j2, type: revolute, a: 0.8 m}]
uncertainty:
  sigma: {j1.a: 1 mm, j2.a: 1 mm}
  scatter: {j1.theta: 1 mrad, j2.theta: 2 mrad}
  measurement: {position: 0.02 mm}
"""


def said(found: SpreadCheck) -> dict[str, Statement]:
    return {one.id.removeprefix("validation."): one for one in found.statements}


@pytest.fixture(scope="module")
def understated() -> SpreadCheck:
    return checked(arm(STATED), *measured(np.random.default_rng(1), 30, 4, times=2.0, length=2e-4))


def test_the_answer_is_the_coverage_of_what_is_stated(understated: SpreadCheck) -> None:
    answer = understated.statements[0]
    assert (answer.id, answer.about, answer.severity) == ("validation.coverage-understated", "nominal", "result")
    assert answer.values["share"].value == understated.coverage95["nominal"]
    assert answer.values["factor"].value == pytest.approx(2.0, abs=0.4)


def test_repeats_are_compared_with_what_the_file_states(understated: SpreadCheck) -> None:
    found = said(understated)
    assert found["scatter-understated"].values["source"] == "the scatter in the file"
    assert {"mostly-scatter", "postures-scatter-otherwise", "joints-from-repeats"} <= set(found)
    assert found["joints-predict-better"].values["model"] == "one σ for each joint"


def test_the_report_has_a_table_of_each_kind(understated: SpreadCheck) -> None:
    """The one snapshot: block titles, and lines that fit."""
    report = understated.report()
    assert max(map(len, report.splitlines())) <= 100
    blocks = ["Coverage of the predicted spread", "Repeats against the predicted scatter", "Scatter of each joint"]
    assert [block.title for block in understated.document().blocks] == blocks


def test_without_stated_uncertainty_and_repeats_that_is_said() -> None:
    found = checked(arm({}), *measured(np.random.default_rng(2), 40))
    assert found.statements[0].about == "calibrated"
    assert {"uncertainty-unstated", "scatter-inseparable", "joints-from-residuals"} <= set(said(found))


def test_repeats_that_scatter_less_than_what_is_left_are_no_scatter() -> None:
    rng = np.random.default_rng(3)
    q, points = measured(rng, 30, 3, times=0.02)
    found = said(checked(arm({}), q, points + rng.normal(0, 1e-3, (30, 2)).repeat(3, axis=0)))
    assert found["mostly-systematic"].values["share"].value > 0.75
    assert "scatter-unstated" in found


def test_long_tails_are_told_from_a_wrong_size() -> None:
    rng = np.random.default_rng(5)
    q = rng.uniform(-2.5, 2.5, (400, 2))
    wide = np.where(rng.random(400) < 0.1, 3.0, 0.4)[:, None]  # one row in ten scatters seven times as much
    points = position(q + wide * SCATTER * rng.normal(size=q.shape), (1.0, 0.8)) + NOISE * rng.normal(size=q.shape)
    found = checked(arm({"scatter": {"j1.theta": "1 mrad", "j2.theta": "2 mrad"}}), q, points)
    assert found.coverage["nominal"].held(0.5) > 0.7
    assert ("validation.more-concentrated", "nominal") in [(one.id, one.about) for one in found.statements]


def test_the_figures_are_drawn(understated: SpreadCheck) -> None:
    figures = understated.figures()
    assert set(figures) == {"truth_coverage", "truth_joints"}
    assert all(image(figure, "png")[:4] == b"\x89PNG" for figure in figures.values())
    axes = figures["truth_joints"].axes[0]
    assert [label.get_text() for label in axes.get_yticklabels()] == ["j1", "j2"]


@pytest.mark.long
def test_calibrate_writes_it_all(tmp_path: Path) -> None:
    q, points = measured(np.random.default_rng(4), 15, 3)
    (tmp_path / "problem.yaml").write_text(PROBLEM, encoding="utf-8")
    head = "j1 [rad],j2 [rad],x [m],y [m]"
    np.savetxt(tmp_path / "data.csv", np.column_stack([q, points]), delimiter=",", header=head, comments="")
    words = ["calibrate", str(tmp_path / "data.csv"), "--problem", str(tmp_path / "problem.yaml")]
    result = invoke(*words, "--full", "--out", str(tmp_path / "out"))
    assert result.exit_code == 0, result.stderr
    assert "Coverage of the predicted spread" in result.stdout
    document = json.loads((tmp_path / "out" / "calibration.json").read_text(encoding="utf-8"))
    assert document["coverage95"] == {
        name: found["share"] for name, found in document["spread_check"]["coverage"].items()
    }
    assert set(document["coverage95"]) == {"nominal", "calibrated"}
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "on the diagonal, the predicted spread is correct" in page
    assert (tmp_path / "out" / "truth_joints.png").stat().st_size > 5000
