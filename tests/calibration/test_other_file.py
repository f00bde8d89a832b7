"""A test file: its targets matched by name, its points its own, its rows outside of the joint ranges counted."""

from __future__ import annotations

import copy
import json
from pathlib import Path

import numpy as np
import pytest

import posture_opt as po
from posture_opt.calibration.second_file import OtherFile
from tests.helpers.command_line import invoke
from tests.helpers.planar_2r import position
from tests.helpers.planar_files import PROBLEM

NOISE = 2e-5  # m
LONG = np.array([1.002, 0.997])  # m, links
OFFSETS = {"a": (0.0, 0.0), "b": (0.05, 0.02), "c": (-0.03, 0.06)}  # m, in the frame of the second link
HEAD = "target, joint1 [deg], joint2 [deg], x [mm], y [mm]"


def rows(names: str, count: int, seed: int, span: float = 2.0) -> list[tuple[str, np.ndarray, np.ndarray]]:
    """``count`` rows of random targets: name, joints [rad], measured point [m]."""
    rng = np.random.default_rng(seed)
    found = []
    for name in rng.permutation((list(names) * count)[:count]):
        q = rng.uniform(-span, span, 2)
        turn = q.sum()
        x, y = OFFSETS[name]
        beside = np.array([np.cos(turn) * x - np.sin(turn) * y, np.sin(turn) * x + np.cos(turn) * y])
        found.append((str(name), q, position(q, LONG) + beside + rng.normal(0, NOISE, 2)))
    return found


def table(path: Path, found: list[tuple[str, np.ndarray, np.ndarray]], *, named: bool = True) -> Path:
    lines = [HEAD if named else HEAD.removeprefix("target, ")]
    for name, q, p in found:
        numbers = ", ".join(f"{v:.9f}" for v in (*np.degrees(q), *(1e3 * p)))
        lines.append(f"{name}, {numbers}" if named else numbers)
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


@pytest.fixture
def learned(tmp_path: Path) -> Path:
    return table(tmp_path / "data.csv", rows("abc", 90, 1))


def predicted(data: Path, other: Path, **options: bool) -> OtherFile:
    problem = po.problem_from_dict(copy.deepcopy(PROBLEM))
    both = (po.read_measurements(file, problem) for file in (data, other))
    found = po.calibrate(problem, next(both), test=next(both), plan=False, **options).test
    assert found is not None
    return found


@pytest.mark.parametrize("names", ["bca", "b"])
def test_targets_are_matched_by_name(names: str, learned: Path, tmp_path: Path) -> None:
    found = predicted(learned, table(tmp_path / "other.csv", rows(names, 40, 2)))
    assert found.models["calibrated"].rms < 1.4 * np.sqrt(2) * NOISE  # 80 numbers, and 10 parameters of 180
    assert found.improves


def test_frames_fitted_again_match_targets_too(learned: Path, tmp_path: Path) -> None:
    other = [(name, q, p + np.array([0.01, -0.02])) for name, q, p in rows("cb", 40, 3)]
    file = table(tmp_path / "other.csv", other)
    assert predicted(learned, file).models["calibrated"].rms > 0.02
    assert predicted(learned, file, refit_frames=True).models["calibrated"].rms < 1.5 * np.sqrt(2) * NOISE


def test_only_an_unknown_target_is_refused(learned: Path, tmp_path: Path) -> None:
    text = table(tmp_path / "other.csv", rows("ab", 40, 4)).read_text("utf-8").replace("\nb,", "\nball,")
    (tmp_path / "other.csv").write_text(text, encoding="utf-8")
    with pytest.raises(po.errors.InputError) as error:
        predicted(learned, tmp_path / "other.csv")
    message = str(error.value)
    assert "has no target 'ball'" in message
    assert sorted(message.partition("one of: ")[2].split(", ")) == ["a", "b", "c"]
    unnamed = table(tmp_path / "unnamed.csv", rows("a", 40, 4), named=False)
    with pytest.raises(po.errors.InputError, match="does not say which target"):
        predicted(learned, unnamed)


def test_one_target_needs_no_name(tmp_path: Path) -> None:
    data = table(tmp_path / "data.csv", rows("a", 60, 5))
    found = predicted(data, table(tmp_path / "other.csv", rows("a", 40, 6), named=False))
    assert found.models["calibrated"].rms < 1.4 * np.sqrt(2) * NOISE
    plain = table(tmp_path / "plain.csv", rows("a", 60, 5), named=False)
    with pytest.raises(po.errors.InputError, match="leave out the column"):
        predicted(plain, tmp_path / "data.csv")


def touched(path: Path, points: str, seed: int) -> Path:
    """Touches of fixed points, some ten each, by joints that reach them but for the noise."""
    rng = np.random.default_rng(seed)
    lines = ["point, joint1 [deg], joint2 [deg]"]
    places = {"p": (1.2, 0.3), "q": (0.5, 1.0), "r": (-0.8, 0.9), "s": (0.1, -1.3)}
    for name in points * 2:
        goal = np.array(places[name]) + rng.normal(0, NOISE, 2)
        c = (goal @ goal - LONG @ LONG) / (2 * LONG.prod())
        for side in (1, -1):
            t2 = side * np.arccos(c)
            t1 = np.arctan2(goal[1], goal[0]) - np.arctan2(LONG[1] * np.sin(t2), LONG[0] + LONG[1] * np.cos(t2))
            lines.append(f"{name}, {np.degrees(t1):.9f}, {np.degrees(t2):.9f}")
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


@pytest.mark.parametrize(("points", "again"), [("s", False), ("srqp", True)])
def test_points_of_another_session_are_its_own(points: str, again: bool, tmp_path: Path) -> None:
    data, other = touched(tmp_path / "data.csv", "pqr", 7), touched(tmp_path / "other.csv", points, 8)
    found = predicted(data, other, refit_frames=again)
    assert found.models["calibrated"].rms < 3 * NOISE


def test_rows_outside_the_measured_ranges_are_counted_and_shown_apart(learned: Path, tmp_path: Path) -> None:
    wide = rows("abc", 60, 9, span=2.6)
    found = predicted(learned, table(tmp_path / "other.csv", wide))
    q = np.array([q for _, q, _ in wide])
    own = np.array([q for _, q, _ in rows("abc", 90, 1)])
    out = ((q < own.min(axis=0)) | (q > own.max(axis=0))).any(axis=1)
    assert 5 < out.sum() < 55
    np.testing.assert_array_equal(found.outside, out)
    document = found.to_json()
    assert document["rows_outside_training"] == out.sum()
    expected = np.sqrt(np.mean(np.sum(found.errors["calibrated"][out] ** 2, axis=1)))
    assert document["calibrated"]["rms_outside_training"] == pytest.approx(expected)
    assert predicted(learned, learned).to_json()["rows_outside_training"] == 0


def test_calibrate_says_where_it_does_not_hold(learned: Path, tmp_path: Path) -> None:
    drawn = [(name, q, p - position(q, LONG) + position(q)) for name, q, p in rows("a", 40, 10)]
    other = table(tmp_path / "other.csv", drawn)
    (tmp_path / "problem.yaml").write_text(json.dumps(PROBLEM), encoding="utf-8")
    words = ["calibrate", str(learned), "--problem", str(tmp_path / "problem.yaml"), "--test", str(other)]
    document = json.loads(invoke(*words, "--json").stdout)
    assert "calibration.test-fails" in {s["id"] for s in document["statements"]}
    assert document["test"]["improves"] is False
    assert document["test"]["rows"] == 40
