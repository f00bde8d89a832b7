"""Effects that spread the tool point, or its measurements: their files, and what they do to a problem."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pytest
import yaml

import posture_opt as po
from posture_opt.diagnosis.noise.noise_candidates import score_uneven_noise
from posture_opt.model.effects import NOISES, NoiseEffect, Rows
from tests.helpers.planar_files import SHORT

ENTRIES: dict[str, dict[str, Any]] = {
    "joint_noise": {"kind": "joint_noise", "joint": "joint2", "sigma": "0.2 mrad", "std": "0.01 mrad"},
    "range_noise": {"kind": "range_noise", "a": "15 um", "b": "6 um/m"},
    "stated_sigma": {"kind": "stated_sigma", "factor": 2.0},
    "outliers": {"kind": "outliers", "share": 0.02},
    "correlated_lengths": {"kind": "correlated_lengths", "lengths": ["joint1.a", "joint2.a"], "rho": 0.8},
}
RR = (
    SHORT
    + """uncertainty:
  sigma: {joint1.theta: 0.1 mrad, joint2.theta: 0.1 mrad, joint1.a: 0.1 mm, joint2.a: 0.2 mm}
  measurement: {position: 0.02 mm}
"""
)
Q = np.array([0.3, 0.9])

every_kind = pytest.mark.parametrize("cls", NOISES, ids=lambda cls: kind_of(cls))


def kind_of(cls: type[Any]) -> str:
    return str(cls.model_fields["kind"].default)


def problem(*effects: dict[str, Any], **uncertainty: Any) -> po.Problem:
    document = yaml.safe_load(RR)
    document["uncertainty"].update(uncertainty)
    document["effects"] = copy.deepcopy(list(effects))
    return po.problem_from_dict(document)


def covariance(of: po.Problem, q: np.ndarray = Q) -> np.ndarray:
    return np.asarray(po.propagate(of, q).covariance)[:2, :2]


def levers(q: np.ndarray) -> dict[str, np.ndarray]:
    """By hand: what a unit of each error moves the tool point of the arm by."""
    (c1, s1), (c12, s12) = ((np.cos(v), np.sin(v)) for v in (q[0], q[0] + q[1]))
    second = np.array([-0.4 * s12, 0.4 * c12])
    return {
        "joint1.theta": second + np.array([-0.5 * s1, 0.5 * c1]), "joint2.theta": second,
        "joint1.a": np.array([c1, s1]), "joint2.a": np.array([c12, s12]),
    }  # fmt: skip


@every_kind
def test_what_is_of_the_arm_spreads_the_tool_and_the_rest_says_that_it_does_not(cls: type[NoiseEffect]) -> None:
    plain, noisy = problem(), problem(ENTRIES[kind_of(cls)])
    same = np.allclose(covariance(plain), covariance(noisy), rtol=1e-12, atol=0)
    said = [note for note in noisy.notes if "no part of the spread" in note and kind_of(cls) in note]
    assert same == (not cls.of_arm)
    assert bool(said) == same
    # The nominal tool point stays where it is.
    assert po.propagate(noisy, Q).to_json()["tool"] == po.propagate(plain, Q).to_json()["tool"]


def test_joint_noise_adds_its_own_variance_at_every_visit() -> None:
    J = levers(Q)["joint2.theta"]
    added = covariance(problem(ENTRIES["joint_noise"])) - covariance(problem())
    # Of first order by hand; what a turn of 0.2 mrad does beyond it is 1e-4 of that.
    np.testing.assert_allclose(added, 0.2e-3**2 * np.outer(J, J), atol=1e-3 * 0.2e-3**2)
    sources = problem(ENTRIES["joint_noise"]).sources
    k = sources.names.index("joint2.theta")
    assert sources.scatter[k, k] == pytest.approx(0.2e-3**2)
    assert sources.constant[k, k] == pytest.approx(0.1e-3**2)


def test_joint_noise_is_the_scatter_of_a_joint_to_cloud_and_choice() -> None:
    noisy = problem(ENTRIES["joint_noise"] | {"sigma": "2 mrad"})
    stated = problem(scatter={"joint2.theta": "2 mrad"})
    np.testing.assert_allclose(covariance(noisy), covariance(stated), rtol=1e-12)
    clouds = [po.simulate(p, Q, n=4000, seed=3).to_json()["covariance"] for p in (noisy, stated)]
    np.testing.assert_allclose(*clouds, rtol=1e-12)
    chosen = [po.select_posture(p).to_json() for p in (noisy, stated, problem())]
    assert chosen[0]["posture"] == pytest.approx(chosen[1]["posture"], abs=1e-9)
    assert chosen[0]["critical"]["sigma_max"] > 1.5 * chosen[2]["critical"]["sigma_max"]


def test_correlated_lengths_stand_off_the_diagonal() -> None:
    J = levers(Q)
    added = covariance(problem(ENTRIES["correlated_lengths"])) - covariance(problem())
    across = np.outer(J["joint1.a"], J["joint2.a"])
    by_hand = 0.8 * 0.1e-3 * 0.2e-3 * (across + across.T)
    np.testing.assert_allclose(added, by_hand, atol=1e-4 * np.abs(by_hand).max())
    stated = problem(correlation=[["joint1.a", "joint2.a", 0.8]])
    np.testing.assert_allclose(covariance(problem(ENTRIES["correlated_lengths"])), covariance(stated), rtol=1e-12)


@pytest.mark.parametrize(
    ("entry", "said"),
    [
        ({"kind": "joint_noise", "joint": "elbow", "sigma": "0.1 mrad"}, "joint1, joint2"),
        ({"kind": "joint_noise", "joint": "joint2", "sigma": "0.1 mm"}, "not a unit of angle"),
        ({"kind": "joint_noise", "joint": "joint2", "sigma": "0 mrad"}, "greater than 0"),
        ({"kind": "joint_noise", "joint": "joint2"}, "sigma"),
        ({"kind": "range_noise", "b": 6}, "um/m"),
        ({"kind": "stated_sigma", "factor": -1}, "greater than 0"),
        ({"kind": "outliers", "share": 0.7}, "less than 0.5"),
        ({"kind": "correlated_lengths", "lengths": ["joint1.a", "joint1.a"], "rho": 0.5}, "two different"),
        ({"kind": "correlated_lengths", "lengths": ["joint1.a", "joint9.a"], "rho": 0.5}, "joint9.a"),
        ({"kind": "correlated_lengths", "lengths": ["joint1.a", "joint2.theta"], "rho": 0.5}, "no length"),
        ({"kind": "correlated_lengths", "lengths": ["joint1.a", "joint2.d"], "rho": 0.5}, "no σ"),
    ],
)
def test_a_wrong_entry_is_told_with_its_place(entry: dict[str, Any], said: str) -> None:
    with pytest.raises(po.errors.InputError) as caught:
        problem(entry)
    assert said in str(caught.value)
    assert all(issue.key[0] == "effects" for issue in caught.value.issues)


@pytest.mark.parametrize("entry", [ENTRIES["stated_sigma"], {"kind": "range_noise", "b": "6 um/m"}])
def test_a_change_of_the_instruments_sigma_needs_one(entry: dict[str, Any]) -> None:
    with pytest.raises(po.errors.InputError, match="none is stated"):
        problem(entry, measurement=None)


@pytest.mark.campaign
@pytest.mark.parametrize("loud", [1e-4, 4e-4])
def test_the_interval_of_named_noise_holds_its_size(loud: float) -> None:
    """120 sets of 100 rows: 95 ± 2 % of the intervals hold the truth."""
    rng = np.random.default_rng(12)
    robot, N = problem().robot, 100
    inside = {"joint_noise": 0, "range_noise": 0}
    for _ in range(120):
        c, r = 1e4 * rng.normal(size=(2, N, 2)), rng.uniform(0.5, 2.0, N)
        rows = Rows(robot, c, r, 2e-5)
        noise = rng.normal(size=(N, 2)) + loud * rng.normal(size=(N, 1)) * c[1]
        joint = next(s for s in score_uneven_noise(noise, rows, seed=0, draws=20) if s.target == "joint2")
        inside["joint_noise"] += abs(joint.size - loud) < 1.96 * joint.std
        slope = 1e4 * loud / 4
        noise = rng.normal(size=(N, 2)) * np.exp(slope * (r - r.mean()) / np.ptp(r))[:, None]
        growth = next(s for s in score_uneven_noise(noise, rows, seed=0, draws=20) if s.kind == "range_noise")
        inside["range_noise"] += abs(growth.size - np.expm1(slope)) < 1.96 * growth.std
    assert all(106 <= count <= 120 for count in inside.values()), inside


def true_arm(q: np.ndarray) -> np.ndarray:
    """(N, 2) tool point [m] of an arm whose first link is longer than the file says."""
    first, both = q[:, 0], q[:, 0] + q[:, 1]
    return 0.5002 * np.stack([np.cos(first), np.sin(first)], 1) + 0.4 * np.stack([np.cos(both), np.sin(both)], 1)


def measured(of: po.Problem, seed: int, sigma: Any, rows: int = 400, visits: int = 1) -> Any:
    """Measurements with the σ of each row from its range [m]; every posture is visited as often as ``visits``."""
    rng = np.random.default_rng(seed)
    q = np.tile(rng.uniform(-2.8, 2.8, (rows // visits, 2)), (visits, 1))
    p = true_arm(q)
    p = p + rng.normal(size=p.shape) * np.broadcast_to(sigma(np.linalg.norm(p, axis=1)), rows)[:, None]
    table = {"joint1 [rad]": q[:, 0], "joint2 [rad]": q[:, 1], "x [m]": p[:, 0], "y [m]": p[:, 1]}
    return po.read_measurements(table, of)


def named(of: po.Problem, data: Any) -> set[str]:
    return {f.kind for f in po.diagnose(of, data).effects} & {kind_of(cls) for cls in NOISES}


GROWING = {"kind": "range_noise", "a": "5 um", "b": "60 um/m"}


@pytest.mark.long
@pytest.mark.parametrize(
    ("sigma", "entry"),
    [
        (lambda r: 5e-6 + 6e-5 * r, GROWING),
        pytest.param(lambda r: 6e-5 + 0 * r, {"kind": "stated_sigma", "factor": 3}, marks=pytest.mark.conformance),
    ],
)
def test_noise_that_the_file_knows_is_not_named(sigma: Any, entry: dict[str, Any]) -> None:
    stranger, knowing = problem(), problem(entry)
    assert entry["kind"] in named(stranger, measured(stranger, 2, sigma, visits=4))
    assert named(knowing, measured(knowing, 2, sigma, visits=4)) == set()
    # Without repeats it could be what the model lacks: left unexplained, with that place, and nothing is named.
    once = po.diagnose(stranger, measured(stranger, 2, sigma), plan=False)
    assert once.verdict == "unexplained"
    assert once.unexplained_places == ({"range_noise": "instrument", "stated_sigma": "data"}[entry["kind"]],)
    assert named(stranger, measured(stranger, 2, sigma)) == set()


def test_a_plan_counts_with_the_instrument_as_its_effects_have_it() -> None:
    def std(plan: Any) -> np.ndarray:
        return np.array([row["after"] for row in plan.to_json()["parameters"]], dtype=float)

    without = {"sigma": {}}
    plain = po.plan_measurements(problem(**without), 12, seed=1, candidates=200)
    wider = po.plan_measurements(problem(ENTRIES["stated_sigma"], **without), 12, seed=1, candidates=200)
    fewer = po.plan_measurements(problem({"kind": "outliers", "share": 0.19}, **without), 12, seed=1, candidates=200)
    growing = po.plan_measurements(problem(GROWING, **without), 12, seed=1, candidates=200)
    np.testing.assert_allclose(std(wider), 2 * std(plain), rtol=1e-5)
    np.testing.assert_allclose(std(fewer), std(plain) / 0.9, rtol=1e-5)
    # Where the instrument reads worse the farther away, what is near is worth more.
    assert np.linalg.norm(growing.points, axis=1).mean() < 0.95 * np.linalg.norm(plain.points, axis=1).mean()
