"""What a file states of its arm's geometry: a diagnosis weighs it against the measurements as a calibration does."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import posture_opt as po
from posture_opt.calibration.estimation.fit import Fit
from posture_opt.diagnosis.scores.candidates import linearise_calibration

LENGTHS = (0.5, 0.4)
INSTRUMENT = 1e-4  # m
STATED = {"joint1.theta": 1e-4, "joint2.theta": 1e-4, "joint1.a": 5e-5, "joint2.a": 5e-5}  # rad, m
ROWS = 14


def arm(q: np.ndarray, off: np.ndarray) -> np.ndarray:
    """(N, 2) tool point [m] of an arm whose joints and links are ``off`` (4,) [rad, m]."""
    first = q[:, 0] + off[0]
    both = first + q[:, 1] + off[1]
    a, b = LENGTHS + off[2:]
    return np.stack([a * np.cos(first) + b * np.cos(both), a * np.sin(first) + b * np.sin(both)], axis=1)


def problem(stated: bool) -> po.Problem:
    sigma = {name: f"{value * 1e3} {'mm' if name.endswith('.a') else 'mrad'}" for name, value in STATED.items()}
    uncertainty: dict[str, Any] = {"measurement": {"position": f"{INSTRUMENT * 1e3} mm"}}
    joints = [{"name": f"joint{i + 1}", "a": f"{length} m"} for i, length in enumerate(LENGTHS)]
    task = {"kind": "insert", "direction": [0, 1, 0], "position": ["0.5 m", "0.4 m", "0 m"]}
    return po.problem_from_dict({
        "robot": {"kind": "dh", "joints": joints},
        "uncertainty": {**uncertainty, **({"sigma": sigma} if stated else {})}, "task": task,
    })  # fmt: skip


def calibrated(seed: int, stated: bool = True) -> tuple[po.Calibration, np.ndarray]:
    """A calibration from few rows in a corner of the workspace, and how far off the arm truly is (4,)."""
    rng = np.random.default_rng(seed)
    q = np.stack([rng.uniform(0.2, 0.5, ROWS), rng.uniform(0.2, 0.6, ROWS)], axis=1)
    off = rng.normal(0, list(STATED.values()))
    p = arm(q, off) + rng.normal(0, INSTRUMENT, (ROWS, 2))
    given = problem(stated)
    table = {"joint1 [rad]": q[:, 0], "joint2 [rad]": q[:, 1], "x [m]": p[:, 0], "y [m]": p[:, 1]}
    return po.calibrate(given, po.read_measurements(table, given)), off


def elsewhere(model: Fit, off: np.ndarray) -> float:
    """RMS error [m] over the whole workspace."""
    names = [p.name for p in model.residuals.parameters]
    q = np.random.default_rng(0).uniform(-2.5, 2.5, (400, 2))
    error = arm(q, model.x[[names.index(name) for name in STATED]]) - arm(q, off)
    return float(np.sqrt(np.mean(np.sum(error**2, axis=1))))


def test_what_is_stated_of_the_geometry_keeps_the_diagnosed_arm_right_where_nothing_was_measured() -> None:
    errors, nominal = [], []
    for seed in range(8):
        calibration, off = calibrated(seed)
        model = calibration.fit_effects(linearise_calibration(calibration, flips=0).sensitivities.residuals, [])
        # The same rows, the same prior, the same weight: the same arm.
        np.testing.assert_allclose(model.x, calibration.x, atol=2e-6)
        np.testing.assert_allclose(np.diag(model.covariance), np.diag(calibration.covariance), rtol=0.05, atol=1e-14)
        errors.append(elsewhere(model, off))
        nominal.append(elsewhere(replace(model, x=0 * model.x), off))
    # By the data alone 0.34 mm on average, nominal 0.10 mm.
    assert np.mean(errors) < 0.7 * np.mean(nominal)


@pytest.mark.parametrize(("times", "instrument"), [(1.0, True), (20.0, True), (20.0, False)])
def test_wrong_sigmas_do_not_hide_behind_a_large_effect(times: float, instrument: bool) -> None:
    """Joint zeros that are off by 20 of their σ, beside an eccentric gear that moves the tool ten times as far."""
    given = problem(stated=True)
    if not instrument:
        given = replace(given, measurement=None)
    rng = np.random.default_rng(11)
    q = rng.uniform(-2.5, 2.5, (80, 2))
    off = times * np.array([STATED["joint1.theta"], -STATED["joint2.theta"], 0.0, 0.0])
    turned = q + 20e-3 * np.stack([np.sin(q[:, 0]), 0.0 * q[:, 1]], axis=1)
    p = arm(turned, off) + rng.normal(0, INSTRUMENT, q.shape)
    table = {"joint1 [rad]": q[:, 0], "joint2 [rad]": q[:, 1], "x [m]": p[:, 0], "y [m]": p[:, 1]}
    found = po.diagnose(given, po.read_measurements(table, given), plan=False)
    refuted = {(c.cause.kind, c.cause.target): c.estimate["theta"] for c in found.calibration.contradictions}
    wrong = [("joint_offset", "joint1"), ("joint_offset", "joint2")]
    assert found.verdict == "effects_found"
    assert list(refuted) == (wrong if times > 1 else [])
    for key, true in zip(wrong, off[:2], strict=True):
        value, std, _ = refuted.get(key, (true, 1.0, "rad"))
        assert abs(value - true) < 3 * std
    # Two coordinates of the instrument, and a few parameters of 80 rows.
    assert found.errors["extended"].rms < 1.25 * np.sqrt(2) * INSTRUMENT + 2e-5
    entries = found.to_json()["effects"]
    said = {f"{e['target']}.theta": e["refuted_sigma"] for e in entries if "refuted_sigma" in e}
    assert said == ({name: STATED[name] for name in ("joint1.theta", "joint2.theta")} if times > 1 else {})
