"""Goals measured in several postures: what each model would have chosen, and what the data say was missed there."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.helpers.command_line import invoke
from tests.helpers.planar_2r import position, postures_at
from tests.helpers.planar_files import PLANAR

NOISE, SIGMA = 2e-5, (4e-4, 1e-4)  # m; rad, what the file states of joint1 and joint2
LONGER, CYCLES, WAVE = 2e-4, 7.0, 4e-4  # m of link 2; the error of joint1, rad
PROBLEM = (
    PLANAR
    + """uncertainty:
  measurement: {position: 0.02 mm}
  sigma: {joint1.theta: 0.4 mrad, joint2.theta: 0.1 mrad}
task: {kind: insert, direction: [0, -1, 0], position: [0.9 m, 0.4 m, 0 m], clearance: 0.5 mm}
"""
)


def tool(q: np.ndarray, wave: float = 0.0, longer: float = 0.0) -> np.ndarray:
    """(N, 2) tool point of an arm whose first joint has a cyclic error, and whose second link is longer."""
    wrong = np.column_stack([wave * np.sin(CYCLES * q[:, 0]), np.zeros(len(q))])
    return position(q + wrong, (1.0, 1.0 + longer))


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, np.ndarray, np.ndarray]:
    """The folder with the files, the postures (G, 2, 2), and where they were measured (G, 2, 2)."""
    rng = np.random.default_rng(21)
    radius, turn = rng.uniform(0.5, 1.8, 70), rng.uniform(-1.5, 1.5, 70)
    q = np.stack(list(postures_at(np.column_stack([radius * np.cos(turn), radius * np.sin(turn)]))), axis=1)
    points = tool(q.reshape(-1, 2), WAVE, LONGER) + rng.normal(0, NOISE, (140, 2))
    rows = np.column_stack([np.repeat(np.arange(70), 2), np.degrees(q.reshape(-1, 2)), 1e3 * points])
    rows = rows[rng.permutation(140)]
    folder = tmp_path_factory.mktemp("goals")
    head = "goal, joint1 [deg], joint2 [deg], x [mm], y [mm]"
    np.savetxt(folder / "data.csv", rows, fmt=["%d", *["%.9f"] * 4], delimiter=",", header=head, comments="")
    (folder / "problem.yaml").write_text(PROBLEM, encoding="utf-8")
    return folder, q, points.reshape(70, 2, 2)


@pytest.fixture(scope="module")
def told(session: tuple[Path, np.ndarray, np.ndarray]) -> tuple[dict[str, Any], str]:
    """diagnosis.json and the text of the report."""
    folder, out = session[0], session[0] / "out"
    words = [folder / "data.csv", "--problem", folder / "problem.yaml", "--out", out, "--no-plots", "--full"]
    result = invoke("diagnose", *words)
    assert result.exit_code == 0, result.stderr
    return json.loads((out / "diagnosis.json").read_text(encoding="utf-8")), result.stdout


def test_the_choice_of_the_arm_before_calibration_is_counted_by_hand(
    session: tuple[Path, np.ndarray, np.ndarray], told: tuple[dict[str, Any], str]
) -> None:
    _, q, measured = session
    goals = told[0]["posture"]["goals"]
    missed = np.abs(measured - tool(q.reshape(-1, 2)).reshape(70, 2, 2))[..., 0]  # x: across the direction
    one, two = q[..., 0], q.sum(axis=-1)
    lever = np.stack([np.sin(one) + np.sin(two), np.sin(two)])
    scatter = np.hypot(SIGMA[0] * lever[0], SIGMA[1] * lever[1])
    chosen = scatter.argmin(axis=1)
    there, elsewhere = missed[range(70), chosen], missed[range(70), 1 - chosen]
    assert goals["goals"] == 70
    assert goals["within"] == "across"
    found = goals["sent"]["nominal"]
    # The same joints and points, written with 9 decimals of mm and deg; moments of higher order move the scatter
    # by 1e-6 of itself, which could turn a choice only where both are alike.
    assert found["missed"]["median"] == pytest.approx(np.median(there), rel=1e-4)
    assert found["missed"]["p95"] == pytest.approx(np.quantile(there, 0.95), rel=1e-4)
    assert found["missed_elsewhere"]["median"] == pytest.approx(np.median(elsewhere), rel=1e-4)
    assert found["better"] == pytest.approx(np.mean(there <= elsewhere))
    assert found["success"] == pytest.approx(np.mean(there <= 0.5e-3))
    assert 0 < found["success"] < goals["sent"]["extended"]["success"] == 1.0


def test_sent_by_the_extended_arm_only_the_noise_is_missed(told: tuple[dict[str, Any], str]) -> None:
    goals = told[0]["posture"]["goals"]["sent"]
    # The median of a normal deviate without its sign is 0.674 σ; 70 of them scatter by 11 %, and the fit adds 5 %.
    assert goals["extended"]["missed"]["median"] == pytest.approx(0.674 * NOISE, rel=0.4)
    assert goals["extended"]["missed"]["p95"] == pytest.approx(1.96 * NOISE, rel=0.4)
    assert goals["nominal"]["missed"]["median"] > 5 * goals["extended"]["missed"]["median"]
    assert goals["calibrated"]["missed"]["median"] > 3 * goals["extended"]["missed"]["median"]


def test_the_extended_arm_knows_where_the_uncorrected_one_misses_least(
    session: tuple[Path, np.ndarray, np.ndarray], told: tuple[dict[str, Any], str]
) -> None:
    _, q, measured = session
    flat = q.reshape(-1, 2)
    truth = np.abs(tool(flat, WAVE, LONGER) - tool(flat)).reshape(70, 2, 2)[..., 0]
    missed = np.abs(measured - tool(flat).reshape(70, 2, 2))[..., 0]
    wise = missed[range(70), truth.argmin(axis=1)]  # chosen by somebody who knows the arm
    goals = told[0]["posture"]["goals"]["uncorrected"]
    # The fit knows the arm to some µm: a few choices between postures that are alike may turn, with little loss.
    assert goals["extended"]["missed"]["median"] == pytest.approx(np.median(wise), rel=0.1)
    assert goals["extended"]["better"] == pytest.approx(np.mean(wise <= missed.min(axis=1)), abs=0.08)
    assert goals["extended"]["better"] > 0.85
    assert goals["any_posture"]["median"] == pytest.approx(np.median(missed.mean(axis=1)), rel=1e-4)
