"""A hidden backlash is named from touched plates and from lengths of a wire, of a simulator of its own."""

from __future__ import annotations

import numpy as np
import pytest

import posture_opt as po
from tests.helpers.instruments import TrueArm, distance_table, level_table, plane_table
from tests.helpers.pairs import tool_at, ur10_problem
from tests.helpers.planar_2r import position
from tests.helpers.planar_files import PROBLEM, planar_rows
from tests.helpers.variants import conformance

WIDTH = 6e-4  # rad


@pytest.mark.long
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
    given = ur10_problem({kind: "0.03 mrad" if kind == "level" else "0.02 mm"}, tool_at("0 m", "0 m", "0.1 m"))
    found = po.diagnose(given, po.read_measurements(table, given), flips=99, plan=False)
    first = found.effects[0]
    assert (first.kind, first.target) == ("backlash", "elbow")
    value, std, _ = first.estimate["width"]
    assert abs(value - WIDTH) < 3 * std < 0.15 * WIDTH
    assert found.verdict == "effects_found"


# --- A smooth error over the room is one of the instrument as far as the instrument can err, and no further -----------

SIGMA = 2e-5  # m, stated
NOISE = 1e-5  # m


def diagnosed(size: float, stated: str = "0.02 mm") -> po.Diagnosis:
    """Points off by a quadratic function of where they are, by so much RMS beyond what is linear [m]."""
    rng = np.random.default_rng(17)
    q = rng.uniform(-2.5, 2.5, (120, 2))
    p = position(q)
    field = np.stack([p[:, 0] * p[:, 1], p[:, 0] ** 2 - 0.5 * p[:, 1] ** 2], axis=1)
    plane = np.column_stack([np.ones(len(p)), p])
    bent = field - plane @ np.linalg.lstsq(plane, field, rcond=None)[0]
    points = p + field * size / np.sqrt(np.mean(bent**2))
    problem = {**PROBLEM, "uncertainty": {"measurement": {"position": stated}}}
    return po.diagnose(*planar_rows(q, points + rng.normal(0, NOISE, points.shape), problem), flips=99, plan=False)


def kinds(found: po.Diagnosis) -> set[str]:
    effects = found.to_json()["effects"]
    return {cause["kind"] for e in effects for cause in (e, *e["confounded_with"])}


@pytest.mark.parametrize("times", [1.5, 25.0])
def test_a_field_is_the_instruments_up_to_three_times_what_is_stated(times: float) -> None:
    found = diagnosed(times * SIGMA)
    assert ("instrument_field" in kinds(found)) is (times < 3)
    assert all(e.kind != "instrument_field" for e in found.fitted_arm.effects)
    if times > 3:
        assert found.verdict == "unexplained"
        assert "instrument_field" not in {e["kind"] for e in found.to_json()["delivered"]["left_out"]}


def test_an_instrument_that_is_not_stated_may_err_by_anything() -> None:
    assert "instrument_field" in kinds(diagnosed(25 * SIGMA, "0.5 mm"))


# --- Three reflectors that sag together under a heavy payload: their rows stay, and the compliance is found -----------
