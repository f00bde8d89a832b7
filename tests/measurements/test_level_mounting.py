"""A level on a SCARA, whose tool does not tilt: only errors of the arm show whether it hangs upside down."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import posture_opt as po
from posture_opt.measurements.kinds import Level, Mixed
from tests.helpers.simulated_arm import SimulatedArm, turn

SCARA = (
    # maker's table: name, type, theta, d, a, alpha
    ("joint1", "revolute", 0.0, 0.0, 0.22, 0.0), ("joint2", "revolute", 0.0, 0.0, 0.13, np.pi),
    ("joint3", "prismatic", 0.0, 0.0, 0.0, 0.0), ("joint4", "revolute", 0.0, 0.0, 0.0, 0.0),
)  # fmt: skip
PROBLEM = {
    "robot": {"kind": "preset", "name": "scara"},
    "uncertainty": {"measurement": {"level": "0.02 mrad", "distance": "0.02 mm"}},
}


def readings(seed: int, upright: bool, n: int = 24) -> tuple[dict[str, Any], SimulatedArm, np.ndarray]:
    """A table of a drawn arm, the arm, and where its level was read."""
    rng = np.random.default_rng(seed)
    errors = {f"{row[0]}.{p}": rng.normal(0, 0.5e-3) for row in SCARA for p in ("theta", "d", "a", "alpha")}
    mounted = turn(0, 0.3 + np.pi * upright) @ turn(2, rng.uniform(-3, 3))  # the axis of the tool points down
    arm = SimulatedArm(SCARA, errors, tool=mounted)
    q = rng.uniform([-2.4, -2.4, 0.0, -3.0], [2.4, 2.4, 0.15, 3.0], (n, 4))
    angles = np.degrees(np.arcsin(arm.poses(q)[:, 2, :2]) + rng.normal(0, 2e-5, (n, 2)))
    joints = {f"{row[0]} [{'m' if row[1] == 'prismatic' else 'rad'}]": c for row, c in zip(SCARA, q.T, strict=True)}
    return {**joints, "level_x [deg]": angles[:, 0], "level_y [deg]": angles[:, 1]}, arm, q


def test_it_is_the_same_beside_another_instrument() -> None:
    given, (table, arm, q) = po.problem_from_dict(PROBLEM), readings(3, upright=True)
    length = np.linalg.norm(arm.points(q) - [0.5, 0.4, 0.3], axis=1)
    both = {name: np.tile(column, 2) for name, column in table.items()}
    both |= {name: np.r_[column, np.full(len(q), np.nan)] for name, column in table.items() if "level" in name}
    both |= {"distance [m]": np.r_[np.full(len(q), np.nan), length], "anchor": [""] * len(q) + ["post"] * len(q)}
    both["instrument"] = ["tilt"] * len(q) + ["wire"] * len(q)
    kind = po.read_measurements(both, given).kind
    assert isinstance(kind, Mixed)
    level = kind.members[0].kind
    assert isinstance(level, Level)
    assert level.mounting[2, 2] < 0
    assert len(level.others) == 1


@pytest.mark.long
def test_a_level_on_a_scara_is_calibrated_to_its_noise() -> None:
    given = po.problem_from_dict(PROBLEM)
    for seed in (1, 2):
        found = po.calibrate(given, po.read_measurements(readings(seed, bool(seed % 2))[0], given), plan=False, folds=2)
        assert 0.5 < found.variance < 1.6
