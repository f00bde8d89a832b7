"""Robots of one type that touched planes: nothing says how large each of them is."""

from __future__ import annotations

import numpy as np
import pytest

import posture_opt as po
from tests.helpers.instruments import TrueArm, plane_table


def test_planes_do_not_say_how_sizes_vary() -> None:
    rng = np.random.default_rng(0)
    tables = [plane_table(TrueArm(), rng, 2, 0.0) for _ in range(3)]
    table = {name: np.concatenate([one[name] for one in tables]) for name in tables[0]}
    table["robot"] = np.repeat(["a", "b", "c"], 6)
    problem = po.problem_from_dict({"robot": {"kind": "preset", "name": "ur10"}})
    with pytest.raises(
        po.errors.InsufficientDataError, match="touches of planes alone do not determine the size of a robot"
    ):
        po.calibrate_batch(problem, po.read_measurements(table, problem))
