"""Tolerances of parts as data ask for them: against densities of samples, and at an arm whose zeros are far off."""

from __future__ import annotations

import numpy as np

import posture_opt as po
from tests.helpers.instruments import TrueArm, distance_table


def test_zeros_set_by_hand_do_not_loosen_the_lengths() -> None:
    """Zeros off by 5 mrad beside lengths of 0.1 mm, as of real arms: one width for all would leave lengths open."""
    rng = np.random.default_rng(31)
    errors = rng.normal(0, 1, (6, 4)) * np.array([5e-3, 1e-4, 1e-4, 3e-4])
    arm = TrueArm(errors=errors)
    tool = {"xyz": ["30 mm", "-20 mm", "120 mm"], "rpy": ["0 deg"] * 3, "free": True}
    given = po.problem_from_dict(
        {
            "robot": {"kind": "preset", "name": "ur10", "tool": tool},
            "uncertainty": {"measurement": {"distance": "0.02 mm"}},
        }
    )
    table = {k: v for k, v in distance_table(arm, rng, 15, 2e-5).items() if not k.endswith(".approach")}
    found = po.calibrate(given, po.read_measurements(table, given), folds=2, plan=False)
    width = dict(zip((p.name for p in found.parameters), found.prior.tolist(), strict=True))
    assert width["elbow.a"] < 0.4e-3
    assert width["elbow.theta"] > 2e-3
    assert any("lengths 0." in note and "zeros of joints" in note for note in found.notes)
