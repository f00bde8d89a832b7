"""Causes of the session and lasting ones that explain alike are rivals of each other, whichever is named."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import posture_opt as po
from tests.helpers.planar_2r import position
from tests.helpers.planar_files import PROBLEM, write
from tests.helpers.variants import conformance

ROWS = 100
LASTING = {"thermal_growth", "thermal_offset"}


def diagnosed(folder: Path, cause: str, reach: float, seed: int) -> po.Diagnosis:
    """An arm that warms up by 8 K with 2500 s: its links grow, or only the place that is measured moves.

    Args:
        reach: half the range of its joints [rad].
    """
    rng = np.random.default_rng(seed)
    q = np.array([0.6, 0.9]) + rng.uniform(-reach, reach, (ROWS, 2))
    t = np.linspace(0, 7200, ROWS)
    rise = 1 - np.exp(-t / 2500)
    warmer = 8 * rise + rng.normal(0, 0.05, ROWS)
    grown = 1 + 20e-6 * warmer * (cause == "growth")
    points = position(q, (grown, grown))
    # In the direction in which an arm that grows would move it: beside that, growth of one length is refuted.
    outward = position(np.array([[0.6, 0.9]]))[0]
    points += 2.2e-4 * outward / np.linalg.norm(outward) * rise[:, None] * (cause == "drift")
    uneven = rise + 0.2 * np.sin(2 * np.pi * t / 7200)
    points += np.array([2e-4, 1e-4]) * uneven[:, None] * (cause == "uneven drift")
    points -= 2e-3 * np.stack([np.cos(0.6), np.sin(0.6)]) * rise[:, None] * (cause == "large drift")
    points += rng.normal(0, 2e-5, points.shape)
    write(folder / "data.csv", q, points, temperature=("degC", 20 + warmer), time=("s", t))
    problem = po.problem_from_dict(PROBLEM)
    return po.diagnose(problem, po.read_measurements(folder / "data.csv", problem), flips=99, plan=False)


def moving(found: po.Diagnosis) -> list[Any]:
    return [f for f in found.effects if f.effect is not None]


@pytest.mark.parametrize("cause", ["growth", "drift"])
@pytest.mark.parametrize("seed", conformance([0, 1], [0]))
def test_in_a_small_volume_growth_and_drift_are_rivals_of_each_other(cause: str, seed: int, tmp_path: Path) -> None:
    first, *_ = moving(diagnosed(tmp_path, cause, 0.03, seed))
    rivals = {rival.kind for rival in first.confounded_with}
    assert "drift" in {first.kind, *rivals}
    assert LASTING & {first.kind, *rivals}


@pytest.mark.parametrize("seed", conformance([0, 1], [0]))
def test_one_drift_is_named_and_not_several_lasting_causes(seed: int, tmp_path: Path) -> None:
    assert [f.kind for f in moving(diagnosed(tmp_path, "drift", 0.6, seed))] == ["drift"]


def test_first_rows_that_are_off_are_a_drift_that_settles(tmp_path: Path) -> None:
    """The base is stated, so that an arm which ends where the file says was off when it began, and not since."""
    rng = np.random.default_rng(3)
    q = rng.uniform(-2.0, 2.0, (ROWS, 2))
    points = position(q, (1.0, 1.0)) + rng.normal(0, 2e-5, (ROWS, 2))
    points += np.array([-1e-4, 2e-4]) * np.exp(-np.arange(ROWS) / 8)[:, None]
    write(tmp_path / "data.csv", q, points)
    problem = po.problem_from_dict(PROBLEM)
    found = po.diagnose(problem, po.read_measurements(tmp_path / "data.csv", problem), flips=99, plan=False)
    (drift,) = moving(found)
    assert (drift.kind, drift.target) == ("drift", "settling")
    assert [rival.kind for rival in drift.confounded_with].count("drift") == 0
    sizes = drift.estimate
    for axis, true in zip("xy", (-1e-4, 2e-4), strict=True):
        assert abs(sizes[axis][0] - true) < 3 * sizes[axis][1]
    constant, std, unit = sizes["constant"]
    assert abs(constant - 8) < 3 * std
    assert unit == "rows"
    assert "the first rows are off, and the measured point settles within" in found.report().replace("\n", " ")


# --- Effects that hold in the measured ranges and not beyond: named, with the rows outside shown apart ----------------

NOISE = 2e-5  # m
NARROW, WIDE = 0.6, 2.5  # rad of joint1


def measured(file: Path, span: float, count: int, seed: int) -> Path:
    """Rows of an arm whose first joint reads 1 mrad too far in every radian, up to 0.7 rad, and right beyond."""
    rng = np.random.default_rng(seed)
    q = np.stack([rng.uniform(-span, span, count), rng.uniform(-2.5, 2.5, count)], axis=1)
    turned = q + np.stack([1e-3 * q[:, 0] * (np.abs(q[:, 0]) < 0.7), 0 * q[:, 0]], axis=1)
    write(file, q, position(turned) + rng.normal(0, NOISE, q.shape))
    return file


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> po.Diagnosis:
    folder = tmp_path_factory.mktemp("sessions")
    problem = po.problem_from_dict(PROBLEM)
    data, other = (
        po.read_measurements(measured(folder / name, span, count, seed), problem)
        for name, span, count, seed in (("data.csv", NARROW, 150, 71), ("other.csv", WIDE, 80, 72))
    )
    return po.diagnose(problem, data, test=other, flips=99, plan=False)


def test_an_effect_that_extrapolates_badly_is_named(found: po.Diagnosis) -> None:
    (effect,) = (f for f in found.effects if f.effect is not None)
    assert effect.kind == "joint_scale"
    assert found.test is not None
    assert found.test.worse == (effect.place,)
    out = found.test.file.outside
    assert out.sum() > 50
    assert found.test.file.rms("extended", out) > found.test.file.rms("calibrated", out)
    assert found.test.file.rms("extended", ~out) < found.test.file.rms("calibrated", ~out)
    document = found.to_json()["test"]
    assert document["rows_outside_training"] == out.sum()
    assert document["improves"] is False
    assert document["extrapolates_badly"] == [{"kind": "joint_scale", "target": "joint1"}]
    assert "diagnosis.test-extrapolates" in {s["id"] for s in found.to_json()["statements"]}
