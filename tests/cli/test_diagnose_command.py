"""``optimize-posture diagnose`` from end to end, on measurements of an arm with a hidden effect."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import Result

import posture_opt as po
from tests.helpers.command_line import invoke
from tests.helpers.planar_2r import position
from tests.helpers.planar_files import PLANAR, write

NOISE = 2e-5  # m, of each measured coordinate
CYCLES, SINE, COSINE = 12.0, 1.2e-4, 0.9e-4  # of joint1: rad
DRIFT = 3e-4  # m, in x, from the first row to the last
PROBLEM = PLANAR + "uncertainty: {measurement: {position: 0.02 mm}}\n"


def run(*words: object) -> Result:
    return invoke("diagnose", *words)


def wavy(q: np.ndarray) -> np.ndarray:
    """The joints that an arm reaches whose first gear has a cyclic error."""
    wave = SINE * np.sin(CYCLES * q[:, 0]) + COSINE * np.cos(CYCLES * q[:, 0])
    return q + np.stack([wave, np.zeros(len(q))], axis=1)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("diagnose")
    rng = np.random.default_rng(5)
    q = rng.uniform(-2.5, 2.5, (140, 2))
    noise = rng.normal(0, NOISE, (140, 2))
    points = position(wavy(q)) + noise
    write(place / "data.csv", q[:90], points[:90])
    write(place / "other.csv", q[90:], points[90:])
    write(place / "repaired.csv", q[90:], position(q[90:]) + noise[90:])  # the gear has been changed
    write(place / "few.csv", q[:2], points[:2])
    time = np.linspace(0.0, 3600.0, 90)
    creep = np.stack([DRIFT * time / 3600, np.zeros(90)], axis=1)
    write(place / "creeping.csv", q[:90], position(q[:90]) + noise[:90] + creep, time=("s", time))
    write(place / "later.csv", q[90:], position(q[90:]) + noise[90:], time=("s", time[:50]))
    (place / "problem.yaml").write_text(PROBLEM, encoding="utf-8")
    return place


@pytest.fixture(scope="module")
def written(folder: Path) -> tuple[Path, Result]:
    out = folder / "out"
    words = ["--problem", folder / "problem.yaml", "--test", folder / "other.csv", "--out", out, "--no-plots"]
    return out, run(folder / "data.csv", *words)


@pytest.fixture(scope="module")
def document(written: tuple[Path, Result]) -> dict[str, Any]:
    assert written[1].exit_code == 0, written[1].stderr
    loaded: dict[str, Any] = json.loads((written[0] / "diagnosis.json").read_text(encoding="utf-8"))
    return loaded


def test_the_cyclic_error_is_named_with_its_size(document: dict[str, Any]) -> None:
    assert document["verdict"] == "effects_found"
    first = document["effects"][0]
    assert (first["kind"], first["target"]) == ("cyclic_error", "joint1")
    assert first["p_value"] < 1e-6
    size = {name: (entry["value"], entry["std"]) for name, entry in first["estimate"].items()}
    cycles, error = size["cycles"]
    # σ √(2/N) / (A · rms of the lever · spread of q): 90 rows of 20 µm, 0.15 mrad at 1.4 m, 1.4 rad.
    assert error == pytest.approx(NOISE * np.sqrt(2 / 90) / (1.5e-4 * 1.4 * 1.4), rel=0.5)
    assert abs(cycles - CYCLES) < 4 * error
    turn = CYCLES * size["centre"][0]  # sine and cosine are those about the middle of the data
    a, b = SINE * np.cos(turn) - COSINE * np.sin(turn), SINE * np.sin(turn) + COSINE * np.cos(turn)
    for name, true in (("sin", a), ("cos", b)):
        value, std = size[name]
        assert abs(value - true) < 4 * std  # one in 10⁴
        assert std < 8e-6  # 90 rows of 20 µm at 1 m; a phase at zero would lean on the cycles


def test_errors_are_those_of_the_noise_here_and_on_the_test_file(document: dict[str, Any]) -> None:
    floor = np.sqrt(2) * NOISE
    wave = np.hypot(SINE, COSINE) / np.sqrt(2)  # rad, at a mean square lever of 2 m² that varies
    assert document["residual_rms"]["calibrated"] == pytest.approx(np.sqrt(2) * wave, rel=0.3)
    assert document["residual_rms"]["extended"] == pytest.approx(floor, rel=0.2)  # χ² of 174 freedoms, and the fit
    test = document["test"]
    for name in ("nominal", "calibrated", "extended"):
        assert {"rms", "mean", "max"} <= set(test[name])
    assert test["nominal"]["rms"] == pytest.approx(np.sqrt(2) * wave, rel=0.3)
    assert test["extended"]["rms"] == pytest.approx(floor, rel=0.3)  # 100 numbers
    assert not test["frames_refitted"]
    gain = document["effects"][0]["test_gain"]
    assert gain["interval95"][0] > 0.5
    assert gain["value"] == pytest.approx(1 - test["extended"]["rms"] / test["calibrated"]["rms"], abs=0.02)


def test_a_gain_that_does_not_hold_elsewhere_is_none(folder: Path) -> None:
    words = ["--problem", folder / "problem.yaml", "--test", folder / "repaired.csv"]
    result = run(folder / "data.csv", *words, "--json")
    assert result.exit_code == 0, result.stderr
    found = json.loads(result.stdout)
    assert found["effects"][0]["test_gain"]["value"] < 0
    assert found["test"]["improves"] is False
    assert found["test"]["calibrated"]["rms"] < found["test"]["extended"]["rms"]


def test_what_changes_with_time_is_left_out_of_another_session(folder: Path) -> None:
    problem = po.load_problem(folder / "problem.yaml")
    data, later = (po.read_measurements(folder / name, problem) for name in ("creeping.csv", "later.csv"))
    told: list[tuple[int, int]] = []
    found = po.diagnose(problem, data, test=later, progress=lambda done, total: told.append((done, total)))
    first = found.effects[0]
    assert first.kind == "drift"
    assert first.gain > 0.5
    assert found.test_gain(0) is None
    # Without the drift there is no effect: the arm that is delivered and tested is the calibrated one.
    assert found.delivery.fit is not found.model
    assert found.test.models["extended"] == found.test.models["calibrated"]
    assert [done for done, _ in told] == sorted(done for done, _ in told)
    assert told[-1] == (100, 100)


@pytest.mark.parametrize(
    ("file", "extra", "words"),
    [
        ("one.csv", ["--refit-frames"], "1 pose is too few to fit base and tool again"),
        ("two_arms.csv", [], "the test file holds several robots"),
    ],
)
def test_a_test_file_that_tells_nothing_is_refused(
    file: str, extra: list[str], words: str, folder: Path, tmp_path: Path
) -> None:
    rows = (folder / "other.csv").read_text(encoding="utf-8").splitlines()
    (tmp_path / "one.csv").write_text("\n".join(rows[:2]), encoding="utf-8")
    named = [f"{row}, {'robot' if i == 0 else 'AB'[i % 2]}" for i, row in enumerate(rows)]
    (tmp_path / "two_arms.csv").write_text("\n".join(named), encoding="utf-8")
    others = ["--problem", folder / "problem.yaml", "--test", tmp_path / file, *extra]
    result = run(folder / "data.csv", *others)
    assert result.exit_code == 2
    assert words in " ".join(result.stderr.split())


def test_the_task_is_planned_again_with_the_extended_arm(folder: Path, tmp_path: Path) -> None:
    rng = np.random.default_rng(12)
    q = rng.uniform(-2.5, 2.5, (90, 2))
    write(tmp_path / "data.csv", q, position(wavy(q), (1.0, 1.003)) + rng.normal(0, NOISE, (90, 2)))
    task = "task: {kind: insert, direction: [0, -1, 0], position: [0.9 m, 0.4 m, 0 m], clearance: 0.5 mm}\n"
    (tmp_path / "problem.yaml").write_text(PROBLEM + task, encoding="utf-8")
    out = tmp_path / "out"
    result = run(tmp_path / "data.csv", "--problem", tmp_path / "problem.yaml", "--out", out, "--no-plots", "--full")
    assert result.exit_code == 0, result.stderr
    postures = json.loads((out / "diagnosis.json").read_text(encoding="utf-8"))["posture"]
    for name, model in (("nominal", lambda q: q), ("extended", wavy)):
        q = np.array([list(postures[name]["posture"].values())])
        # Where this posture truly lands, by the arm that made the data: across the direction, that is in x.
        truth = abs(float(position(wavy(q), (1.0, 1.003))[0, 0]) - 0.9)
        believed = position(model(q), (1.0, 1.0 if name == "nominal" else 1.003))[0]
        assert believed == pytest.approx([0.9, 0.4], abs=3e-5)  # what 90 rows of 20 µm tell of the arm
        assert abs(truth - postures[name]["critical_error"]) < 5e-5
    assert postures["extended"]["critical_error"] < 5e-5 < 1e-4 < postures["nominal"]["critical_error"]
    extended = po.load_problem(out / "extended.yaml")
    assert [effect.kind for effect in extended.effects] == ["cyclic_error"]
    assert "Comparison of plans" in result.stdout


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["data.csv", "--refit-frames"], "--refit-frames goes with --test"),
        (["missing.csv"], "missing.csv"),
    ],
)
def test_wrong_use_is_told(folder: Path, words: list[str], message: str, tmp_path: Path) -> None:
    data, *others = words
    result = run(folder / data, *others, "--problem", folder / "problem.yaml", "--out", tmp_path / "out")
    assert result.exit_code == 2
    assert message in result.stderr
    assert not (tmp_path / "out").exists()


def test_too_few_rows_are_a_verdict_too(folder: Path, tmp_path: Path) -> None:
    words = ["--problem", folder / "problem.yaml", "--out", tmp_path / "out", "--json"]
    result = run(folder / "few.csv", *words)
    assert result.exit_code == 4
    assert "measure at least" in result.stderr
    found = json.loads(result.stdout)
    assert found["verdict"] == "insufficient_data"
    assert "measure at least" in found["message"]
    assert not (tmp_path / "out").exists()
