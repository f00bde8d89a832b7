"""Several stations and one placement: the rows are those of the single stations, and the optimum is one of both."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

import posture_opt as po
from posture_opt.selection.program.task_target import TaskTarget
from posture_opt.selection.stations.stations_problem import (
    Station,
    StationFunction,
    StationsPoint,
    StationsProblem,
)

W = np.array([0.62, -0.07, 0.11, 0.8])
HOLES = np.array([[0.05, 0.02, 0.0], [-0.06, 0.03, 0.01], [0.0, -0.08, 0.02]])


def selector_of(name: str = "ur10", **task: Any) -> po.PostureSelector:
    data = {"robot": {"kind": "preset", "name": name}, "task": {"kind": "insert", **task}}
    return po.PostureSelector(
        po.problem_from_dict({**data, "task": {"position": ["0.6 m", "0 m", "0.1 m"], **data["task"]}}), compiled=False
    )


def part(selector: po.PostureSelector, scale: float = 1e-9) -> list[TaskTarget]:
    return [replace(selector.target.with_position(hole), scale=scale) for hole in HOLES]


@pytest.mark.parametrize("task", [{}, {"tilt": "10 deg"}, {"direction": [0.3, 0.1, -1]}])
def test_station_is_the_single_problem_at_the_moved_target(task: dict[str, Any]) -> None:
    selector = selector_of(**task)
    engine = selector.engine(selector.target)
    station = StationFunction(engine.optimisation_problem)
    for target in part(selector):
        Q = engine.ik.random_postures(5, np.random.default_rng(3))
        objective, violation, _, _ = engine.screen(Q, target.moved(W).parameters)
        for q, f, worst in zip(Q, objective[:, 0], violation[:, 0], strict=True):
            main, extra, g = (np.asarray(v).ravel() for v in station.call(W, q, target.parameters))
            assert main + extra == pytest.approx(f, rel=1e-9)
            beyond = np.maximum(station.ends[0] - g, g - station.ends[1])
            assert np.max(beyond) == pytest.approx(worst, rel=1e-9)


def test_free_placement_of_one_hole_is_the_best_radius() -> None:
    """Joint 1 alone uncertain: the spread is its angle times the distance from its axis, so the nearest edge wins."""
    problem = po.problem_from_dict(
        {
            "robot": {"kind": "preset", "name": "ur10"},
            "uncertainty": {"sigma": {"shoulder_pan.theta": "0.02 deg"}},
            "task": {"kind": "insert", "position": ["0.8 m", "0 m", "0.1 m"]},
        }
    )
    selector = po.PostureSelector(problem, compiled=False)
    engine = selector.engine(selector.target)
    target = replace(selector.target.with_position(np.zeros(3)), scale=1e-8)
    start = selector.solve()
    lower, upper = np.array([0.5, 0.1, 0.1, 0.0]), np.array([1.0, 0.3, 0.1, 0.0])
    joint = StationsProblem((Station(engine.optimisation_problem, target),), lower, upper)
    found = joint.solve(StationsPoint(np.array([0.8, 0.1, 0.1, 0.0]), start.q[None]))
    nearest = minimize_scalar(lambda y: np.hypot(0.5, y), bounds=(0.1, 0.3), method="bounded").fun
    assert found.point.w == pytest.approx([0.5, 0.1, 0.1, 0.0], abs=1e-6)
    assert np.sqrt(found.objective * 1e-8) == pytest.approx(np.radians(0.02) * nearest, rel=1e-4)
