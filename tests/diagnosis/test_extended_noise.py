"""Noise of a joint in the extended model: said once, as large as that of the arm, and found no second time."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
import yaml

import posture_opt as po
from tests.helpers.planar_files import SHORT
from tests.helpers.stated import Sources

LENGTHS = (0.5, 0.4)
INSTRUMENT = 2e-5  # m
SIGMA = 2e-4  # rad, of joint 2 from repeat to repeat
RR = SHORT + "uncertainty: {measurement: {position: 0.02 mm}}\n"


def arm(q: np.ndarray) -> np.ndarray:
    """(N, 2) tool point [m] of the true arm, its links and its second joint a little off."""
    first, both = q[:, 0], q[:, 0] + q[:, 1] + 2e-4
    a, b = LENGTHS[0] + 1e-4, LENGTHS[1] - 2e-4
    return np.stack([a * np.cos(first) + b * np.cos(both), a * np.sin(first) + b * np.sin(both)], axis=1)


def visits(rng: np.random.Generator, q: np.ndarray, sigma: float = SIGMA) -> np.ndarray:
    """The tool point of one visit to each posture."""
    return arm(q + np.outer(rng.normal(0, sigma, len(q)), [0, 1]))


def measured(seed: int, problem: po.Problem, rows: int = 200, sigma: float = SIGMA) -> Any:
    """Every posture four times, in random order."""
    rng = np.random.default_rng(seed)
    q = rng.permutation(np.tile(rng.uniform(-2.5, 2.5, (rows // 4, 2)), (4, 1)))
    p = visits(rng, q, sigma) + rng.normal(0, INSTRUMENT, (rows, 2))
    table = {"joint1 [rad]": q[:, 0], "joint2 [rad]": q[:, 1], "x [m]": p[:, 0], "y [m]": p[:, 1]}
    return po.read_measurements(table, problem)


def problem(**uncertainty: Any) -> po.Problem:
    document = yaml.safe_load(RR)
    document["uncertainty"].update(uncertainty)
    return po.problem_from_dict(document)


@cache
def diagnosis() -> Any:
    stated = problem()
    return po.diagnose(stated, measured(1, stated))


def scatter_of(extended: po.Problem, name: str) -> float:
    """σ of an error from repeat to repeat [rad]."""
    sources = extended.sources
    return float(np.sqrt(sources.scatter[sources.names.index(name), sources.names.index(name)]))


def visit_covariance(extended: po.Problem, q: np.ndarray) -> np.ndarray:
    only = replace(extended, sources=Sources(extended.sources.names, extended.sources.scatter))
    return np.asarray(po.propagate(only, q).covariance)


def test_the_noisy_joint_is_an_effect_of_the_extended_file() -> None:
    found = diagnosis()
    (named,) = [f for f in found.effects if f.noise is not None]
    assert (named.kind, named.target) == ("joint_noise", "joint2")
    (entry,) = found.extended.to_dict()["effects"]
    value, std, _ = named.estimate["sigma"]
    assert (entry["kind"], entry["joint"]) == ("joint_noise", "joint2")
    assert float(entry["sigma"].split()[0]) == pytest.approx(1e3 * value, rel=1e-3)
    assert float(entry["std"].split()[0]) == pytest.approx(1e3 * std, rel=1e-3)
    assert "joint2.theta" not in found.extended.to_dict()["uncertainty"].get("scatter", {})


def test_the_extended_arm_scatters_as_the_simulated_one() -> None:
    extended, rng = diagnosis().extended, np.random.default_rng(7)
    for q in np.array([[0.3, 0.9], [-1.2, 2.0], [1.0, -0.4], [2.0, 1.5]]):
        cloud = visits(rng, np.tile(q, (20_000, 1)))
        true, said = np.cov(cloud, rowvar=False), visit_covariance(extended, q)[:2, :2]
        # σ of 200 rows is known to 6 %, its square to 12 %; the other joint is quiet and may be given a little.
        np.testing.assert_allclose(said, true, atol=0.3 * np.abs(true).max())
        assert np.trace(said) == pytest.approx(np.trace(true), rel=0.3)


def test_the_region_that_is_predicted_holds_new_visits() -> None:
    extended, rng = diagnosis().extended, np.random.default_rng(11)
    q = rng.uniform(-2.5, 2.5, (400, 2))
    e = visits(rng, q) + rng.normal(0, INSTRUMENT, q.shape)
    spread = po.SpreadFunction(extended, compiled=False)
    e -= spread.position(q)[:, :2]
    C = spread(q)[:, :2, :2] + INSTRUMENT**2 * np.eye(2)
    inside = np.mean(np.einsum("ni,nij,nj->n", e, np.linalg.inv(C), e) < 5.991)  # 95 % of χ² with two degrees
    assert 0.91 < inside < 0.985  # 400 visits: 95 ± 1.1 %, and σ itself is known to 6 %


def test_noise_that_a_file_knows_is_not_found_again_nor_counted_twice() -> None:
    extended = diagnosis().extended
    again = po.diagnose(extended, measured(5, extended))
    assert not [f for f in again.effects if f.kind in ("joint_noise", "stated_sigma")]
    twice = again.extended
    assert scatter_of(twice, "joint2.theta") == pytest.approx(scatter_of(extended, "joint2.theta"), rel=1e-3)
    assert [e["kind"] for e in twice.to_dict()["effects"]] == ["joint_noise"]


def test_what_is_named_comes_on_top_of_what_is_stated() -> None:
    stated = problem(scatter={"joint2.theta": "0.15 mrad"})
    found = po.diagnose(stated, measured(3, stated, rows=300, sigma=4e-4))
    assert [f.target for f in found.effects if f.kind == "joint_noise"] == ["joint2"]
    document = found.extended.to_dict()
    beside = float(document["uncertainty"]["scatter"]["joint2.theta"].split()[0])
    assert beside == pytest.approx(np.degrees(1.5e-4), rel=1e-3)
    (entry,) = document["effects"]
    assert float(entry["sigma"].split()[0]) == pytest.approx(1e3 * np.sqrt(4e-4**2 - 1.5e-4**2), rel=0.2)
    assert scatter_of(found.extended, "joint2.theta") == pytest.approx(4e-4, rel=0.15)
    # Found once more in a file that knows some of it, noise adds up in one entry.
    louder = po.diagnose(found.extended, measured(4, found.extended, rows=300, sigma=8e-4)).extended
    assert [e["kind"] for e in louder.to_dict()["effects"]] == ["joint_noise"]
    assert scatter_of(louder, "joint2.theta") == pytest.approx(8e-4, rel=0.15)


def test_correlated_lengths_end_where_one_robot_was_measured() -> None:
    stated = problem(sigma={"joint1.a": "0.1 mm", "joint2.a": "0.1 mm"})
    document = stated.to_dict()
    document["effects"] = [{"kind": "correlated_lengths", "lengths": ["joint1.a", "joint2.a"], "rho": 0.8}]
    stated = po.problem_from_dict(document)
    found = po.diagnose(stated, measured(6, stated))
    assert "correlated_lengths" not in {e["kind"] for e in found.extended.to_dict()["effects"]}
