"""What is delivered as scatter is what differs between repeats; errors of the model stand with what is uncertain."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import posture_opt as po
from posture_opt.validation.residual_scatter import residual_scatter
from tests.helpers.planar_2r import position
from tests.helpers.scattering_arm import NOISE, arm, table

SHAKE = 1e-4  # rad, of each joint from repeat to repeat
DENT = 1e-3  # rad, of the second joint: a wave that no model knows, the same at every repeat


def measured(seed: int, times: int, shake: float = SHAKE, stated: dict[str, Any] | None = None) -> tuple[Any, Any]:
    """A problem and 150 rows of 1 m and 0.8 m links, each posture measured so often."""
    rng = np.random.default_rng(seed)
    q = rng.permutation(np.tile(rng.uniform(-2.5, 2.5, (150 // times, 2)), (times, 1)))
    wave = DENT * np.sin(q @ [9.0, 14.0])
    reached = q + np.outer(wave, [0, 1]) + shake * rng.normal(size=q.shape)
    problem = arm(stated or {})
    points = position(reached, (1.0, 0.8)) + NOISE * rng.normal(size=q.shape)
    return problem, po.read_measurements(table(q, points), problem)


def sigmas(problem: Any, part: str) -> dict[str, float]:
    matrix = getattr(problem.sources, part)
    return dict(zip(problem.sources.names, np.sqrt(np.diag(matrix)), strict=True))


def test_repeats_tell_scatter_from_errors_of_the_model() -> None:
    problem, data = measured(41, times=5)
    calibration = po.calibrate(problem, data)
    calibrated = po.calibrated_problem(problem, calibration)
    scatter, constant = sigmas(calibrated, "scatter"), sigmas(calibrated, "constant")
    # Some 119 differences (twice in a row is one repeat) of two coordinates tell one σ for both joints to 5 %.
    assert scatter["j1.theta"] == pytest.approx(SHAKE, rel=0.2)
    assert scatter["j2.theta"] == pytest.approx(SHAKE, rel=0.2)
    # The wave has an RMS of its height over √2; it is the same at every repeat.
    assert np.hypot(constant["j1.theta"], constant["j2.theta"]) > 0.6 * DENT / np.sqrt(2)
    assert "differences between repeats show it" in " ".join(calibrated.header)
    # Where the arm goes next it errs by both.
    total = residual_scatter(problem, calibration).sigma
    assert max(total.values()) > 0.6 * DENT / np.sqrt(2)


def test_without_repeats_it_is_said_to_be_an_upper_bound() -> None:
    problem, data = measured(43, times=1)
    calibrated = po.calibrated_problem(problem, po.calibrate(problem, data))
    assert "an upper bound, as repeats are too few" in " ".join(calibrated.header)
    assert max(sigmas(calibrated, "scatter").values()) > 3 * SHAKE


def test_what_the_file_states_is_not_exceeded_where_nothing_is_repeated() -> None:
    problem, data = measured(44, times=1, stated={"scatter": {"j1.theta": "0.1 mrad", "j2.theta": "0.1 mrad"}})
    calibrated = po.calibrated_problem(problem, po.calibrate(problem, data))
    assert max(sigmas(calibrated, "scatter").values()) <= SHAKE * 1.001
    assert "as the file states it" in " ".join(calibrated.header)


def test_a_diagnosis_delivers_no_more_scatter_than_repeats_show() -> None:
    problem, data = measured(45, times=5)
    found = po.diagnose(problem, data, plan=False)
    assert not [f for f in found.effects if f.kind == "joint_noise"]
    assert max(sigmas(found.extended, "scatter").values()) == pytest.approx(SHAKE, rel=0.3)
