"""Effects that hold in the measured ranges and not beyond: named, with the rows outside shown apart."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import posture_opt as po
from tests.helpers.planar_2r import position
from tests.helpers.planar_files import PROBLEM, write

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
