"""What to measure next: what a plan promises is what calibrations of simulated arms then find."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest

import posture_opt as po
from tests.helpers import coal_distance
from tests.helpers.capsules import in_the_world
from tests.helpers.simulated_arm import DEG, SimulatedArm, shift, turn

# A 6R arm with a spherical wrist, two of its axes parallel.
TABLE = (
    ("j1", "revolute", 0.0, 0.40, 0.10, np.pi / 2), ("j2", "revolute", 0.0, 0.0, 0.50, 0.0),
    ("j3", "revolute", 0.0, 0.0, 0.05, np.pi / 2), ("j4", "revolute", 0.0, 0.45, 0.0, -np.pi / 2),
    ("j5", "revolute", 0.0, 0.0, 0.0, np.pi / 2), ("j6", "revolute", 0.0, 0.10, 0.0, 0.0),
)  # fmt: skip
PLANAR = (("j1", "revolute", 0.0, 0.0, 1.0, 0.0), ("j2", "revolute", 0.0, 0.0, 0.8, 0.0))
BASE = shift(1.2, -0.4, 0.3) @ turn(2, 0.7) @ turn(1, -0.3) @ turn(0, 0.2)
TOOL = shift(0.03, -0.05, 0.12)
SIGMA = 2e-5  # m, of the instrument
TASK = {"kind": "insert", "direction": [0, 0, -1], "position": ["0.5 m", "0.2 m", "0.2 m"]}
FREE = {
    "base": {"xyz": ["1.2 m", "-0.4 m", "0.3 m"], "rpy": ["0.2 rad", "-0.3 rad", "0.7 rad"], "free": True},
    "tool": {"xyz": ["0.03 m", "-0.05 m", "0.12 m"], "rpy": ["0 rad"] * 3, "free": True},
}


def problem_of(table: tuple[Any, ...] = TABLE, robot: dict[str, Any] | None = None, **sections: Any) -> Any:
    uncertainty = {"measurement": {"position": f"{SIGMA * 1e3} mm"}, **sections.pop("uncertainty", {})}
    data = {"robot": SimulatedArm(table).section(**(FREE if robot is None else robot)), "uncertainty": uncertainty}
    return po.problem_from_dict({**data, **sections})


@cache
def task_problem() -> Any:
    sigma = {f"j{i}.theta": "0.2 mrad" for i in range(1, 7)}
    robot = {"tool": {"xyz": ["0 m", "0 m", "120 mm"], "rpy": ["0 deg"] * 3}}
    return problem_of(robot=robot, uncertainty={"sigma": sigma}, task=TASK)


@cache
def plan_of(purpose: str = "parameters", count: int = 30) -> Any:
    problem = problem_of() if purpose == "parameters" else task_problem()
    return po.plan_measurements(problem, count, purpose=purpose)


def plan_few(problem: Any, count: int, **more: Any) -> Any:
    """A plan chosen from few candidates: enough for whatever is asked but how good it is."""
    return po.plan_measurements(problem, count, **{"candidates": 300, **more})


def measured(problem: Any, arm: SimulatedArm, q: np.ndarray, rng: np.random.Generator, **more: Any) -> Any:
    points = arm.points(q) + rng.normal(0, SIGMA, (len(q), 3))
    columns = {f"{row[0]} [rad]": q[:, i] for i, row in enumerate(arm.table)}
    return po.read_measurements({**columns, **{f"{a} [m]": points[:, i] for i, a in enumerate("xyz")}, **more}, problem)


def hidden(rng: np.random.Generator, size: float = 3e-4) -> dict[str, float]:
    return {f"{row[0]}.{key}": rng.normal(0, size) for row in TABLE for key in ("theta", "d", "a", "alpha")}


@pytest.mark.long
def test_a_calibration_finds_the_standard_errors_that_were_promised() -> None:
    plan, problem, z = plan_of(), problem_of(), []
    for seed in range(4):
        rng = np.random.default_rng(seed)
        errors = hidden(rng)
        arm = SimulatedArm(TABLE, errors, base=BASE @ shift(0.02, -0.01, 0.02), tool=TOOL @ shift(0.001, 0, 0.002))
        found = po.calibrate(problem, measured(problem, arm, plan.q, rng), folds=2)
        assert [p.name for p in found.parameters] == [p.name for p in plan.parameters]
        np.testing.assert_array_equal(np.isfinite(found.std), np.isfinite(plan.after.std))
        known = [i for i, p in enumerate(plan.parameters) if found.fixed[i] and p.group == "geometry"]
        # But for the residual variance of one draw, what differs is where the arm is linearised: 2 mm at the tool.
        # What the held combinations add depends on where the axes are found, and no plan can know it.
        std = np.sqrt(np.diag(found.covariance))
        ratio = std[known] / np.sqrt(found.variance) / plan.after.std[known]
        np.testing.assert_allclose(ratio, 1.0, rtol=0.03)
        z += [(found.x[i] - errors.get(plan.parameters[i].name, 0.0)) / plan.after.std[i] for i in known]
    # About 90 correlated standard normals, their RMS within 3/√(2·30) of 1 with a third of them independent.
    assert 0.6 < np.sqrt(np.mean(np.square(z))) < 1.4


@pytest.mark.conformance
def test_the_tool_point_at_the_task_is_as_sure_as_was_promised() -> None:
    plan, problem = plan_of("task"), task_problem()
    B, off = plan.target.basis, []
    for seed in range(10):
        rng = np.random.default_rng(seed)
        # The errors that nothing states keep to the tolerances of the calibration; those of the joints to their σ.
        errors = hidden(rng) | {f"j{i}.theta": rng.normal(0, 2e-4) for i in range(1, 7)}
        arm = SimulatedArm(TABLE, errors, tool=shift(0, 0, 0.12))
        found = po.calibrate(problem, measured(problem, arm, plan.q, rng), folds=2)
        there = measured(problem, arm, plan.target.q[None], np.random.default_rng(0))
        reached = there.position[0] + found.residuals.of_data(there).error(found.x)[0]
        off.append(B @ (reached - arm.points(plan.target.q)[0]))
    rms = np.sqrt(np.mean(np.sum(np.square(off), axis=1)))
    # 10 draws of two coordinates: the RMS scatters by 1/√40 = 16 %; three of that.
    assert rms == pytest.approx(plan.after.task, rel=0.48)


@pytest.mark.long
@pytest.mark.parametrize("purpose", ["parameters", "task"])
def test_chosen_postures_do_what_more_random_ones_would(purpose: str) -> None:
    plan = plan_of(purpose)
    assert plan.gain > 1.05
    assert plan.equivalent > 33
    if purpose == "task":
        assert plan.after.task < plan.random.task
    else:
        assert plan.after.observability["O1"] > plan.random.observability["O1"]
        assert np.nanmean(np.log(plan.after.std / plan.random.std)) < np.log(0.95)


def test_the_plan_keeps_to_limits_table_and_itself() -> None:
    height, margin = 0.15, 10 * DEG
    terms = [{"kind": "link_height", "at_least": "150 mm"}, {"kind": "limit_margin", "at_least": "10 deg"}]
    arm, task = SimulatedArm(TABLE), {"kind": "measure", "position": ["0.5 m", "0.2 m", "0.4 m"], "subject_to": terms}
    sections = {"robot": arm.section(limits=("-170 deg", "120 deg"))}
    problem = po.problem_from_dict({**sections, "uncertainty": {"sigma": {"j1.theta": "1 mrad"}}, "task": task})
    plan = plan_few(problem, 20)
    assert plan.q.min() >= -170 * DEG + margin - 1e-12
    assert plan.q.max() <= 120 * DEG - margin + 1e-12
    for k in range(2, 7):  # what stands behind each joint, by the textbook products
        assert SimulatedArm(TABLE[:k]).points(plan.q[:, :k])[:, 2].min() >= height - 1e-9
    wrist, elbow = (SimulatedArm(TABLE[:k]).points(plan.q[:, :k]) for k in (5, 1))
    assert np.linalg.norm(wrist - elbow, axis=1).min() > 0.05
    np.testing.assert_allclose(plan.points, arm.points(plan.q), atol=1e-12)
    assert plan.notes == ("no σ of the instrument is stated: 0.1 mm taken",)


def test_the_tool_point_stays_where_the_instrument_sees_it() -> None:
    low, high = (0.2, -0.3, 0.1), (0.7, 0.3, 0.9)
    plan = plan_few(task_problem(), 15, within=(low, high))
    points = SimulatedArm(TABLE, tool=shift(0, 0, 0.12)).points(plan.q)
    assert (points >= np.array(low) - 1e-9).all()
    assert (points <= np.array(high) + 1e-9).all()
    assert not any("table" in note for note in plan.notes)


def test_what_is_given_counts() -> None:
    rng, problem = np.random.default_rng(3), problem_of()
    arm = SimulatedArm(TABLE, hidden(rng), base=BASE, tool=TOOL)
    data = measured(problem, arm, arm.drawn(40, rng), rng)
    plan = plan_few(problem, 10, given=data)
    alone = po.calibrate(problem, data)
    np.testing.assert_array_equal(np.isfinite(plan.before.std), np.isfinite(alone.std))
    # The residual variance differs by what counts as freedom; the linearisation is at the fitted arm in both.
    np.testing.assert_allclose(plan.before.std, alone.std, rtol=0.1)
    assert np.nanmax(plan.after.std / plan.before.std) < 1.0
    assert plan.before.observability["O3"] < plan.after.observability["O3"]
    assert plan.to_json()["given"] == 40
    # Few postures that would not do alone do where others are given already.
    with pytest.raises(po.errors.InputError, match=r"3 postures are too few for 27 unknowns – plan at least 10"):
        plan_few(problem, 3)
    assert len(plan_few(problem, 3, given=data).q) == 3


def test_before_anything_is_measured_the_stated_sigmas_speak_of_the_task() -> None:
    sigma = {"j1.theta": "1 mrad", "j2.theta": "2 mrad", "j1.a": "0.3 mm", "j2.a": "0.2 mm"}
    task = {"kind": "insert", "direction": [0, -1, 0], "position": ["0.9 m", "0.4 m", "0 m"]}
    problem = problem_of(PLANAR, robot={}, uncertainty={"sigma": sigma}, task=task)
    plan = plan_few(problem, 10)
    spread = po.propagate(problem, plan.target.q)
    assert plan.before.task == pytest.approx(np.sqrt(spread.first_order[0, 0]), rel=1e-9)  # across is along x
    some = problem_of(PLANAR, robot={}, uncertainty={"sigma": {"j1.theta": "1 mrad"}}, task=task)
    assert np.isnan(plan_few(some, 10).before.task)  # nobody says how long the links are


@pytest.mark.long
def test_the_arms_own_scatter_is_counted_with() -> None:
    problem = problem_of(uncertainty={"scatter": {f"j{i}.theta": "0.1 mrad" for i in range(1, 7)}})
    plan, bare = plan_few(problem, 30), plan_of()
    assert plan.spread > 3
    variances = []
    for seed in range(4):
        rng = np.random.default_rng(seed)
        arm = SimulatedArm(TABLE, base=BASE, tool=TOOL)
        points = arm.points(plan.q + rng.normal(0, 1e-4, plan.q.shape)) + rng.normal(0, SIGMA, (30, 3))
        heads = {f"{row[0]} [rad]": plan.q[:, i] for i, row in enumerate(TABLE)}
        data = po.read_measurements({**heads, **{f"{a} [m]": points[:, i] for i, a in enumerate("xyz")}}, problem)
        variances.append(po.calibrate(problem, data, folds=2).variance)
    # Four times 63 degrees of freedom give the variance to 9 %; chosen postures reach farther out than random ones.
    assert np.sqrt(np.mean(variances)) == pytest.approx(plan.spread, rel=0.35)
    known = np.isfinite(bare.after.std) & np.isfinite(plan.after.std)
    assert np.median(plan.after.std[known] / bare.after.std[known]) == pytest.approx(plan.spread, rel=0.3)


def touching(arm: SimulatedArm, points: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Random postures (N, 6) whose tool points are ``points`` (N, 3), by damped steps along numerical derivatives."""
    q, steps = rng.uniform(-2, 2, (len(points), 6)), 1e-6 * np.eye(6)
    for _ in range(60):
        off = points - arm.points(q)
        J = np.stack([(arm.points(q + step) - arm.points(q)) / 1e-6 for step in steps], axis=2)
        q = q + np.einsum("nij,nj->ni", J.swapaxes(1, 2) @ np.linalg.inv(J @ J.swapaxes(1, 2) + 1e-4 * np.eye(3)), off)
    return np.asarray((q[np.linalg.norm(off, axis=1) < 1e-6] + np.pi) % (2 * np.pi) - np.pi)


