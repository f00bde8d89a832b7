"""A map of accuracy is compared with positions: rows of another instrument are refused."""

from __future__ import annotations

import numpy as np
import pytest

import posture_opt as po
from posture_opt.validation.accuracy_map import measured_errors
from tests.helpers.instruments import TrueArm, distance_table


def test_distances_are_not_set_against_a_map() -> None:
    problem = po.problem_from_dict({"robot": {"kind": "preset", "name": "ur10"}})
    data = po.read_measurements(distance_table(TrueArm(), np.random.default_rng(0), 2, 0.0), problem)
    with pytest.raises(po.errors.InputError, match="a map predicts positions, and these rows are distances"):
        measured_errors(problem, problem, data, None, np.zeros((0, 3, 3)), None)  # type: ignore[arg-type]
