"""Plans for plates and wires: postures at which their places can be measured, judged by a simulator of its own."""

from __future__ import annotations

import numpy as np
import pytest

import posture_opt as po
from tests.helpers.instruments import ANCHORS, PLANES, TrueArm, distance_table, plane_table

SIGMA = 2e-5


def problem(kind: str) -> po.Problem:
    tool = {"xyz": ["30 mm", "-20 mm", "120 mm"], "rpy": ["0 deg", "0 deg", "0 deg"], "free": True}
    text = {"robot": {"kind": "preset", "name": "ur10", "tool": tool}}
    return po.problem_from_dict({**text, "uncertainty": {"measurement": {kind: "0.02 mm"}}})


def test_planned_lengths_are_within_the_stroke_that_was_used() -> None:
    rng = np.random.default_rng(31)
    arm, given = TrueArm.drawn(rng), problem("distance")
    data = po.read_measurements(distance_table(arm, rng, 15, SIGMA), given)
    plan = po.plan_measurements(given, 8, given=data, candidates=60)
    code = np.array([int(name.removeprefix("bar")) for name in plan.places])
    length = np.linalg.norm(arm.point(plan.q) - ANCHORS[code], axis=1)
    for k in set(code):
        used = data.reading[data.point == data.point_names.index(f"bar{k}"), 0]
        assert np.all(length[code == k] > used.min() - 5e-3)
        assert np.all(length[code == k] < used.max() + 5e-3)
    assert plan.gain > 1
    header, first = plan.to_csv().splitlines()[:2]
    assert header.endswith((",anchor", ", anchor"))
    assert first.rpartition(",")[2].strip() == plan.places[0]
    assert [one["place"] for one in plan.to_json()["postures"]] == list(plan.places)


@pytest.mark.conformance
def test_planned_touches_are_on_the_plates_where_they_were_touched() -> None:
    rng = np.random.default_rng(32)
    arm, given = TrueArm.drawn(rng), problem("plane")
    data = po.read_measurements(plane_table(arm, rng, 20, SIGMA, 0.0), given)
    plan = po.plan_measurements(given, 10, given=data, candidates=200)
    points, touched = arm.point(plan.q), arm.point(data.q)
    for k, (normal, distance) in enumerate(PLANES):
        own = np.array([name == f"plate{k}" for name in plan.places])
        assert np.all(np.abs(points[own] @ normal - distance) < 2e-3)  # 0.01 deg of rounding, and what the fit errs
        before = touched[data.point == data.point_names.index(f"plate{k}")]
        far = np.linalg.norm(points[own][:, None] - before[None], axis=-1).min(axis=1, initial=np.inf)
        assert np.all(far < 0.6)
    # With as many new touches there as planned, the arm is known better than with random ones.
    assert plan.gain > 1
