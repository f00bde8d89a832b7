"""An effect of usual size beside one ten times as large, which must not hide it by what it does to the null."""

from __future__ import annotations

import pytest

from tests.helpers.simulated_session import SimulatedSession, beyond_geometry
from tests.helpers.variants import conformance
from tests.hidden.designs import Plan
from tests.hidden.effects import Effect
from tests.hidden.noise import SIGMA


@pytest.mark.parametrize("seed", conformance([601, 602, 603], [601]))
def test_a_joint_that_turns_with_heat_is_found_beside_a_joint_whose_scale_is_off(seed: int) -> None:
    case = SimulatedSession(seed, "ur10", Plan(logged=True))
    large = Effect("joint_scale", "joint3", {"c": 4e-4})
    small = Effect("thermal_offset", "joint2", {"c": 12e-6})
    document, points = case.document(), case.points(large, small)
    table = case.table(points) | {"temperature [degC]": case.session.temperature}
    found = case.diagnosis(table, document)
    assert beyond_geometry(found) == [("joint_scale", "joint3"), ("thermal_offset", "joint2")]
    assert found.verdict == "effects_found"
    # Noise of three coordinates, and what 25 parameters cost beside 450 of them.
    assert found.errors["extended"].rms < 1.2 * 3**0.5 * SIGMA


def test_nothing_is_found_beside_a_large_effect_where_nothing_is() -> None:
    case = SimulatedSession(604, "ur10", Plan(logged=True))
    points = case.points(Effect("joint_scale", "joint3", {"c": 8e-4}))
    table = case.table(points) | {"temperature [degC]": case.session.temperature}
    assert beyond_geometry(case.diagnosis(table)) == [("joint_scale", "joint3")]
