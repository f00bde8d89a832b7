"""Rows of one posture that follow each other: scatter of a joint is seen in them, its absence is not concluded.

Made on seeds 1 and 2; judged on those here.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.helpers.simulated_session import SimulatedSession, beyond_geometry
from tests.hidden.designs import Plan
from tests.hidden.mechanics import walk
from tests.hidden.noise import SIGMA

POSES, TIMES = 24, 10
JOINT, SCATTER = 2, 2e-4  # index of the joint; rad


def found_in(seed: int, *, scatter: float = 0.0, factor: float = 1.0) -> Any:
    """The diagnosis of every pose ten times, rows of one after each other."""
    plan = Plan(rows=POSES, repeated=0, visits=1, payloads=(0.0,), sides=False, logged=False)
    case = SimulatedSession(seed, plan=plan)
    order = np.repeat(np.arange(POSES), TIMES)
    q = case.session.q[order]
    moved = q.copy()
    moved[:, JOINT] += case.rng.normal(0, scatter, len(q)) if scatter else 0.0
    p = walk(case.arm, moved, case.deviations).p + case.rng.normal(0, factor * SIGMA, (len(q), 3))
    table: dict[str, Any] = {f"{name} [rad]": q[:, j] for j, name in enumerate(case.arm.joints)}
    return case, case.diagnosis(table | {f"{axis} [m]": p[:, i] for i, axis in enumerate("xyz")} | {"pose": order})


@pytest.mark.long
def test_a_joint_that_scatters_from_row_to_row_is_named() -> None:
    case, found = found_in(21, scatter=SCATTER)
    assert ("joint_noise", case.arm.joints[JOINT]) in beyond_geometry(found)
    (noise,) = [f for f in found.effects if f.kind == "joint_noise"]
    value, std, _ = noise.estimate["sigma"]
    assert abs(value - SCATTER) < 4 * std
    assert not found.repeat_plans


@pytest.mark.long
def test_an_instrument_that_scatters_otherwise_than_stated_is_named_from_readings() -> None:
    _, found = found_in(31, factor=2.0)
    (noise,) = [f for f in found.effects if f.noise is not None]
    assert (noise.kind, noise.target) == ("stated_sigma", "data")
    value, std, _ = noise.estimate["factor"]
    assert abs(value - 2.0) < 4 * std
