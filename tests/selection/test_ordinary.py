"""The first answer is the best ordinary posture where it costs little, and the best of all stands beside it."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import posture_opt as po
from tests.helpers.said import said
from tests.helpers.variants import conformance

TARGETS: dict[str, Any] = {
    # six makers -> targets [m]
    "irb120": ((0.3, 0.3, 0.3),),
    "m10id": ((0.99, -0.156, 0.285),),
    "kr6_r900": ((0.5, 0.1, 0.2), (0.4, -0.4, 0.3)),
    "gp7": ((0.359, 0.325, -0.058),),
    "panda": ((0.5, 0.1, 0.2), (0.4, -0.3, 0.3)),
    "gen3": ((0.4, 0.1, 0.2),),
}
AXIS_DOWN = ("kr6_r900", "gen3")  # the first axis
PLACES = [(robot, place) for robot, places in TARGETS.items() for place in places]
ALWAYS = [("kr6_r900", (0.5, 0.1, 0.2)), ("gp7", (0.359, 0.325, -0.058))]


def problem(robot: str, position: Any = None, **task: Any) -> Any:
    section = {"kind": "preset", "name": robot, "tool": {"xyz": ["0 m", "0 m", "150 mm"]}}
    task |= {} if position is None else {"position": [f"{x} m" for x in position]}
    given = {"robot": section, "uncertainty": {"repeatability": "0.05 mm"}, "task": {"kind": "insert", **task}}
    return po.problem_from_dict(given)


def ordinary(robot: str, solution: po.Solution) -> bool:
    """Whether the answer is 5 degrees away from the limits and faces its target, by hand."""
    lower, upper = (np.array(ends) for ends in (solution.problem.robot.lower, solution.problem.robot.upper))
    x, y, _ = solution.spread.position
    off = math.atan2(y, x) - solution.q[0] * (-1 if robot in AXIS_DOWN else 1)
    room = min(np.min(solution.q - lower), np.min(upper - solution.q))
    return bool(math.cos(off) >= -1e-5 and room >= math.radians(5) - 1e-5)


@pytest.mark.parametrize(("robot", "position"), conformance(PLACES, ALWAYS))
def test_the_first_answer_is_ordinary_or_that_costs_more_than_the_share(robot: str, position: Any) -> None:
    selector = po.PostureSelector(problem(robot, position), compiled=False)
    best, first, insisted = (selector.solve(ordinary=share) for share in (0.0, None, 0.9))
    assert best.best_of_all is None
    assert first.sigma_max <= 1.03 * best.sigma_max * (1 + 1e-3)
    if first.best_of_all is not None:
        assert ordinary(robot, first)
        assert "elbow down" not in first.alternatives[0].configuration
        assert first.best_of_all.sigma_max == pytest.approx(best.sigma_max, rel=1e-3)
        assert first.gain_of_best == pytest.approx(1 - best.sigma_max / first.sigma_max, abs=1e-3)
        assert first.alternatives[1].posture == first.best_of_all.posture
        assert first.statistics.typical == best.statistics.typical
    elif not ordinary(robot, first):
        assert first.sigma_max == pytest.approx(best.sigma_max, rel=1e-6)
        assert insisted.best_of_all is None or insisted.sigma_max > 1.03 * best.sigma_max * (1 - 1e-3)


def test_report_and_document_name_the_best_of_all() -> None:
    solution = po.select_posture(problem("panda", (0.5, 0.1, 0.2)))
    assert said(solution).keys() >= {"selection.ordinary-posture", "selection.best-of-all"}
    assert "selection.joint-at-limit" not in said(solution)
    document = solution.to_json()["best_of_all"]
    assert document["gain"] == pytest.approx(1 - document["sigma_max"] / solution.sigma_max)
    assert document["posture"] != solution.posture
    assert {price.requirement for price in solution.prices} >= {"panda_joint2.range"}  # 5 degrees before its limit
    best = po.select_posture(problem("panda", (0.5, 0.1, 0.2), ordinary=0))
    assert best.to_json()["best_of_all"] is None
    assert "selection.joint-at-limit" in said(best)


def test_alternatives_have_one_posture_a_configuration() -> None:
    """Of a workpiece that may stand anywhere, one of each spread: turned about the first axis a posture is the same."""
    moved = po.select_posture(po.load_problem("custom_planar_2r")).alternatives
    assert [other.configuration for other in moved] == [("elbow left",), ("elbow right",)]


def test_arms_on_paper_and_margins_that_are_stated_are_left_alone() -> None:
    folded = po.select_posture(po.load_problem("insert_planar_2r"))
    assert folded.best_of_all is None
    stated = problem("panda", (0.5, 0.1, 0.2), subject_to=[{"kind": "limit_margin", "at_least": "1 deg"}])
    q, robot = po.select_posture(stated).q, stated.robot
    assert min(np.min(q - robot.lower), np.min(robot.upper - q)) == pytest.approx(math.radians(1), abs=1e-4)


@pytest.mark.parametrize(("text", "share"), [("3 %", 0.03), (0.05, 0.05), ("0", 0.0)])
def test_a_share_is_a_number_or_a_percentage(text: Any, share: float) -> None:
    assert problem("panda", ordinary=text).task.ordinary == pytest.approx(share)


@pytest.mark.parametrize("text", ["3 mm", "-1 %", "100 %", "much"])
def test_what_is_no_share_is_refused(text: str) -> None:
    with pytest.raises(po.errors.InputError, match=r"task\.ordinary.*write for example 3 %"):
        problem("panda", ordinary=text)


def test_a_share_that_would_be_ignored_is_refused() -> None:
    task = {"kind": "insert", "ordinary": "5 %", "features": [{"name": "a", "position": ["0.6 m", "0.2 m", "0.2 m"]}]}
    with pytest.raises(po.errors.InputError, match="at one target only"):
        po.problem_from_dict({"robot": {"kind": "preset", "name": "ur10"}, "task": task})
