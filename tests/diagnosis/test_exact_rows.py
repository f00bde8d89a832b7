"""Rows without any noise, as a first simulation has them: what was put in is found, and nothing beside it."""

from __future__ import annotations

import numpy as np
import pytest

import posture_opt as po
from posture_opt.numerics import Array


def _rows(offset: float, seed: int) -> dict[str, Array]:
    """A planar arm of two links of 1 m, whose second joint is off by an offset [rad]."""
    first, second = np.random.default_rng(seed).uniform(-2.0, 2.0, (2, 30))
    both = first + second + offset
    x, y = np.cos(first) + np.cos(both), np.sin(first) + np.sin(both)
    return {"joint1 [rad]": first, "joint2 [rad]": second, "x [m]": x, "y [m]": y}


@pytest.mark.parametrize(("offset", "causes"), [(0.0, []), (1e-3, ["joint_offset"])])
def test_what_a_simulation_without_noise_holds_is_found_alone(offset: float, causes: list[str]) -> None:
    problem = po.load_problem("insert_planar_2r_measured")
    found = po.diagnose(problem, po.read_measurements(_rows(offset, 5), problem), plan=False)
    assert [finding.kind for finding in found.effects] == causes
    assert "1 nm" in found.report(full=True)
    if offset:
        (size,) = found.effects[0].estimate.values()
        assert size[0] == pytest.approx(offset, abs=1e-8)


def test_turned_orientations_stay_unit_quaternions() -> None:
    problem = po.load_problem("insert_planar_2r_measured")
    rows = _rows(0.0, 6)
    yaw = rows["joint1 [rad]"] + rows["joint2 [rad]"]
    half = {"qw": np.cos(yaw / 2), "qx": 0 * yaw, "qy": 0 * yaw, "qz": np.sin(yaw / 2)}
    found = po.diagnose(problem, po.read_measurements({**rows, "z [m]": 0 * yaw, **half}, problem), plan=False)
    assert not found.effects
