"""Causes of the session and lasting ones that explain alike are rivals of each other, whichever is named."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import posture_opt as po
from tests.helpers.planar_2r import position
from tests.helpers.planar_files import planar_rows

ROWS = 100
LASTING = {"thermal_growth", "thermal_offset"}


def diagnosed(cause: str, reach: float) -> po.Diagnosis:
    """An arm that warms up by 8 K with 2500 s: its links grow, or only the place that is measured moves.

    Args:
        reach: half the range of its joints [rad].
    """
    rng = np.random.default_rng(0)
    q = np.array([0.6, 0.9]) + rng.uniform(-reach, reach, (ROWS, 2))
    t = np.linspace(0, 7200, ROWS)
    rise = 1 - np.exp(-t / 2500)
    warmer = 8 * rise + rng.normal(0, 0.05, ROWS)
    grown = 1 + 20e-6 * warmer * (cause == "growth")
    points = position(q, (grown, grown))
    # In the direction in which an arm that grows would move it: beside that, growth of one length is refuted.
    outward = position(np.array([[0.6, 0.9]]))[0]
    points += 2.2e-4 * outward / np.linalg.norm(outward) * rise[:, None] * (cause == "drift")
    points += rng.normal(0, 2e-5, points.shape)
    rows = planar_rows(q, points, temperature=("degC", 20 + warmer), time=("s", t))
    return po.diagnose(*rows, flips=99, plan=False)


def moving(found: po.Diagnosis) -> list[Any]:
    return [f for f in found.effects if f.effect is not None]


@pytest.mark.parametrize("cause", ["growth", "drift"])
def test_in_a_small_volume_growth_and_drift_are_rivals_of_each_other(cause: str) -> None:
    first, *_ = moving(diagnosed(cause, 0.03))
    rivals = {rival.kind for rival in first.confounded_with}
    assert "drift" in {first.kind, *rivals}
    assert LASTING & {first.kind, *rivals}


def test_one_drift_is_named_and_not_several_lasting_causes() -> None:
    assert [f.kind for f in moving(diagnosed("drift", 0.6))] == ["drift"]


def test_first_rows_that_are_off_are_a_drift_that_settles() -> None:
    """The base is stated, so that an arm which ends where the file says was off when it began, and not since."""
    rng = np.random.default_rng(3)
    q = rng.uniform(-2.0, 2.0, (ROWS, 2))
    points = position(q, (1.0, 1.0)) + rng.normal(0, 2e-5, (ROWS, 2))
    points += np.array([-1e-4, 2e-4]) * np.exp(-np.arange(ROWS) / 8)[:, None]
    found = po.diagnose(*planar_rows(q, points), flips=99, plan=False)
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


def measured(span: float, count: int, seed: int) -> tuple[po.Problem, po.Measurements]:
    """Rows of an arm whose first joint reads 1 mrad too far in every radian, up to 0.7 rad, and right beyond."""
    rng = np.random.default_rng(seed)
    q = np.stack([rng.uniform(-span, span, count), rng.uniform(-2.5, 2.5, count)], axis=1)
    turned = q + np.stack([1e-3 * q[:, 0] * (np.abs(q[:, 0]) < 0.7), 0 * q[:, 0]], axis=1)
    return planar_rows(q, position(turned) + rng.normal(0, NOISE, q.shape))


@pytest.fixture(scope="module")
def found() -> po.Diagnosis:
    return po.diagnose(*measured(NARROW, 150, 71), test=measured(WIDE, 80, 72)[1], flips=99, plan=False)


def test_an_effect_that_extrapolates_badly_is_named(found: po.Diagnosis) -> None:
    (effect,) = (f for f in found.effects if f.effect is not None)
    assert effect.kind == "joint_scale"
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
