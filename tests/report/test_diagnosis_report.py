"""What the report of a diagnosis says of causes that stand together, and of what is left by noise."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from posture_opt.report.measured_parts.causes_table import causes_table
from posture_opt.report.measured_parts.diagnosis_errors import _beside, errors_block
from posture_opt.report.measured_parts.diagnosis_open import _pattern_words, split_csv
from posture_opt.report.measured_parts.diagnosis_sizes import NoiseFloor, largest_scatter, like_noise, noise_floor

import posture_opt as po
from posture_opt.calibration.estimation.fit import Fit
from posture_opt.report.measured_parts.error_table import rows_words
from posture_opt.report.results.diagnosis_report import _rest, diagnosis_report
from posture_opt.report.text.blocks import Table
from posture_opt.report.text.text import render
from posture_opt.statements.notation import percent
from tests.helpers.planar_2r import position
from tests.helpers.planar_files import PLANAR, write

NOISE = 2e-5  # m, of each measured coordinate
SCATTER = 2e-4  # rad, of joint2 from repeat to repeat
PROBLEM = PLANAR + "uncertainty: {measurement: {position: 0.02 mm}}\n"


@pytest.fixture(scope="module")
def noisy(tmp_path_factory: pytest.TempPathFactory) -> po.Diagnosis:
    """The diagnosis of an arm with two wrong links and a joint that scatters."""
    return diagnosed(tmp_path_factory.mktemp("noisy"), visits=4)


def diagnosed(folder: Path, visits: int) -> po.Diagnosis:
    """Of 120 rows, each posture measured so often."""
    rng = np.random.default_rng(3)
    q = rng.permutation(np.tile(rng.uniform(-2.5, 2.5, (120 // visits, 2)), (visits, 1)))
    moved = q + np.outer(rng.normal(0, SCATTER, len(q)), [0, 1])
    write(folder / "data.csv", q, position(moved, (1.0007, 0.9991)) + rng.normal(0, NOISE, (120, 2)))
    (folder / "problem.yaml").write_text(PROBLEM, encoding="utf-8")
    problem = po.load_problem(folder / "problem.yaml")
    data = po.read_measurements(folder / "data.csv", problem)
    return po.diagnose(problem, data)


def text_of(found: po.Diagnosis) -> str:
    return " ".join(render(diagnosis_report(found)).split())


def test_what_each_geometric_cause_brings_is_said(noisy: po.Diagnosis) -> None:
    text = text_of(noisy)
    assert {f.kind for f in noisy.effects} == {"link_length", "joint_noise"}
    gains = [f.gain for f in noisy.effects if f.kind == "link_length"]
    assert [text.count(f"Gain reduces the RMS by {percent(gain)}, everything else fitted again") for gain in gains] == [
        1,
        1,
    ]


def test_the_scatter_of_a_named_joint_is_that_of_repeats(noisy: po.Diagnosis) -> None:
    floor = noise_floor(noisy)
    # The second joint stands 1 m from the tool point in every posture; 90 differences between repeats tell it to 7 %.
    assert floor.repeated
    assert floor.rms == pytest.approx(np.hypot(np.sqrt(2) * NOISE, SCATTER), rel=0.2)
    text = text_of(noisy)
    assert "joint2 scatters from repeat to repeat by 0." in text.partition("On rows held out")[0]
    assert "which the file does not state" in text
    tables = [item for item in errors_block(noisy).items if isinstance(item, Table)]
    assert "measurement noise" in [row[0] for table in tables for row in table.rows]
    assert f"of arm and instrument, accounts for {1e3 * floor.rms:.3f} mm" in text
    assert "Measurement noise is the scatter of repeated postures" in text
    assert "so nothing more can be gained" in text


def test_without_repeats_nothing_is_called_noise_and_repeats_are_asked_for(tmp_path: Path) -> None:
    found = diagnosed(tmp_path, visits=1)
    assert found.verdict == "unexplained"
    assert not [f for f in found.effects if f.noise is not None]
    answer = found.to_json()["unexplained"]
    assert answer["place"] == ["joint2"]
    assert answer["p_value"] < 0.001
    (asked,) = answer["repeat"]
    assert (asked["target"], asked["times"], len(asked["lines"])) == ("joint2", 5, 5)
    assert asked["lines"] == [int(line) for line in found.repeat_plans[0].rows.line]
    text = text_of(found)
    asked_for = "repeat 5 postures 5 times each to tell scatter from a systematic error."
    assert f"Errors are larger where joint2 moves the tool more: {asked_for}" in text
    assert f"measure the postures of lines {', '.join(map(str, asked['lines']))} 5 times each" in text
    assert "noise alone" not in text
    assert "measurement noise" not in text
    assert "the instrument as stated (0.02 mm in each of 2 coordinates) accounts for 0.0283 mm" in text


@pytest.mark.parametrize(
    ("low", "words"),
    [
        (
            0.0520,
            "; fitting 23 parameters to 240 numbers raises that to 0.0550 mm: about as large as the residual error",
        ),
        (0.0560, "; fitting 23 parameters to 240 numbers raises that to 0.0550 mm; the scatter of the arm itself adds"),
        (0.0510, ": about as large as the residual error, so nothing more can be gained."),
    ],
)
def test_what_fitting_costs_is_no_scatter_of_the_arm(low: float, words: str) -> None:
    # 80 rows of three coordinates of 0.03 mm in 5 rounds: 0.05196 mm √(1 + 23/192) = 0.0550 mm.
    residuals = SimpleNamespace(data=range(80), axes=range(3))
    model = SimpleNamespace(count=23, residuals=residuals)
    left = SimpleNamespace(interval=(1e-3 * low, 6.4e-5))
    request, groups = SimpleNamespace(folds=5), np.arange(80)
    found: Any = SimpleNamespace(
        errors={"extended": left}, model=model, verdict="effects_found", request=request, groups=groups
    )
    assert _beside(found, NoiseFloor(3e-5 * np.sqrt(3), repeated=False)).startswith(words)


@pytest.mark.parametrize(("kept", "notes"), [([True, True], 0), ([True, False], 1)])
def test_no_outlier_is_to_be_looked_at_where_none_is_listed(kept: list[bool], notes: int) -> None:
    minimum: Any = SimpleNamespace(converged=True, steps=1)
    data: Any = SimpleNamespace()
    found = Fit(data, np.zeros(1), np.eye(1), np.eye(1), np.array(kept), np.zeros(2), 1.0, minimum, settled=False)
    assert len(found.notes) == notes


def test_what_is_to_be_repeated_is_filled_in_and_tells(tmp_path: Path) -> None:
    """The table of planned repeats, measured by the same arm and put below the data, has the joint named."""
    found = diagnosed(tmp_path, visits=1)
    planned = split_csv(found).splitlines()
    assert len(planned) == 1 + 25
    rng = np.random.default_rng(5)
    q = np.radians([[float(cell) for cell in line.split(",")[:2]] for line in planned[1:]])
    moved = q + np.outer(rng.normal(0, SCATTER, len(q)), [0, 1])
    points = 1e3 * (position(moved, (1.0007, 0.9991)) + rng.normal(0, NOISE, (25, 2)))
    filled = [f"{line.rstrip(' ,')}, {x:.4f}, {y:.4f}" for line, (x, y) in zip(planned[1:], points, strict=True)]
    problem, (head, *rows) = found.problem, (tmp_path / "data.csv").read_text(encoding="utf-8").splitlines()
    assert [cell.strip() for cell in head.split(",")] == [cell.strip() for cell in planned[0].split(",")]
    (tmp_path / "more.csv").write_text("\n".join([head, *rows, *filled]) + "\n", encoding="utf-8")
    again = po.diagnose(problem, po.read_measurements(tmp_path / "more.csv", problem))
    assert again.verdict == "effects_found"
    assert [f.target for f in again.effects if f.kind == "joint_noise"] == ["joint2"]


def test_postures_that_were_measured_again_are_counted_whatever_their_rows_are_called(noisy: po.Diagnosis) -> None:
    # 30 postures, four times each in random order; rows without a pose have one of their own.
    data = noisy.request.data
    assert rows_words(data, noisy.problem.robot) == "120 rows in 30 postures; 30 of them measured more than once"
    once = replace(data, q=np.random.default_rng(0).uniform(-2, 2, data.q.shape), pose=np.arange(120))
    assert rows_words(once, noisy.problem.robot) == "120 rows in 120 postures"


def test_a_joint_that_scatters_moves_the_tool_by_its_lever(noisy: po.Diagnosis) -> None:
    (finding,) = [f for f in noisy.effects if f.noise is not None]
    # The tool point is 0.9991 m from the second joint in all postures.
    sigma = finding.estimate["sigma"][0]
    assert largest_scatter(noisy, finding.noise) == pytest.approx(0.9991 * sigma, rel=1e-3)
    (row,) = [row for row in causes_table(noisy).rows if "joint noise" in row[0]]
    assert row[2] == f"σ {1e3 * 0.9991 * sigma:.3f} mm"


@pytest.mark.parametrize(("low", "alike"), [(2.8e-5, True), (4.0e-5, False)])
def test_a_rest_as_small_as_the_instrument_is_said_to_be_so(low: float, alike: bool, noisy: po.Diagnosis) -> None:
    errors = {**noisy.errors, "extended": replace(noisy.errors["extended"], rms=2.5e-5, interval=(low, 6e-5))}
    quiet = SimpleNamespace(**{n: getattr(noisy, n) for n in ("request", "groups", "model", "problem")})
    quiet.errors, quiet.contrasts = errors, []
    assert like_noise(quiet) is alike  # 0.02 mm in two coordinates: 0.0283 mm, and some more for what is fitted
    assert ("about as large as noise" in _rest(quiet)) is alike
    assert ("about as large as the instrument as stated (0.0283 mm), but not random" in _pattern_words(quiet)) is alike


def test_what_repeats_scatter_by_beyond_the_instrument_is_told() -> None:
    assert NoiseFloor(1.1e-4, True, stated=5.2e-5).clause == (
        "the scatter of repeated postures, of arm and instrument, accounts for 0.110 mm, and the instrument as stated "
        "for 0.0520 mm of it"
    )
    assert "as stated" not in NoiseFloor(5.5e-5, True, stated=5.2e-5).clause
