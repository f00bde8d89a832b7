"""Budgets of correlated sources: no line below zero, the lines sum to one, groups are those that vary together."""

from __future__ import annotations

import numpy as np
import pytest

import posture_opt as po
from posture_opt.uncertainty.budget import SHARE_TOLERANCE, budgets
from tests.helpers.stated import Sources, stated

Q6 = (0.3, -1.0, 1.2, 0.4, 0.7, 0.0)
OPPOSED = {
    "robot": {"kind": "preset", "name": "planar_2r"},
    "uncertainty": {
        "sigma": {"joint1.theta": "0.1 deg", "joint1.a": "10 mm", "joint2.a": "8 mm"},
        "correlation": [["joint1.a", "joint2.a", -0.9]],
    },
    "task": {"kind": "insert", "direction": [0, -1, 0]},
}


def test_two_lengths_that_cancel_are_one_line() -> None:
    # Both links along x: the shift is e1 + e2, its variance 100 + 64 - 2 * 0.9 * 80 = 20 mm^2; the share of joint2.a
    # alone would be (64 - 72) / 20 = -40 %.
    spread = po.propagate(po.problem_from_dict(OPPOSED), [0.0, 0.0])
    assert spread.for_task is not None
    assert {s.parameter: round(s.share, 2) for s in spread.for_task.budget}["joint2.a"] == -0.4
    lengths, angle = spread.for_task.budget_groups
    assert set(lengths.parameters) == {"joint1.a", "joint2.a"}
    assert lengths.share + angle.share == pytest.approx(1.0)
    assert lengths.share == pytest.approx(1.0, abs=1e-3)
    report = spread.report()
    assert "-40 %" not in report
    document = spread.to_json()
    assert {entry["parameter"] for entry in document["critical_budget"]} == {"joint1.theta", "joint1.a", "joint2.a"}
    assert set(document["critical_budget_groups"][0]["parameters"]) == {"joint1.a", "joint2.a"}


def test_without_correlation_every_source_has_its_line() -> None:
    plain = {**OPPOSED, "uncertainty": {"sigma": OPPOSED["uncertainty"]["sigma"]}}
    spread = po.propagate(po.problem_from_dict(plain), [0.3, 1.0])
    assert [(g.parameters, g.share) for g in spread.budget_groups] == [((s.parameter,), s.share) for s in spread.budget]


@pytest.mark.parametrize("seed", range(2))
def test_dense_covariances_have_no_line_below_zero(seed: int) -> None:
    robot = po.load_problem("insert_ur10").robot
    rng = np.random.default_rng(seed)
    names = tuple(f"{joint}.{p}" for joint in robot.joint_names for p in ("theta", "a", "d"))
    A = rng.standard_normal((len(names), 4)) * 2e-4
    sources = Sources(names, A @ A.T + 1e-10 * np.eye(len(names)))
    spread = po.propagate(stated(robot, sources), Q6)
    groups = spread.budget_groups
    assert sum(g.share for g in groups) == pytest.approx(1.0)
    assert min(g.share for g in groups) > -SHARE_TOLERANCE
    assert sorted(p for g in groups for p in g.parameters) == sorted(s.parameter for s in spread.budget)
    assert [g.share for g in groups] == sorted((g.share for g in groups), reverse=True)
    assert min(s.share for s in spread.budget) < -SHARE_TOLERANCE  # or this test would say nothing
    (own,) = budgets(spread.tool_point, spread.q, spread.axes[-1:])
    assert {s.parameter: s.share for s in own} == {s.parameter: s.share for s in spread.budget}
