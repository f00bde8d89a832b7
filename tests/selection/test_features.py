"""Several features on one workpiece, against single solves, placements tried one by one and drawn errors."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import pytest

import posture_opt as po
from posture_opt.files import problems_folder
from posture_opt.problem.load import load_problem
from posture_opt.problem.problem import Problem
from posture_opt.selection.answer.placement import best_order, moves
from tests.helpers import factors
from tests.helpers.changes import changed
from tests.helpers.variants import conformance

FILES = ("insert_ur10_plate", "insert_panda_block", "insert_scara_tray")


@cache
def solved(name: str) -> tuple[Problem, po.Solution]:
    """A problem file, or one with another aim, and its answer."""
    file, _, aim = name.partition(", ")
    problem = load_problem(problems_folder() / f"{file}.yaml")
    found = po.select_posture(problem.with_task(combine=aim) if aim else problem)
    assert len(found.stations) == len(found.problem.task.features)
    return problem, found


def placed(w: np.ndarray, point: Any) -> np.ndarray:
    c, s = math.cos(w[3]), math.sin(w[3])
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ np.array(point) + w[:3]


@pytest.mark.parametrize("name", conformance([*FILES, "insert_panda_block, worst"], ["insert_scara_tray"]))
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
def test_no_random_placement_is_better() -> None:
    """Each feature on its own at placements that the search did not draw, neighbours of the best one among them."""
    problem, found = solved("insert_scara_tray")
    rng = np.random.default_rng(11)
    box = found.placement
    W = np.vstack([rng.uniform(box.lower, box.upper, (8, 4)), box.near(found.w, 0.05, 8, rng)])
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


def test_fixed_placement_gives_the_single_solves() -> None:
    problem, found = solved("insert_scara_tray")
    w = {"x": "0.2 m", "y": "-0.1 m", "z": "-80 mm", "yaw": "30 deg"}
    fixed = po.select_posture(problem.with_task(workpiece=w))
    at = np.array([0.2, -0.1, -0.08, math.radians(30)])
    for feature, station in zip(problem.task.features, fixed.stations, strict=True):
        point = [f"{v} m" for v in placed(at, feature.position)]
        alone = po.select_posture(problem.with_task(position=point))
        assert station.critical.sigma_max == pytest.approx(alone.critical.sigma_max, rel=1e-4)
    assert fixed.centre is None
    assert fixed.typical is None
    assert fixed.sigma > found.sigma


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


UR10 = po.problem_from_dict({"robot": {"kind": "preset", "name": "ur10"}}).robot


@pytest.mark.parametrize("seed", range(2))
def test_no_order_is_shorter(seed: int) -> None:
    Q = np.random.default_rng(seed).uniform(-2, 2, (7, 6))
    D = moves(UR10, Q)
    shortest = min(
        sum(D[a, b] for a, b in itertools.pairwise(order)) for order in itertools.permutations(range(len(Q)))
    )
    found = best_order(UR10, Q)
    assert found.travel <= shortest * (1 + 1e-3)  # as listed, where that is as good
    assert sorted(found.order) == list(range(7))
    assert found.exact


def test_exchanges_find_the_way_along_a_line() -> None:
    order = np.random.default_rng(1).permutation(20)
    Q = np.zeros((20, 6))
    Q[:, 2] = 0.1 * order
    found = best_order(UR10, Q)
    assert found.travel == pytest.approx(1.9)
    assert found.as_listed > found.travel
    assert not found.exact


DRAWS = 20_000
LINKS = 0.22, 0.13  # m, of the preset
LIMITS = math.radians(140), math.radians(142)
MIXED_ELBOWS = {"joint1.theta": 0.2e-3, "joint2.theta": 0.2e-3, "joint1.a": 20e-6, "joint2.a": 30e-6,
                "base.x": 20e-6, "base.yaw": 0.1e-3}  # fmt: skip


def scara(holes: list[list[float]], workpiece: dict[str, Any], clearance: float, stays: dict[str, float],
          scatter: dict[str, float]) -> po.Problem:  # fmt: skip
    units = {name: "m" if name.endswith((".a", ".x")) else "rad" for name in {**stays, **scatter}}
    features = [{"name": f"{k}", "position": [f"{v} m" for v in (*hole, 0.0)]} for k, hole in enumerate(holes)]
    return po.problem_from_dict(
        {
            "robot": {"kind": "preset", "name": "scara"}, "cell": "none",
            "uncertainty": {
                "sigma": {name: f"{v} {units[name]}" for name, v in stays.items()},
                "scatter": {name: f"{v} {units[name]}" for name, v in scatter.items()},
            },
            "task": {
                "kind": "insert", "clearance": f"{clearance} m", "combine": "success", "features": features,
                "workpiece": {"z": "-80 mm", **workpiece},
            },
        }
    )  # fmt: skip


@dataclass(frozen=True)
class Counted:
    """P(all) by counting, for postures given as elbows at holes of a workpiece at (x, y, yaw)."""

    holes: np.ndarray
    clearance: float
    stays: dict[str, np.ndarray]
    scatter: list[dict[str, np.ndarray]]

    @classmethod
    def of(cls, holes: Any, clearance: float, stays: dict[str, float], scatter: dict[str, float]) -> Counted:
        rng = np.random.default_rng(41)
        drawn = [{name: v * rng.standard_normal(DRAWS) for name, v in scatter.items()} for _ in holes]
        kept = {name: v * rng.standard_normal(DRAWS) for name, v in stays.items()}
        return cls(np.array(holes), clearance, kept, drawn)

    def points(self, q: np.ndarray, errors: dict[str, np.ndarray]) -> np.ndarray:
        (a1, a2), e = LINKS, dict.fromkeys(("base.x", "base.yaw", "joint1.a", "joint2.a"), 0.0) | errors
        first = e["base.yaw"] + q[0] + e.get("joint1.theta", 0.0)
        second = first + q[1] + e.get("joint2.theta", 0.0)
        x = e["base.x"] + (a1 + e["joint1.a"]) * np.cos(first) + (a2 + e["joint2.a"]) * np.cos(second)
        return np.array([x, (a1 + e["joint1.a"]) * np.sin(first) + (a2 + e["joint2.a"]) * np.sin(second)])

    def hit(self, k: int, q: np.ndarray) -> np.ndarray:
        names = {*self.stays, *self.scatter[k]}
        errors = {name: self.stays.get(name, 0.0) + self.scatter[k].get(name, 0.0) for name in names}
        off = self.points(q, errors) - np.reshape(self.points(q, {}), (2, 1))
        return np.hypot(*off) <= self.clearance

    def elbows(self, point: np.ndarray) -> list[np.ndarray]:
        (a1, a2), c = LINKS, (point @ point - LINKS[0] ** 2 - LINKS[1] ** 2) / (2 * LINKS[0] * LINKS[1])
        if abs(c) > 1:
            return []
        found = []
        for q2 in (math.acos(c), -math.acos(c)):
            q1 = math.atan2(point[1], point[0]) - math.atan2(a2 * math.sin(q2), a1 + a2 * math.cos(q2))
            q1 = math.remainder(q1, 2 * math.pi)
            if abs(q1) <= LIMITS[0] and abs(q2) <= LIMITS[1]:
                found.append(np.array([q1, q2]))
        return found

    def best(self, x: float, y: float, yaw: float) -> float:
        """The best combination of elbows there, zero where a hole is out of reach."""
        turn = np.array([[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]])
        hits = [[self.hit(k, q) for q in self.elbows(turn @ hole + (x, y))] for k, hole in enumerate(self.holes)]
        return max((np.logical_and.reduce(one).mean() for one in itertools.product(*hits)), default=0.0)

    def of_answer(self, found: po.Solution) -> float:
        return float(np.logical_and.reduce([self.hit(k, q) for k, q in enumerate(found.postures)]).mean())


def test_elbows_are_alike_where_that_is_what_succeeds() -> None:
    holes = [[0.03, 0.02], [-0.03, 0.02], [0.03, -0.02], [-0.03, -0.02]]
    problem = scara(holes, {"x": "0.2 m", "y": "0 m"}, 60e-6, MIXED_ELBOWS, {})
    found = po.select_posture(problem)
    counted = Counted.of(holes, 60e-6, MIXED_ELBOWS, {})
    best, error = counted.best(0.2, 0.0, 0.0), 0.5 / math.sqrt(DRAWS)
    assert counted.of_answer(found) > best - 4 * error
    assert found.success.probability == pytest.approx(best, abs=4 * error)
    assert len(set(np.sign(found.postures[:, 1]))) == 1
    assert found.success.probability > found.success.product + 0.3


@pytest.mark.conformance  # always: one elbow for all, above
def test_no_placement_and_no_elbows_succeed_more_often() -> None:
    holes, scatter = [[0.06, 0.04], [-0.05, 0.03], [0.02, -0.06]], {"joint1.theta": 0.05e-3, "joint2.theta": 0.1e-3}
    ranges = {"x": ["0.12 m", "0.24 m"], "y": "0.03 m", "yaw": ["-180 deg", "180 deg"]}
    found = po.select_posture(scara(holes, ranges, 70e-6, MIXED_ELBOWS, scatter))
    counted, error = Counted.of(holes, 70e-6, MIXED_ELBOWS, scatter), 0.5 / math.sqrt(DRAWS)
    mine = counted.of_answer(found)
    assert found.success.probability == pytest.approx(mine, abs=4 * error)
    rng = np.random.default_rng(5)
    far = np.column_stack([rng.uniform(0.12, 0.24, 60), rng.uniform(-math.pi, math.pi, 60)])
    near = found.w[[0, 3]] + rng.uniform(-1, 1, (20, 2)) * (0.01, 0.2)
    near[:, 0] = np.clip(near[:, 0], 0.12, 0.24)
    assert max(counted.best(x, 0.03, yaw) for x, yaw in np.vstack([far, near])) < mine + 4 * error
