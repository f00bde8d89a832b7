"""A smooth error over the room is one of the instrument as far as the instrument can err, and no further."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import posture_opt as po
from tests.helpers.planar_2r import position
from tests.helpers.planar_files import PROBLEM, write

SIGMA = 2e-5  # m, stated
NOISE = 1e-5  # m


def diagnosed(folder: Path, size: float, stated: str = "0.02 mm") -> po.Diagnosis:
    """Points off by a quadratic function of where they are, by so much RMS beyond what is linear [m]."""
    rng = np.random.default_rng(17)
    q = rng.uniform(-2.5, 2.5, (120, 2))
    p = position(q)
    field = np.stack([p[:, 0] * p[:, 1], p[:, 0] ** 2 - 0.5 * p[:, 1] ** 2], axis=1)
    plane = np.column_stack([np.ones(len(p)), p])
    bent = field - plane @ np.linalg.lstsq(plane, field, rcond=None)[0]
    points = p + field * size / np.sqrt(np.mean(bent**2))
    write(folder / "data.csv", q, points + rng.normal(0, NOISE, points.shape))
    problem = po.problem_from_dict({**PROBLEM, "uncertainty": {"measurement": {"position": stated}}})
    return po.diagnose(problem, po.read_measurements(folder / "data.csv", problem), flips=99, plan=False)


def kinds(found: po.Diagnosis) -> set[str]:
    effects = found.to_json()["effects"]
    return {cause["kind"] for e in effects for cause in (e, *e["confounded_with"])}


@pytest.mark.parametrize("times", [1.5, 25.0])
def test_a_field_is_the_instruments_up_to_three_times_what_is_stated(times: float, tmp_path: Path) -> None:
    found = diagnosed(tmp_path, times * SIGMA)
    assert ("instrument_field" in kinds(found)) is (times < 3)
    assert all(e.kind != "instrument_field" for e in found.fitted_arm.effects)
    if times > 3:
        assert found.verdict == "unexplained"
        assert "instrument_field" not in {e["kind"] for e in found.to_json()["delivered"]["left_out"]}


def test_an_instrument_that_is_not_stated_may_err_by_anything(tmp_path: Path) -> None:
    assert "instrument_field" in kinds(diagnosed(tmp_path, 25 * SIGMA, "0.5 mm"))
