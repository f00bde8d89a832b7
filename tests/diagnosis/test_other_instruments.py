"""A hidden backlash is named from touched plates and from lengths of a wire, of a simulator of its own."""

from __future__ import annotations

import numpy as np
import pytest

import posture_opt as po
from tests.helpers.instruments import TrueArm, distance_table, level_table, plane_table
from tests.helpers.variants import conformance

WIDTH = 6e-4  # rad
TABLES = {"plane": (plane_table, 40, 2e-5), "distance": (distance_table, 40, 2e-5), "level": (level_table, 60, 3e-5)}


@pytest.mark.parametrize("kind", conformance(("plane", "distance", "level"), ("distance",)))
def test_a_hidden_backlash_is_named(kind: str) -> None:
    rng = np.random.default_rng(1)
    arm = TrueArm.drawn(rng, backlash=(2, WIDTH))
    tables = {
        "plane": (plane_table, 40, 2e-5),
        "distance": (distance_table, 40, 2e-5),
        "level": (level_table, 60, 3e-5),
    }
    make, count, sigma = tables[kind]
    table = make(arm, rng, count, sigma)
    given = po.problem_from_dict(
        {
            "robot": {
                "kind": "preset",
                "name": "ur10",
                "tool": {"xyz": ["0 m", "0 m", "0.1 m"], "rpy": ["0 deg", "0 deg", "0 deg"], "free": True},
            },
            "uncertainty": {"measurement": {kind: "0.03 mrad" if kind == "level" else "0.02 mm"}},
        }
    )
    found = po.diagnose(given, po.read_measurements(table, given), flips=99, plan=False)
    first = found.effects[0]
    assert (first.kind, first.target) == ("backlash", "elbow")
    value, std, _ = first.estimate["width"]
    assert abs(value - WIDTH) < 3 * std < 0.15 * WIDTH
    assert found.verdict == "effects_found"
