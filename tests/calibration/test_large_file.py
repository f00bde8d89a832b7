"""Very many rows: thinned, said in a field and in words, the rest predicted as it is by hand."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import posture_opt as po
from tests.helpers.free_arms import BASE, SIX, TOOL, hidden_errors, problem_of, rows, simulated_points

COUNT, USED = 900, 150


@pytest.fixture(scope="module")
def large() -> tuple[Any, Any]:
    rng = np.random.default_rng(5)
    problem = problem_of(SIX)
    q = rng.uniform(-2.5, 2.5, (COUNT, 6))
    data = rows(problem, q, simulated_points(SIX, q, BASE, TOOL, hidden_errors(SIX, rng, ("j2",))))
    return problem, replace(data, position=data.position + rng.normal(0, 2e-5, (COUNT, 3)))


def test_a_calibration_says_what_it_used_and_predicts_the_rest(large: Any) -> None:
    problem, data = large
    found = po.calibrate(problem, data, most_rows=USED, plan=False)
    told = found.to_json()["thinned"]
    assert told["rows"] == COUNT
    assert told["rows_used"] + told["rows_left_out"] == COUNT
    assert abs(told["rows_used"] - USED) <= 2
    rest = found.large.thinning.rest  # type: ignore[union-attr]
    by_hand = po.calibrate(problem, found.request.data, test=data.take(rest), plan=False).test
    assert told["left_out"]["calibrated"]["rms"] == pytest.approx(by_hand.models["calibrated"].rms, rel=1e-9)  # type: ignore[union-attr]
    # Noise of 20 µm a coordinate, and what 150 rows leave uncertain of some thirty parameters.
    assert told["left_out"]["calibrated"]["rms"] == pytest.approx(2e-5 * 3**0.5, rel=0.1)
    assert told["fit_uncertainty_rms"] == pytest.approx(2e-5 * (found.fit.directions.shape[1] / USED) ** 0.5, rel=0.2)
    assert f"{told['rows_used']} of {COUNT} rows were fitted" in " ".join(found.report().split())


def test_all_rows_are_used_where_they_are_not_too_many(large: Any) -> None:
    problem, data = large
    found = po.calibrate(problem, data.take(np.arange(USED)), plan=False)
    assert found.large is None
    assert "thinned" not in found.to_json()


def test_a_diagnosis_says_what_it_used_and_predicts_the_rest(large: Any) -> None:
    problem, data = large
    found = po.diagnose(problem, data, most_rows=USED, flips=99, plan=False)
    told = found.to_json()["thinned"]
    assert told["rows"] == COUNT
    assert abs(told["rows_used"] - USED) <= 2
    assert told["left_out"]["extended"]["rms"] <= told["left_out"]["nominal"]["rms"]
    assert f"{told['rows_used']} of {COUNT} rows were fitted" in " ".join(found.report().split())