@pytest.mark.long
def test_touched_points_are_given_and_more_touches_planned() -> None:
    rng, problem = np.random.default_rng(5), problem_of(robot={"tool": "free"})
    arm = SimulatedArm(TABLE, tool=TOOL)
    front, back = (touching(arm, np.tile(p, (20, 1)), rng) for p in [(0.5, 0.2, 0.3), (-0.2, 0.5, 0.4)])
    assert min(len(front), len(back)) > 15
    heads = {f"{row[0]} [rad]": np.concatenate([front, back])[:, i] for i, row in enumerate(TABLE)}
    data = po.read_measurements({**heads, "point": ["front"] * len(front) + ["back"] * len(back)}, problem)
    plan = plan_few(problem, 12, given=data, candidates=100)
    assert set(plan.places) == {"front", "back"}
    at = [p.name for p in plan.parameters].index("j3.theta")
    assert plan.after.std[at] < plan.before.std[at] < np.inf


def test_every_target_is_measured_at_every_posture() -> None:
    rng, problem = np.random.default_rng(6), problem_of()
    arms = [SimulatedArm(TABLE, base=BASE, tool=shift(x, 0.02, 0.1)) for x in (0.05, -0.05)]
    q = arms[0].drawn(40, rng)
    points = np.where(np.arange(40)[:, None] % 2, arms[1].points(q), arms[0].points(q))
    heads = {f"{row[0]} [rad]": q[:, i] for i, row in enumerate(TABLE)}
    heads |= {f"{a} [m]": points[:, i] for i, a in enumerate("xyz")}
    plan = plan_few(problem, 8, given=po.read_measurements({**heads, "target": ["A", "B"] * 20}, problem))
    assert plan.targets == ("A", "B")
    lines = plan.to_csv().splitlines()
    assert lines[0].endswith("j6 [deg], target")
    assert [line[-1] for line in lines[1:5]] == ["A", "B", "A", "B"]
    assert len(lines) == 17
    assert {"tool[A].x", "tool[B].x"} <= {p.name for p in plan.parameters}


