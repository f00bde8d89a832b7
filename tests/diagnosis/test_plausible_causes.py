"""A cause of a size that no arm has stays a candidate, and is worded as what the errors look like."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import posture_opt as po
from tests.helpers.planar_2r import position
from tests.helpers.planar_files import planar_rows


def diagnosed(expansion: float) -> po.Diagnosis:
    """An arm whose first link expands by so much a kelvin."""
    rng = np.random.default_rng(3)
    q = rng.uniform(-2.5, 2.5, (80, 2))
    warm = rng.uniform(15, 30, len(q))
    points = position(q, (1 + expansion * (warm - 20), 1.0))
    rows = planar_rows(q, points + rng.normal(0, 2e-5, points.shape), temperature=("degC", warm))
    return po.diagnose(*rows, flips=99, plan=False)


def entry(found: po.Diagnosis) -> dict[str, Any]:
    return next(e for e in found.to_json()["effects"] if e["kind"] == "thermal_growth")


@pytest.mark.parametrize(("expansion", "plausible"), [(23e-6, True), (-250e-6, False)])
def test_a_size_that_no_arm_has_is_worded_as_what_it_looks_like(expansion: float, plausible: bool) -> None:
    found = diagnosed(expansion)
    one = entry(found)
    assert (one["target"], one["plausible"]) == ("joint1.a", plausible)
    assert one["estimate"]["expansion"]["value"] == pytest.approx(expansion, abs=3e-6)
    assert one["plausible_range"]["low"] == 5e-6
    assert one["plausible_range"]["source"]
    text = " ".join(found.report().split())
    if plausible:
        assert one["would_need"] is None
        assert "joint1.a expands with temperature" in text
        assert "looks like" not in text
    else:
        assert "expands as no metal" in one["would_need"]
        assert "an error that looks like thermal growth of joint1.a" in text
        assert "joint1.a expands" not in text
