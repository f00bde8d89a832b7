"""A peg in the tool: both ends, their joint probability and the tilt, against independently sampled poses."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import posture_opt as po
from tests.helpers.sampled import poses
from tests.helpers.variants import conformance

DRAWN = 200_000
PLANAR_3R = {
    "kind": "dh",
    "joints": [
        {"name": f"j{k}", "type": "revolute", "a": f"{a} m", "alpha": "0 deg", "d": "0 m"}
        for k, a in enumerate((1.0, 0.8, 0.3), start=1)
    ],
}
ARMS: dict[str, tuple[Any, dict[str, Any], dict[str, str]]] = {
    "ur10": ({"kind": "preset", "name": "ur10"}, {"position": ["0.6 m", "0.2 m", "0.2 m"]}, {}),
    "panda": ({"kind": "preset", "name": "panda"}, {"position": ["0.5 m", "0.1 m", "0.2 m"]}, {}),
    "scara": ({"kind": "preset", "name": "scara"}, {"position": ["0.25 m", "0.1 m", "-0.05 m"]}, {}),
    "planar_3r": (
        PLANAR_3R,
        {"position": ["1.2 m", "0.5 m", "0 m"], "direction": [0, -1, 0], "tool_axis": [1, 0, 0]},
        {f"j{k}.theta": "1 deg" for k in (1, 2, 3)},
    ),
}


def problem(arm: str, **task: Any) -> Any:
    robot, target, sigma = ARMS[arm]
    uncertainty = {"sigma": sigma} if sigma else {"repeatability": "1 mm"}
    return po.problem_from_dict(
        {"robot": robot, "uncertainty": uncertainty, "task": {"kind": "insert", "length": "300 mm", **target, **task}}
    )


def sampled_ends(given: Any, q: np.ndarray, length: float) -> tuple[np.ndarray, np.ndarray]:
    """(N, 3) shifts of the tip and of the top end from their nominal places, and (N, 3) axes of the tool."""
    rng, robot = np.random.default_rng(1), given.robot
    place = {f.parameter: i for i, f in enumerate(robot.factors) if f.parameter}
    p = rng.multivariate_normal(np.zeros(len(given.sources.names)), given.sources.covariance, DRAWN)
    errors = {place[name]: p[:, k] for k, name in enumerate(given.sources.names)}
    a = np.array(given.task.tool_axis) / np.linalg.norm(given.task.tool_axis)
    ends = []
    for at, n in ((errors, DRAWN), ({}, 1)):
        x, columns = poses(robot.factors, q, at, n)
        axis = np.einsum("k,kin->in", a, columns)
        ends.append((x.T, (x - length * axis).T))
    return ends[0][0] - ends[1][0], ends[0][1] - ends[1][1]


@pytest.mark.parametrize("arm", conformance(ARMS, ["scara", "planar_3r"]))
def test_both_ends_and_their_probability_are_those_of_sampled_poses(arm: str) -> None:
    rough = po.select_posture(problem(arm))
    clearance = 1.5 * rough.critical.sigma_max
    solution = po.select_posture(problem(arm, clearance=f"{clearance} m"))
    seen, peg = solution.task_spread, solution.task_spread.peg
    B = np.array(seen.critical.basis).T
    tip, top = sampled_ends(solution.problem, solution.q, 0.3)
    both = np.hstack([tip @ B, top @ B])
    C = np.cov(both.T)
    # Standard error of a variance of a Gaussian sample: sqrt(2 / N) of it; three of them.
    scale = np.sqrt(np.outer(np.diag(C), np.diag(C)))
    assert np.max(np.abs(peg.covariance - C) / scale) < 3 * np.sqrt(2 / DRAWN) * 1.5
    m = B.shape[1]
    inside = (np.linalg.norm(both[:, :m], axis=1) <= clearance) & (np.linalg.norm(both[:, m:], axis=1) <= clearance)
    share = float(inside.mean())
    error = 3 * np.sqrt(share * (1 - share) / DRAWN) + peg.p_success.error
    # Rotations of some degrees bend the cloud: the planar arm's is not quite Gaussian.
    assert solution.success_probability == pytest.approx(share, abs=error + (2e-3 if arm == "planar_3r" else 0))
    assert seen.critical.sigma_max == max(peg.tip.sigma_max, peg.top.sigma_max)


@pytest.mark.parametrize("arm", conformance(["ur10", "planar_3r"], ["planar_3r"]))
def test_tilt_and_its_risks_are_those_of_sampled_poses(arm: str) -> None:
    solution = po.select_posture(problem(arm, clearance="1 mm", diameter="10 mm", friction=0.3))
    peg = solution.task_spread.peg
    tip, top = sampled_ends(solution.problem, solution.q, 0.3)
    lean = (tip - top) / 0.3  # to first order of the tilt
    lean = lean - lean.mean(axis=0)
    sigma = np.sqrt(np.linalg.eigvalsh(np.cov(lean.T))[-1])
    assert peg.tilt_sigma == pytest.approx(sigma, rel=0.01)
    for risk, angle in ((peg.two_point_contact, 2e-3 / 0.3), (peg.wedging, 2e-3 / (0.3 * 0.01))):
        assert risk.angle == pytest.approx(angle)
        share = float(np.mean(np.linalg.norm(lean, axis=1) > angle))
        assert risk.probability == pytest.approx(share, abs=4 * np.sqrt(max(share, 1e-4) / DRAWN) + 2e-4)


@pytest.mark.parametrize("arm", conformance(["ur10", "planar_3r"], ["planar_3r"]))
def test_simulated_poses_hit_as_often_as_the_closed_form_says(arm: str) -> None:
    clearance = 1.2 * po.select_posture(problem(arm)).critical.sigma_max
    given = problem(arm, clearance=f"{clearance} m")
    posture = po.select_posture(given).posture
    cloud = po.simulate(given, posture, n=20_000, seed=3)
    spread = po.propagate(given, posture)
    low, high = cloud.success_interval
    assert low - 2e-3 <= spread.for_task.success_probability <= high + 2e-3


def test_the_worse_end_is_what_is_made_small() -> None:
    """No feasible posture of the search has a smaller worse end, by covariances that differences give."""
    solution = po.select_posture(problem("panda"))
    assert solution.status == "optimal"
    given, names = solution.problem, solution.problem.sources.names
    place = {f.parameter: i for i, f in enumerate(given.robot.factors) if f.parameter}
    Sigma, h, B = given.sources.covariance, 1e-6, np.array(solution.critical.basis).T

    def worse(q: np.ndarray) -> float:
        found = []
        for back in (0.0, 0.3):
            J = np.zeros((3, len(names)))
            for k, name in enumerate(names):
                ends = []
                for step in (h, -h):
                    x, columns = poses(given.robot.factors, q, {place[name]: np.array([step])}, 1)
                    ends.append(x[:, 0] - back * columns[2, :, 0])
                J[:, k] = (ends[0] - ends[1]) / (2 * h)
            found.append(np.linalg.eigvalsh(B.T @ J @ Sigma @ J.T @ B)[-1])
        return float(np.sqrt(max(found)))

    assert worse(solution.q) == pytest.approx(solution.critical.sigma_max, rel=2e-3)
    least = min(worse(q) for q in solution.feasible[::20])
    assert worse(solution.q) <= least * 1.0005


def test_effects_and_correlated_errors_reach_both_ends() -> None:
    given = problem("ur10", clearance="0.3 mm")
    document = given.to_dict()
    names = given.robot.joint_names
    document["uncertainty"] = {
        "sigma": {f"{name}.theta": "0.5 mrad" for name in names},
        "correlation": [[f"{names[0]}.theta", f"{names[1]}.theta", 0.6]],
    }
    correlated = po.problem_from_dict(document)
    solution = po.select_posture(correlated)
    tip, top = sampled_ends(correlated, solution.q, 0.3)
    B = np.array(solution.critical.basis).T
    C = np.cov(np.hstack([tip @ B, top @ B]).T)
    assert np.max(np.abs(solution.task_spread.peg.covariance - C)) < 6 * np.sqrt(2 / DRAWN) * C.max()


@pytest.mark.parametrize(
    ("task", "message"),
    [
        ({"diameter": "10 mm"}, "state both or neither"),
        ({"diameter": "10 mm", "friction": 0.2}, "needs the length of the peg and the clearance"),
        ({"length": "0 mm"}, "must be greater than 0"),
    ],
)
def test_half_a_peg_is_refused(task: dict[str, Any], message: str) -> None:
    with pytest.raises(po.errors.InputError, match=message):
        problem("ur10", **task)


def test_an_arm_that_cannot_point_its_tool_has_no_use_for_a_length() -> None:
    given = po.load_problem("insert_planar_2r_fixed_hole").with_task("insert", length="50 mm")
    with pytest.raises(po.errors.InputError, match="cannot bring along the direction"):
        po.select_posture(given)


def test_a_peg_is_told_in_report_and_document() -> None:
    solution = po.select_posture(problem("planar_3r", clearance="0.5 mm", diameter="10 mm", friction=0.3))
    text, document = str(solution.report()), solution.to_json()
    for words in ("Tip ", "Top end ", "Two-point contact", "Wedging", "both ends within"):
        assert words in text
    peg = document["peg"]
    assert [end["name"] for end in peg["ends"]] == ["tip", "top end"]
    assert peg["two_point_contact"]["angle"] == pytest.approx(2 * 0.5e-3 / 0.3)
    assert replace(solution.task_spread, peg=None).to_json().keys() == document.keys() & {
        "critical",
        "success_probability",
    }
