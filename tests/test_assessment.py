"""What a model gets wrong: statistics by direction, tests of the mean, ISO 9283, one goal in two postures."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import posture_opt as po
from posture_opt.diagnosis.mean_test import block_tests, group_means, holm, mean_test
from posture_opt.diagnosis.measurements import Measurements
from posture_opt.diagnosis.reading import read_measurements
from tests.helpers.planar_2r import position, postures_at

DATA = Path(__file__).parents[2] / "shared" / "data"
real = pytest.mark.skipif(not DATA.is_dir(), reason=f"the measurements of real arms are not there: {DATA}")

NOISE = 2e-5  # m, of each measured coordinate
SHAKE = np.array([1e-4, 2e-4])  # rad, of the joints from visit to visit
LONGER = 3e-3  # m: what the second link has more than the problem file says
JOINTS = [{"name": f"joint{k}", "type": "revolute", "a": "1 m"} for k in (1, 2)]


def planar(task: bool = True, **sections: Any) -> Any:
    document = {
        "robot": {"kind": "dh", "joints": JOINTS},
        "uncertainty": {
            "sigma": {"joint1.theta": "0.1 mrad", "joint2.theta": "0.2 mrad"},
            "measurement": {"position": "0.02 mm"},
        },
        **({"task": {"kind": "insert", "direction": [0, -1, 0]}} if task else {}),
        **sections,
    }
    return po.problem_from_dict(document)


def measured(problem: Any, q: np.ndarray, points: np.ndarray, **more: Any) -> Measurements:
    columns = {f"joint{k + 1} [rad]": q[:, k] for k in range(2)}
    columns |= {f"{axis} [m]": points[:, k] for k, axis in enumerate("xyz"[: points.shape[1]])}
    return read_measurements({**columns, **more}, problem)


def visits(rng: np.random.Generator, poses: int, repeats: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Commands, measured points and poses of an arm with a longer link, joints that shake, and noise."""
    q = np.repeat(rng.uniform(-2.5, 2.5, (poses, 2)), repeats, axis=0)
    points = position(q + rng.normal(0, SHAKE, q.shape), (1.0, 1.0 + LONGER))
    return q, points + rng.normal(0, NOISE, q.shape), np.repeat(np.arange(poses), repeats)


@pytest.fixture(scope="module")
def assessed() -> tuple[Any, Measurements, Any, Any]:
    problem = planar()
    q, points, pose = visits(np.random.default_rng(1), 40, 8)
    data = measured(problem, q, points, pose=pose)
    calibration = po.calibrate(problem, data)
    return problem, data, calibration, po.assess(problem, data, calibration)


def test_statistics_by_axis_are_those_of_the_errors(assessed: Any) -> None:
    _, _, calibration, found = assessed
    for model, errors in ((found.nominal, calibration.errors_nominal), (found.calibrated, calibration.errors)):
        e = -np.delete(errors, calibration.outliers, axis=0)
        by_name = {d.name: d for d in model.deviations}
        assert list(by_name) == ["x", "y", "along", "across", "all"]
        for name, values in (("x", e[:, 0]), ("y", e[:, 1]), ("along", -e[:, 1])):
            d = by_name[name]
            assert d.bias == pytest.approx(values.mean(), abs=1e-15)
            assert (d.rms, d.mean, d.max) == pytest.approx(
                (np.sqrt(np.mean(values**2)), np.abs(values).mean(), np.abs(values).max())
            )
            assert d.p95 == pytest.approx(np.percentile(np.abs(values), 95))
        # In the plane nothing but x lies across a direction along y.
        assert by_name["across"].rms == pytest.approx(by_name["x"].rms)
        assert by_name["all"].rms == pytest.approx(np.sqrt(np.mean(np.sum(e**2, axis=1))))
    assert found.nominal.deviations[-1].rms == pytest.approx(calibration.nominal.rms)
    assert found.calibrated.deviations[-1].rms == pytest.approx(calibration.calibrated.rms)


def test_the_sign_is_that_of_measured_minus_model() -> None:
    problem = planar()
    q = np.random.default_rng(2).uniform(-2.5, 2.5, (60, 2))
    shifted = position(q) + np.array([1e-3, 0.0])
    data = measured(problem, q, shifted + np.random.default_rng(3).normal(0, NOISE, (60, 2)))
    found = po.assess(problem, data, po.calibrate(problem, data))
    # 60 rows of 20 µm: the mean is good to 2.6 µm.
    assert found.nominal.deviations[0].bias == pytest.approx(1e-3, abs=1.3e-5)
    assert not found.nominal.mean.zero
