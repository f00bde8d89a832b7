"""Several features on one workpiece, against a chain product in NumPy, single solves and random placements."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

import posture_opt as po
from posture_opt.files import problems_folder
from posture_opt.problem.load import load_problem
from posture_opt.problem.problem import Problem
from posture_opt.selection.select_posture import planned_posture
from posture_opt.selection.stations.features_failure import turned_feasible
from tests.helpers import factors
from tests.helpers.changes import changed
from tests.helpers.variants import conformance

FILES = ("insert_ur10_plate", "insert_panda_block", "insert_scara_tray")

SHARED = {
    "sigma": {"joint1.theta": "0.1 mrad", "joint2.theta": "0.1 mrad", "joint3.d": "10 um"},
    "scatter": {"joint1.theta": "0.05 mrad", "joint2.theta": "0.05 mrad"},
}


@cache
def solved(name: str) -> tuple[Problem, po.Solution]:
    """A problem file, or one with another aim, and its answer."""
    file, _, aim = name.partition(", ")
    problem = load_problem(problems_folder() / f"{file}.yaml")
    if aim == "success":
        document = problem.to_dict()
        two = {**document["task"], "features": document["task"]["features"][:2], "clearance": "40 um"}
        problem = po.problem_from_dict({**document, "uncertainty": SHARED, "task": two})
    found = po.select_posture(problem.with_task(combine=aim) if aim else problem)
    assert len(found.stations) == len(found.problem.task.features)
    return problem, found


def placed(w: np.ndarray, point: Any) -> np.ndarray:
    c, s = math.cos(w[3]), math.sin(w[3])
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ np.array(point) + w[:3]


def vectorised(robot: Any, q: np.ndarray, parameters: dict[str, np.ndarray], n: int) -> np.ndarray:
    """(n, 3) tool points by a chain product in NumPy, errors drawn for all samples at once."""
    T = np.tile(np.eye(4), (n, 1, 1))
    for f in robot.factors:
        value = f.nominal + parameters.get(f.parameter, 0.0) + (q[f.joint] if f.joint is not None else 0.0)
        step = np.tile(np.eye(4), (n, 1, 1))
        if f.kind == "translate":
            step[:, f.axis, 3] = value
        else:
            i, j = (f.axis + 1) % 3, (f.axis + 2) % 3
            step[:, i, i] = step[:, j, j] = np.cos(value)
            step[:, j, i], step[:, i, j] = np.sin(value), -np.sin(value)
        T = T @ step
    return T[:, :3, 3]


@pytest.mark.parametrize(
    "name", conformance([*FILES, "insert_panda_block, worst"], ["insert_panda_block, worst", "insert_scara_tray"])
)
def test_every_feature_is_reached_where_the_workpiece_is(name: str) -> None:
    problem, found = solved(name)
    w, task = found.w, problem.task
    assert found.status == "optimal"
    assert np.all(w >= np.array(task.workpiece.lower))
    assert np.all(w <= np.array(task.workpiece.upper))
    for feature, station in zip(task.features, found.stations, strict=True):
        T = factors.pose(problem.robot, station.q)
        np.testing.assert_allclose(T[:3, 3], placed(w, feature.position), atol=1e-7)
        d = placed(w, feature.direction or task.direction) - w[:3]
        assert math.acos(min(1.0, float(T[:3, :3] @ task.tool_axis @ d) / np.linalg.norm(d))) < 2e-6
        assert np.all(station.q >= np.array(problem.robot.lower) - 1e-12)
        assert np.all(station.q <= np.array(problem.robot.upper) + 1e-12)
        J = factors.parameter_jacobian(problem.robot, station.q, problem.sources.names)
        C = station.basis.T @ J @ problem.sources.covariance @ J.T @ station.basis
        assert station.critical.sigma_max == pytest.approx(math.sqrt(np.linalg.eigvalsh(C)[-1]), rel=1e-4)


@pytest.mark.long
@pytest.mark.parametrize("name", conformance(["insert_ur10_plate", "insert_scara_tray"], ["insert_scara_tray"]))
def test_no_random_placement_is_better(name: str) -> None:
    """Each feature on its own at placements that the search did not draw, neighbours of the best one among them."""
    problem, found = solved(name)
    rng = np.random.default_rng(11)
    box = found.placement
    W = np.vstack([rng.uniform(box.lower, box.upper, (12, 4)), box.near(found.w, 0.05, 12, rng)])
    first = problem.task.features[0]
    selector = po.PostureSelector(problem.with_task(position=[f"{v} m" for v in first.position]), compiled=False)
    for w in W:
        try:
            sigma = [
                selector.solve(position=placed(w, f.position), starts=16).critical.sigma_max
                for f in problem.task.features
            ]
        except po.errors.NoSolutionError:
            continue
        value = np.mean(sigma) if problem.task.combine == "mean" else np.max(sigma)
        assert value >= found.sigma * (1 - 1e-4)


@pytest.mark.conformance  # always: test_stations_problem.py
def test_fixed_placement_gives_the_single_solves() -> None:
    problem, found = solved("insert_ur10_plate")
    w = {"x": "0.7 m", "y": "-0.1 m", "z": "50 mm", "yaw": "30 deg"}
    fixed = po.select_posture(problem.with_task(workpiece=w))
    at = np.array([0.7, -0.1, 0.05, math.radians(30)])
    for feature, station in zip(problem.task.features, fixed.stations, strict=True):
        point = [f"{v} m" for v in placed(at, feature.position)]
        alone = po.select_posture(problem.with_task(position=point))
        assert station.critical.sigma_max == pytest.approx(alone.critical.sigma_max, rel=1e-4)
    assert fixed.centre is None
    assert fixed.typical is None
    assert fixed.sigma > found.sigma


@pytest.mark.conformance
def test_document_holds_what_the_interface_says() -> None:
    problem, found = solved("insert_scara_tray, success")
    document = found.to_json()
    assert set(document["workpiece"]) == {"x", "y", "z", "yaw"}
    assert [feature["name"] for feature in document["features"]] == [f.name for f in problem.task.features]
    for feature in document["features"]:
        assert {"posture", "tool", "critical", "covariance", "success_probability"} <= set(feature)
    assert document["posture"] == document["features"][0]["posture"]
    worst = max(document["features"], key=lambda feature: feature["critical"]["sigma_max"])
    assert worst is not document["features"][0]
    assert document["worst_station"] == found.worst_station == worst["name"]
    assert document["sigma_max"] == found.sigma_max == worst["critical"]["sigma_max"]
    for key in ("critical", "covariance", "success_probability"):
        assert document[key] == worst[key]
    np.testing.assert_array_equal(found.covariance, worst["covariance"])
    assert 0 < document["success_all"] < 1
    assert document["success_all_standard_error"] < 1e-3
    assert document["clearance"] is None or document["clearance"]["distance"] > 0


@pytest.mark.long
def test_probability_of_all_against_the_whole_chain_sampled() -> None:
    """Errors under sigma are one draw for all pins, scatter a new one each; nothing is linear here."""
    problem, found = solved("insert_scara_tray, success")
    n, rng, names = 60_000, np.random.default_rng(2), problem.sources.names
    stay = rng.multivariate_normal(np.zeros(len(names)), problem.sources.constant, n)
    hit = np.ones(n, dtype=bool)
    for station in found.stations:
        errors = stay + rng.multivariate_normal(np.zeros(len(names)), problem.sources.scatter, n)
        points = vectorised(problem.robot, station.q, dict(zip(names, errors.T, strict=True)), n)
        nominal = factors.pose(problem.robot, station.q)[:3, 3]
        hit &= np.linalg.norm((points - nominal) @ station.basis, axis=1) <= station.target.clearance
    error = math.hypot(math.sqrt(hit.mean() * (1 - hit.mean()) / n), found.success.standard_error)
    assert found.success.probability == pytest.approx(hit.mean(), abs=4 * error)
    assert found.success.probability > found.success.product


@pytest.mark.long
@pytest.mark.parametrize("combine", conformance(["worst", "mean"], ["worst"]))
def test_success_is_not_beaten_by_another_aim(combine: str) -> None:
    problem, found = solved("insert_scara_tray, success")
    other = po.select_posture(problem.with_task(combine=combine))
    assert found.success.probability >= other.success.probability - 3 * found.success.standard_error


def plate(robot: str = "ur10", features: Any = None, **task: Any) -> Problem:
    holes = features or [
        {"name": "left", "position": ["0 m", "0 m", "0 m"]},
        {"name": "right", "position": ["0.2 m", "0 m", "0 m"]},
    ]
    return po.problem_from_dict(
        {"robot": {"kind": "preset", "name": robot}, "task": {"kind": "insert", "features": holes, **task}}
    )


@pytest.mark.long
def test_failure_names_the_feature_and_a_move_that_suffices() -> None:
    stands = {"x": ["1.18 m", "1.3 m"], "y": ["-0.1 m", "0.1 m"], "z": "0.1 m"}
    problem = plate(workpiece=stands)
    with pytest.raises(po.errors.NoSolutionError) as error:
        po.select_posture(problem)
    found = error.value.solution
    assert found.status == "infeasible"
    assert found.reasons[0].message.startswith("right: the target is out of reach")
    assert found.statistics.seconds < 30
    assert found.to_json()["features"][0]["name"] == "right"
    (relaxation,) = found.relaxations
    assert relaxation.change.startswith("let the workpiece stand at (")
    assert 0.05 < relaxation.cost < 0.1  # 71 mm of reach are missing
    assert po.select_posture(changed(problem, relaxation)).status != "infeasible"


@pytest.mark.long
def test_a_change_does_for_every_feature_that_fails() -> None:
    """Two holes at two heights: the lower one lacks more, and the change that it needs is offered."""
    holes = [
        {"name": "upper", "position": ["0 m", "0 m", "0 mm"]},
        {"name": "lower", "position": ["-40 mm", "0 m", "-30 mm"]},
    ]
    bound = [{"kind": "link_height", "at_least": "20 mm"}]
    stands = {"x": "0.3 m", "y": "0.1 m", "z": "-20 mm"}
    problem = plate("scara", holes, workpiece=stands, subject_to=bound)
    with pytest.raises(po.errors.NoSolutionError) as error:
        po.select_posture(problem)
    (relaxation,) = (r for r in error.value.solution.relaxations if r.change.startswith("set at_least"))
    assert relaxation.to_json()["set"] == {"task.subject_to.0.at_least": "-50 mm"}
    assert po.select_posture(changed(problem, relaxation)).status != "infeasible"


@pytest.mark.conformance
def test_turning_the_part_is_told_where_that_suffices() -> None:
    stands = {"x": "0.9 m", "y": "0 m", "z": "0.1 m"}
    problem = plate(workpiece=stands, features=[{"name": "far", "position": ["0.5 m", "0 m", "0 m"]}])
    with pytest.raises(po.errors.NoSolutionError) as error:
        po.select_posture(problem)
    turned = turned_feasible(error.value.solution.placed, 0)
    assert turned is not None
    there = {**stands, "yaw": f"{turned[3]} rad"}
    assert po.select_posture(problem.with_task(workpiece=there)).status == "optimal"


BAD: list[tuple[dict[str, Any], str]] = [
    ({"features": None, "workpiece": {"x": "1 m"}}, "neither features nor a path"),
    ({"position": ["1 m", "0 m", "0 m"]}, "features and position are both given"),
    ({"workpiece": {"x": ["0.8 m", "0.4 m"]}}, "is empty"),
    ({"workpiece": {"x": ["0.8 m"]}}, "a range has two ends"),
    ({"workpiece": {"x": 0.5}}, "no unit"),
    ({"combine": "success"}, "needs a clearance, and 'left' has none"),
    ({"combine": "success", "clearance": "1 mm", "criterion": "trace"}, "makes no use of criterion"),
    ({"features": [{"name": "a", "position": ["0 m", "0 m", "0 m"]}] * 2}, "two features have the name 'a'"),
    (
        {"features": [{"name": f"{k}", "position": ["0 m", "0 m", "0 m"]} for k in range(31)]},
        "more than the 30 that are accepted",
    ),
    ({"features": None, "position": ["1 m", "0 m", "0 m"], "combine": "mean"}, "there are none"),
]


@pytest.mark.parametrize(("task", "message"), BAD, ids=[message for _, message in BAD])
def test_bad_input_is_told(task: dict[str, Any], message: str) -> None:
    data = {"kind": "insert", "features": [{"name": "left", "position": ["0 m", "0 m", "0 m"]}], **task}
    data = {key: value for key, value in data.items() if value is not None}
    with pytest.raises(po.errors.InputError, match=message):
        po.problem_from_dict({"robot": {"kind": "preset", "name": "ur10"}, "task": data})


def test_what_takes_one_target_says_so() -> None:
    problem = plate()
    for refused in (po.PostureSelector, lambda p: po.map_targets(p, counts=(3, 3))):
        with pytest.raises(po.errors.InputError, match=r"takes a task with one target.*name one target: position: \["):
            refused(problem)
    assert not problem.with_task(position=["0.6 m", "0 m", "0.1 m"]).task.features


@pytest.mark.conformance
def test_the_worst_feature_stands_for_all_where_one_posture_is_asked_for() -> None:
    problem, found = solved("insert_scara_tray")
    posture = planned_posture(problem)
    assert posture.critical.sigma_max == pytest.approx(found.sigmas.max(), rel=1e-6)
    compared = po.compare_plans({"nominal": problem, "calibrated": replace(problem, name="calibrated")})
    assert compared is not None
    chosen = compared.answered["calibrated"]
    (solution,), predicted_error = chosen.stations, chosen.judged["calibrated"].worst
    assert solution.critical.sigma_max == pytest.approx(found.sigmas.max(), rel=1e-4)
    assert predicted_error.distance < 1e-6


@pytest.mark.conformance
def test_workers_do_not_change_the_answer() -> None:
    problem, found = solved("insert_scara_tray")
    again = po.select_posture(problem, workers=2)
    np.testing.assert_array_equal(again.w, found.w)
    np.testing.assert_array_equal(again.postures, found.postures)
