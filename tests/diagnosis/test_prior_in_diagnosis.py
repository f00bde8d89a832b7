"""What a file states of its arm's geometry: a diagnosis weighs it against the measurements as a calibration does."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import posture_opt as po

LENGTHS = (0.5, 0.4)
INSTRUMENT = 1e-4  # m
STATED = {"joint1.theta": 1e-4, "joint2.theta": 1e-4, "joint1.a": 5e-5, "joint2.a": 5e-5}  # rad, m


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


@pytest.mark.parametrize(("times", "instrument"), [(1.0, True), (20.0, False)])
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
