"""The problem files that travel with the package: each loads, solves, and its answer holds against outside checks."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import posture_opt as po
from posture_opt.problem.parts import parse_spec
from posture_opt.selection.tasks import TASKS
from tests.helpers import factors
from tests.helpers.pin import PinArm
from tests.helpers.planar_2r import SOURCES, exact, position, postures_at
from tests.helpers.shipped import PROBLEMS, shipped_tasks
from tests.helpers.variants import conformance
from tests.hidden.arms import ARMS
from tests.hidden.designs import Session
from tests.hidden.effects import Site

# Paths: tests/selection/test_paths.py, features: tests/selection/test_features.py.
FILES = [path for path, task in shipped_tasks().items() if not task.on_path and not task.features]
PLANAR = [path for path in FILES if "planar_2r" in path.stem or path.stem.startswith("lecture_")]
KINDS = [task.model_fields["kind"].annotation.__args__[0] for task in TASKS]
WHOLE_TURN = 2 * math.pi


SPATIAL = ("drill_ur5e", "insert_ur10_extended", "insert_urdf_arm")
ALWAYS = [path for path in FILES if path.stem in SPATIAL or path.stem in {f"{kind}_planar_2r" for kind in KINDS}]
ALWAYS += [path for path in FILES if path.stem == "insert_planar_2r_correlated_lengths"]


def named(paths, always=ALWAYS):
    paths = list(paths)
    chosen = conformance(paths, [path for path in always if path in paths])
    return pytest.mark.parametrize("path", chosen, ids=lambda path: path.stem)


@cache
def solved(path):
    """The problem and its answer; the planar ones with all the evidence, the others as a repeated solve does it."""
    problem = po.load_problem(path)
    selector = po.PostureSelector(problem, compiled=False)
    return problem, selector.solve_thoroughly() if path in PLANAR else selector.solve()


def tool_pose(path, robot, q):
    """(4, 4) by a chain product in NumPy, or by Pinocchio where there is a URDF."""
    if path.stem == "insert_urdf_arm":
        arm = PinArm(PROBLEMS / "bench_arm.urdf")
        return arm.pose(dict(zip(robot.joint_names, q, strict=True)), "base_link", "peg_tip")
    return factors.pose(*as_it_stands(path, robot, q))


def as_it_stands(path, robot, q):
    """The plain chain that stands as an arm with effects does: its joints and lengths by an independent simulator."""
    if path.stem != "insert_ur10_extended":
        return robot, np.asarray(q)
    arm = ARMS["ur10"]().with_frames(np.zeros(6), np.array([0, 0, 0.12, 0, 0, 0]))
    one = np.ones(1)
    loaded = Session(np.array([q]), one, one, one, 5 * one, one, one, True, True, True)
    tau = Site(arm, loaded, {}).tau[0]
    warm = 1 + 23e-6 * (26 - 20)
    links = [
        [replace(f, nominal=f.nominal * warm) if f.kind == "translate" else f for f in link] for link in robot.links
    ]
    sag = np.array([-math.radians(40 / 3600) / 2, 8e-6 * tau[1], 12.5e-6 * tau[2], 0, 0, 0])
    return replace(robot, links=tuple(map(tuple, links))), np.asarray(q) + sag


def first_order(robot, sources, q):
    """(3, 3) J Σ Jᵀ with J by central differences of the chain product."""
    J = factors.parameter_jacobian(robot, q, sources.names)
    return J @ sources.covariance @ J.T


@named(FILES)
def test_the_answer_holds_against_outside_checks(path):
    problem, solution = solved(path)
    assert solution.status == "optimal"
    assert np.all(solution.q >= np.array(problem.robot.lower) - 1e-12)
    assert np.all(solution.q <= np.array(problem.robot.upper) + 1e-12)
    point, task = tool_pose(path, problem.robot, solution.q)[:3, 3], problem.task
    # IPOPT is asked for rows good to 1e-9 m; a tenth of a micrometre is far below every scatter here.
    if task.position is not None:
        np.testing.assert_allclose(point, task.position, atol=1e-7)
    if task.region is not None:
        assert np.all(point >= np.array(task.region.min) - 1e-7)
        assert np.all(point <= np.array(task.region.max) + 1e-7)
    if path not in PLANAR or "drill" in path.stem:
        axis = tool_pose(path, problem.robot, solution.q)[:3, :3] @ task.tool_axis
        d = np.array(task.direction)
        cosine = axis @ d / np.linalg.norm(axis) / np.linalg.norm(d)
        # 1e-6 rad is what rows good to 1e-9 leave of an angle, and more: cos loses half of the digits.
        assert math.acos(min(1.0, cosine)) <= task.tilt + 1e-6
    for term in problem.task.subject_to:
        if term.kind == "limit_margin":
            room = np.minimum(solution.q - problem.robot.lower, np.array(problem.robot.upper) - solution.q)
            assert room.min() >= term.at_least - 1e-7
        elif term.kind == "singularity_margin":
            singular = np.linalg.svd(factors.joint_jacobian(problem.robot, solution.q), compute_uv=False)
            assert singular[-1] >= term.at_least - 1e-5
        elif term.kind == "link_height":
            ends = [replace(problem.robot, links=problem.robot.links[: k + 1], tool=()) for k in range(problem.robot.n)]
            elsewhere = solution.q + 0.3
            heights = [factors.pose(end, solution.q)[2, 3] for end in ends]
            moving = [abs(factors.pose(end, elsewhere)[2, 3] - z) > 1e-9 for end, z in zip(ends, heights, strict=True)]
            assert min(np.array(heights)[moving]) >= term.at_least - 1e-6
        elif term.kind == "manipulability":
            singular = np.linalg.svd(factors.joint_jacobian(problem.robot, solution.q), compute_uv=False)[:2]
            assert math.sqrt(singular[0] * singular[1]) >= term.at_least - 1e-5  # of a planar arm
        else:
            pytest.fail(f"no check for {term.kind}")
    if path not in PLANAR:
        B = solution.critical.basis
        robot, q = as_it_stands(path, problem.robot, solution.q)
        C = B @ first_order(robot, problem.sources, q) @ B.T
        # Errors below 1 mrad: what first order leaves out is some 1e-6 of the variance; differences are good to 1e-8.
        assert solution.critical.sigma_max == pytest.approx(math.sqrt(np.linalg.eigvalsh(C)[-1]), rel=1e-5)


def planar_covariance(problem):
    names = problem.sources.names
    full = np.zeros((4, 4))
    index = [SOURCES.index(name) for name in names]
    full[np.ix_(index, index)] = problem.sources.covariance
    return full


def planar_value(problem, q):
    """The variance [m²] that the task minimises, by hand: across a vertical direction x counts, else y."""
    C = exact(q, planar_covariance(problem))
    task = problem.task
    if task.kind == "measure":
        return C[..., 0, 0] + C[..., 1, 1]
    if task.kind == "hold":
        return np.linalg.eigvalsh(C[..., :2, :2])[..., -1]
    if task.kind == "custom":
        return np.sqrt(np.linalg.det(C[..., :2, :2]))  # criterion area
    d = np.array(task.direction[:2]) / np.linalg.norm(task.direction[:2])
    u = d if task.kind == "probe" else np.array([d[1], -d[0]])
    return np.einsum("i,...ij,j->...", u, C, u)


def candidates(problem):
    """(N, 2) postures, fine and complete, that the task allows."""
    task = problem.task
    turn = np.radians(np.arange(-180, 180, 0.5))
    if task.kind == "drill":
        # The second link, which carries the tool axis, points along the direction.
        fine = np.radians(np.arange(-180, 180, 0.01))
        t2 = (math.atan2(task.direction[1], task.direction[0]) - fine + np.pi) % WHOLE_TURN - np.pi
        Q = np.column_stack([fine, t2])
        points, box = position(Q), task.region
        return Q[np.all((points >= box.min[:2]) & (points <= box.max[:2]), axis=1)]
    if task.position is not None:
        points = np.array([task.position[:2]])
    elif task.region is not None:
        axes = [np.linspace(low, high, 401 if high > low else 1) for low, high in
                zip(task.region.min[:2], task.region.max[:2], strict=True)]  # fmt: skip
        points = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
    else:
        return np.stack(np.meshgrid(turn, turn), axis=-1).reshape(-1, 2)
    Q = postures_at(points).reshape(-1, 2)
    Q = Q[np.isfinite(Q).all(axis=1)]
    if task.kind == "custom":
        # Its bound on the manipulability, of two links of 1 m the root of |sin t2| (Yoshikawa 1985).
        Q = Q[np.sqrt(np.abs(np.sin(Q[:, 1]))) >= task.subject_to[0].at_least]
    return Q


@named(PLANAR)
def test_nothing_on_a_fine_grid_beats_the_planar_answer(path):
    problem, solution = solved(path)
    own = planar_value(problem, solution.q)
    least = planar_value(problem, candidates(problem)).min()
    # 0.1 % of the standard deviation. The grid contains the true optimum or lies within its own step of it; a spread
    # of exactly zero (lengths alone, links upright) is met to a nanometre.
    assert math.sqrt(max(own, 0)) <= math.sqrt(max(least, 0)) * 1.001 + 1e-9
    assert math.sqrt(max(own, 0)) >= math.sqrt(max(least, 0)) * 0.99 - 1e-9, "the grid is too coarse to judge"
    if problem.task.kind not in ("measure", "custom"):
        assert solution.critical.sigma_max == pytest.approx(math.sqrt(max(own, 0)), rel=1e-6, abs=1e-9)


def test_calibrated_covariance_is_that_of_the_stated_measurements():
    Sigma = planar_covariance(po.load_problem(PROBLEMS / "insert_planar_2r_calibrated.yaml"))
    information = np.zeros((4, 4))
    for t1 in np.radians([-60, 0, 60]):
        for t12 in t1 + np.radians([30, 70, 110, 150]):
            c1, s1, c12, s12 = math.cos(t1), math.sin(t1), math.cos(t12), math.sin(t12)
            J = np.array([[-s1 - s12, -s12, c1, c12], [c1 + c12, c12, s1, s12]])
            information += J.T @ J / 0.5e-3**2
    # written with ten digits
    np.testing.assert_allclose(Sigma @ information, np.eye(4), atol=1e-7)


@pytest.mark.parametrize("stem", ["ur10", "ur5e", "irb120", "iiwa14"])
def test_stated_repeatability_is_the_data_sheets(stem):
    """Where a file repeats a preset's data-sheet figure, the two agree."""
    paths = [path for path in FILES if path not in PLANAR and stem in path.stem]
    assert paths
    for path in paths:
        problem = po.load_problem(path)
        stated = parse_spec(problem.origin).uncertainty.repeatability
        assert stated is None or stated == problem.robot.repeatability.value
