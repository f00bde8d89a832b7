"""Errors that are larger from some row on: found where they are, and not where all rows scatter alike."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import yaml

import posture_opt as po
from posture_opt.calibration.start_up import scatter_change
from tests.helpers.planar_files import SHORT

ROWS = 120


def rows(**more: Any) -> po.Measurements:
    q = np.random.default_rng(0).uniform(-2, 2, (ROWS, 2))
    table = {"joint1 [rad]": q[:, 0], "joint2 [rad]": q[:, 1]}
    return po.read_measurements(table | (more or {"x [m]": q[:, 0], "y [m]": q[:, 1]}), problem())


def problem() -> po.Problem:
    return po.problem_from_dict(yaml.safe_load(SHORT))


@pytest.mark.parametrize(("times", "found"), [(3.0, True), (1 / 3, True), (1.2, False)])
def test_the_row_from_which_errors_are_of_another_size_is_found(times: float, found: bool) -> None:
    rng = np.random.default_rng(4)
    size = np.where(np.arange(ROWS) < 80, 1e-4, times * 1e-4)
    change = scatter_change(size[:, None] * rng.normal(size=(ROWS, 2)), rows())
    assert (change is not None) is found
    if change is not None:
        assert abs(change.line - 81) <= 5
        assert change.after / change.before == pytest.approx(times, rel=0.25)
        assert change.to_json()["points"] == []


def test_rows_that_scatter_alike_hardly_ever_change() -> None:
    """One in a thousand is expected; heavy tails make it no worse."""
    rng, data = np.random.default_rng(6), rows()
    sets = [rng.standard_t(5, (ROWS, 2)) if i % 2 else rng.normal(size=(ROWS, 2)) for i in range(200)]
    assert sum(scatter_change(1e-4 * e, data) is not None for e in sets) <= 2