def test_orientations_are_planned_with_where_the_instrument_measures_them() -> None:
    turned = problem_of(uncertainty={"measurement": {"position": "0.02 mm", "orientation": "0.1 mrad"}})
    plan = plan_few(turned, 12)
    names = [p.name for p in plan.parameters]
    assert "tool.roll" in names
    points = plan_few(problem_of(), 12)
    assert "tool.roll" not in [p.name for p in points.parameters]
    at, other = names.index("j5.alpha"), [p.name for p in points.parameters].index("j5.alpha")
    assert plan.after.std[at] < points.after.std[other]  # a posture tells more


def test_what_cannot_be_planned_is_said() -> None:
    still = (("j1", "revolute", 0.0, 0.0, 0.0, 0.0),)
    with pytest.raises(po.errors.InsufficientDataError, match="no parameter can be determined"):
        plan_few(problem_of(still, robot={}), 10)
    with pytest.raises(po.errors.InputError, match="states no task to plan for"):
        plan_few(problem_of(), 30, purpose="task")
    with pytest.raises(po.errors.InputError, match="0 postures are no plan"):
        plan_few(problem_of(), 0)
    with pytest.raises(po.errors.InputError, match="a plan for 'speed' is not known"):
        plan_few(problem_of(), 30, purpose="speed")  # type: ignore[arg-type]
    with pytest.raises(po.errors.NoSolutionError, match=r"above 5000 mm: widen what is stated, link_height"):
        plan_few(problem_of(), 30, link_height=5.0)


def test_the_plan_keeps_clear_of_the_cell() -> None:
    """By exact distances of coal, the capsules placed by textbook products."""
    wall = {"name": "wall", "kind": "box", "size": ["20 mm", "2 m", "2 m"], "xyz": ["0.45 m", "0 m", "0.5 m"]}
    free = po.problem_from_dict({"robot": {"kind": "preset", "name": "ur5e"}})
    walled = po.problem_from_dict(
        {**free.to_dict(), "cell": {"obstacles": [wall], "clearance": "30 mm"}},
    )
    plan, carefree = plan_few(walled, 12), plan_few(free, 12)
    scene = plan.workspace.scene
    solid = coal_distance.solid(scene.obstacles[0])

    def least(postures):
        moving = [capsule for capsule in scene.placed.capsules if capsule.joint != "base"]
        return min(
            coal_distance.distance(coal_distance.capsule(*in_the_world(walled.robot, q, capsule)), solid)
            for q in postures
            for capsule in moving
        )

    assert least(plan.q) >= 0.03 - 1e-6
    assert least(carefree.q) < 0
