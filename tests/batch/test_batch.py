"""Several robots of one type: the lengths of the lecture's arm, cut on one machine tool, vary together."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from scipy.optimize import minimize

import posture_opt as po
from posture_opt.batch.batch_covariance import covariance_between_robots, deviation_interval
from posture_opt.model.effects import JointNoise
from posture_opt.problem.fitted_problem import batch_uncertainty, batch_yaml
from tests.helpers import batch_planar_2r as shop
from tests.helpers.command_line import invoke
from tests.helpers.instruments import TrueArm, plane_table
from tests.helpers.planar_2r import position
from tests.helpers.planar_files import PLANAR
from tests.helpers.shipped import PROBLEMS
from tests.hidden.draw import draw
from tests.hidden.files import write

SIGMA = np.array([1e-3, 1e-3])  # m, of the lengths across the batch
RHO = 0.8
NOISE = 2e-5  # m
ROBOTS, POSES = 30, 12
PROBLEM = (
    PLANAR
    + """uncertainty:
  sigma: {joint1.a: 2 mm, joint2.a: 2 mm, tool.x: 0.01 mm}
  scatter: {joint1.theta: 0.05 mrad, joint2.theta: 0.05 mrad}
  measurement: {position: 0.02 mm}
task: {kind: insert, direction: [0, -1, 0], position: [0.9 m, 0.4 m, 0 m]}
"""
)


def lengths(rng: np.random.Generator, robots: int = ROBOTS, rho: float = RHO) -> np.ndarray:
    """(R, 2) lengths of the links of robots from one machine tool [m]."""
    C = np.outer(SIGMA, SIGMA) * [[1, rho], [rho, 1]]
    return 1.0 + rng.multivariate_normal([0, 0], C, robots)


def table(rng: np.random.Generator, cut: np.ndarray, poses: int = POSES) -> dict[str, Any]:
    robot = np.arange(len(cut)).repeat(poses)
    q = rng.uniform(-2.5, 2.5, (len(robot), 2))
    reached = q + 5e-5 * rng.normal(size=q.shape)
    points = position(reached, cut[robot].T) + NOISE * rng.normal(size=q.shape)
    columns = {"joint1 [rad]": q[:, 0], "joint2 [rad]": q[:, 1], "x [m]": points[:, 0], "y [m]": points[:, 1]}
    return {**columns, "robot": [f"R{k + 1:02d}" for k in robot]}


@pytest.fixture(scope="module")
def problem(tmp_path_factory: pytest.TempPathFactory) -> Any:
    file = tmp_path_factory.mktemp("batch") / "problem.yaml"
    file.write_text(PROBLEM, encoding="utf-8")
    return po.load_problem(file)


@pytest.fixture(scope="module")
def batch(problem: Any) -> tuple[po.Batch, np.ndarray]:
    rng = np.random.default_rng(1)
    cut = lengths(rng)
    return po.calibrate_batch(problem, po.read_measurements(table(rng, cut), problem)), cut


def index(found: po.Batch) -> list[int]:
    return [found.names.index("joint1.a"), found.names.index("joint2.a")]


@pytest.mark.conformance
def test_lengths_that_vary_together_are_found(batch: tuple[po.Batch, np.ndarray]) -> None:
    found, cut = batch
    first = found.pairs[0]
    assert {first.a, first.b} == {"joint1.a", "joint2.a"}
    assert first.significant
    assert first.interval[0] < RHO < first.interval[1]
    assert first.interval[1] - first.interval[0] < 0.4
    # Each robot's own lengths, to a few times what 12 postures of 20 µm and 0.05 mrad tell.
    assert np.abs(found.estimates[:, index(found)] - (cut - 1)).max() < 2e-4
    sample = np.corrcoef(cut.T)[0, 1]
    assert first.correlation == pytest.approx(sample, abs=0.02)
    for i, true in zip(index(found), SIGMA, strict=True):
        low, high = found.spread.interval[i]
        assert low < true < high
    assert not any(pair.significant for pair in found.pairs[1:])


@pytest.mark.long
def test_the_section_can_be_pasted_and_loaded(batch: tuple[po.Batch, np.ndarray], problem: Any) -> None:
    found, _ = batch
    section = yaml.safe_load(batch_yaml(problem, found))["uncertainty"]
    assert section == json.loads(json.dumps(batch_uncertainty(problem, found)))
    again = po.problem_from_dict({**problem.to_dict(), "uncertainty": section})
    names = again.sources.names
    i, j = names.index("joint1.a"), names.index("joint2.a")
    C = again.sources.covariance
    assert np.linalg.eigvalsh(C / np.outer(again.sources.sigma, again.sources.sigma))[0] > 0
    assert C[i, j] / math.sqrt(C[i, i] * C[j, j]) == pytest.approx(found.pairs[0].correlation, abs=1e-3)
    assert math.sqrt(C[i, i]) == pytest.approx(found.spread.sigma[found.names.index("joint1.a")], rel=1e-3)
    assert "tool.x" in names  # what the batch says nothing of stays as stated
    assert again.sources.scatter[names.index("joint1.theta"), names.index("joint1.theta")] == pytest.approx(25e-10)
    assert po.select_posture(again).status == "optimal"


def test_effects_and_the_section_say_nothing_twice(problem: Any) -> None:
    rng = np.random.default_rng(1)
    found = po.calibrate_batch(problem, po.read_measurements(table(rng, lengths(rng, 15)), problem))
    known = [
        {"kind": "correlated_lengths", "lengths": ["joint1.a", "joint2.a"], "rho": 0.2},
        {"kind": "joint_noise", "joint": "joint1", "sigma": "0.03 mrad"},
    ]
    with_effects = po.problem_from_dict({**problem.to_dict(), "effects": known})
    noises = [JointNoise(joint=joint, sigma="0.04 mrad") for joint in ("joint1", "joint2")]
    pasted = yaml.safe_load(batch_yaml(with_effects, found, noises))
    assert [entry["kind"] for entry in pasted["effects"]] == ["joint_noise", "joint_noise"]
    again = po.problem_from_dict({**with_effects.to_dict(), **pasted})
    names, visit = again.sources.names, np.diag(again.sources.scatter)
    stated = np.diag(problem.sources.scatter)[problem.sources.names.index("joint1.theta")]
    # What the file states, what its effect states, and what was named: 0.03² + 0.04² = 0.05².
    assert visit[names.index("joint1.theta")] == pytest.approx(stated + 25e-10, rel=1e-6)
    i, j = names.index("joint1.a"), names.index("joint2.a")
    C = again.sources.constant
    assert C[i, j] / math.sqrt(C[i, i] * C[j, j]) == pytest.approx(found.pairs[0].correlation, abs=1e-3)
    assert "effects" not in yaml.safe_load(batch_yaml(problem, found))


def test_a_repeatability_becomes_scatter_beside_zeros_that_vary(problem: Any) -> None:
    document = problem.to_dict()
    document["uncertainty"] = {"repeatability": "0.2 mm", "measurement": {"position": "0.02 mm"}}
    sheet, rng = po.problem_from_dict(document), np.random.default_rng(10)
    columns = table(rng, lengths(rng, 6))
    zeros = np.repeat(2e-3 * rng.normal(size=6), POSES)  # of the second joint's encoder, robot by robot
    columns["joint2 [rad]"] = columns["joint2 [rad]"] - zeros
    section = batch_uncertainty(sheet, po.calibrate_batch(sheet, po.read_measurements(columns, sheet)))
    assert "joint2.theta" in section["sigma"]
    assert "repeatability" not in section
    again = po.problem_from_dict({**document, "uncertainty": section}).sources
    assert np.trace(again.scatter) == pytest.approx(np.trace(sheet.sources.scatter), rel=1e-3)


@pytest.mark.campaign
def test_intervals_hold_correlation_and_sigma_in_95_percent_of_300_batches() -> None:
    rng = np.random.default_rng(3)
    held = np.zeros(3)
    errors = np.broadcast_to(np.diag([1e-4, 1e-4]) ** 2, (ROBOTS, 2, 2))
    for _ in range(300):
        cut = lengths(rng) + 1e-4 * rng.normal(size=(ROBOTS, 2))
        found = covariance_between_robots(cut, errors)
        low, high = found.correlation_interval[0, 1]
        held += [low <= RHO <= high, *((found.interval[:, 0] <= SIGMA) & (found.interval[:, 1] >= SIGMA))]
    # Binomial: 285 ± 3.8 of 300; 92 % and 98 % are 276 and 294.
    assert np.all((held >= 276) & (held <= 294)), held


@pytest.mark.campaign
def test_errors_of_the_estimates_are_taken_off() -> None:
    """Estimates as uncertain as the batch is wide, with errors that hang together the other way."""
    rng = np.random.default_rng(4)
    S = 1e-6 * np.array([[1, -0.8], [-0.8, 1]])
    found, plain = [], []
    for _ in range(40):
        x = lengths(rng, 60) + rng.multivariate_normal([0, 0], S, 60)
        estimate = covariance_between_robots(x, np.broadcast_to(S, (60, 2, 2)))
        found.append([estimate.correlation[0, 1], *estimate.sigma])
        plain.append(np.corrcoef(x.T)[0, 1])
    assert abs(np.mean(plain)) < 0.05
    # Of 60 robots with such errors a correlation is known to 0.2 or so; the mean of 40 to 0.03.
    np.testing.assert_allclose(np.mean(found, axis=0), [RHO, *SIGMA], rtol=0.1)


def test_the_covariance_has_the_largest_restricted_likelihood() -> None:
    rng = np.random.default_rng(5)
    R = 12
    roots = 3e-4 * rng.normal(size=(R, 2, 2))
    S = np.einsum("rij,rkj->rik", roots, roots)
    x = lengths(rng, R) + np.einsum("rij,rj->ri", roots, rng.normal(size=(R, 2)))
    X = np.kron(np.ones((R, 1)), np.eye(2))
    K = np.linalg.svd(X)[0][:, 2:]

    def fall(v: np.ndarray) -> float:
        L = 1e-3 * np.array([[v[0], 0], [v[1], v[2]]])
        V = np.zeros((2 * R, 2 * R))
        for r in range(R):
            V[2 * r : 2 * r + 2, 2 * r : 2 * r + 2] = L @ L.T + S[r]
        y = K.T @ (x - 1).ravel()
        W = K.T @ V @ K
        return float(np.linalg.slogdet(1e6 * W)[1] + y @ np.linalg.solve(W, y))

    best = minimize(fall, [1.0, 0.5, 0.5], method="Nelder-Mead", options={"xatol": 1e-8, "fatol": 1e-10})
    L = 1e-3 * np.array([[best.x[0], 0], [best.x[1], best.x[2]]])
    # EM stops at 1e-6 of a variance a step; here the correlation is nearly one, where it goes slowest.
    np.testing.assert_allclose(covariance_between_robots(x, S).covariance, L @ L.T, rtol=5e-3)


def test_an_interval_without_errors_is_that_of_chi_square() -> None:
    from scipy.stats import chi2

    x = np.random.default_rng(6).normal(size=25)
    low, high = deviation_interval(x, np.zeros(25))
    nu, s = 24, float(np.std(x, ddof=1))
    # The profile likelihood and equal tails differ by the skewness, which is small at 24 degrees of freedom.
    assert low == pytest.approx(s * math.sqrt(nu / chi2.ppf(0.975, nu)), rel=0.05)
    assert high == pytest.approx(s * math.sqrt(nu / chi2.ppf(0.025, nu)), rel=0.05)


def test_too_few_robots_are_refused_with_what_to_measure(problem: Any) -> None:
    rng = np.random.default_rng(7)
    with pytest.raises(po.errors.InsufficientDataError, match="measure 3 robots or more"):
        po.calibrate_batch(problem, po.read_measurements(table(rng, lengths(rng, 2)), problem))
    with pytest.raises(po.errors.InputError, match="cannot be known from it"):
        po.calibrate_batch(problem, po.read_measurements(table(rng, lengths(rng, 1)), problem))
    with pytest.raises(po.errors.InsufficientDataError, match=r"robot R0\d: "):
        po.calibrate_batch(problem, po.read_measurements(table(rng, lengths(rng, 4), poses=2), problem))


def test_calibrate_takes_a_file_of_several_robots(problem: Any, tmp_path: Path) -> None:
    rng = np.random.default_rng(8)
    columns = table(rng, lengths(rng, 5))
    file, out = tmp_path / "batch.csv", tmp_path / "out"
    rows = zip(*columns.values(), strict=True)
    file.write_text("\n".join([",".join(columns), *(",".join(map(str, row)) for row in rows)]) + "\n")
    (tmp_path / "problem.yaml").write_text(PROBLEM, encoding="utf-8")
    words = ["calibrate", str(file), "--problem", str(tmp_path / "problem.yaml")]
    result = invoke(*words, "--json", "--no-plots", "--out", str(out))
    assert result.exit_code == 0, result.stderr
    document = json.loads(result.stdout)
    assert {"residual_rms", "coverage95", "parameters", "rank", "observability", "outliers"} <= set(document)
    assert [robot["robot"] for robot in document["batch"]["robots"]] == [f"R{k + 1:02d}" for k in range(5)]
    assert np.array(document["batch"]["covariance"]).shape == (len(document["batch"]["parameters"]),) * 2
    assert {"calibration.json", "uncertainty.yaml", "report.html"} <= {f.name for f in out.iterdir()}
    report = (out / "report.txt").read_text(encoding="utf-8")
    assert "5 robots of one type" in report
    assert max(map(len, report.splitlines())) <= 100
    refused = invoke(*words, "--test", str(file))
    assert refused.exit_code == 2


@pytest.mark.long
def test_the_example_is_what_its_simulator_measures() -> None:
    lines = (PROBLEMS / "planar_2r_batch.csv").read_text(encoding="utf-8").splitlines()
    assert lines[0] == shop.HEAD
    example = po.load_problem("insert_planar_2r_measured")
    found = po.calibrate_batch(example, po.read_measurements(PROBLEMS / "planar_2r_batch.csv", example))
    off = found.estimates[:, index(found)] - (shop.lengths() - 1)
    # 0.1 to 0.2 mm of scatter in 12 postures of an arm whose zeros are unknown too.
    assert np.sqrt(np.mean(off**2)) < 1.5e-4
    first = found.pairs[0]
    assert {first.a, first.b} == {"joint1.a", "joint2.a"}
    assert first.interval[0] < shop.CORRELATION < first.interval[1]


def test_planes_do_not_say_how_sizes_vary() -> None:
    rng = np.random.default_rng(0)
    tables = [plane_table(TrueArm(), rng, 2, 0.0) for _ in range(3)]
    table = {name: np.concatenate([one[name] for one in tables]) for name in tables[0]}
    table["robot"] = np.repeat(["a", "b", "c"], 6)
    problem = po.problem_from_dict({"robot": {"kind": "preset", "name": "ur10"}})
    with pytest.raises(
        po.errors.InsufficientDataError, match="touches of planes alone do not determine the size of a robot"
    ):
        po.calibrate_batch(problem, po.read_measurements(table, problem))


@pytest.mark.long
def test_a_base_that_is_off_does_not_hide_how_lengths_vary(tmp_path: Path) -> None:
    case = draw(61, "batch")
    base, tool = (np.array([f.value for f in part]) for part in (case.nominal.base, case.nominal.tool))
    base[:2] += [4e-3, -3e-3]
    problem = po.load_problem(write(replace(case, nominal=case.nominal.with_frames(base, tool)), tmp_path))
    lines = (tmp_path / "data.csv").read_text(encoding="utf-8").splitlines()
    (tmp_path / "ten.csv").write_text("\n".join(lines[:101]), encoding="utf-8")  # the first ten robots
    found = po.diagnose_batch(problem, po.read_measurements(tmp_path / "ten.csv", problem))
    assert len(found.batch.calibrations) == 10
    refuted = [[c.cause.kind for c in calibration.contradictions] for calibration in found.batch.calibrations]
    assert np.mean([kinds == ["base_frame"] for kinds in refuted]) > 0.9
    assert ("correlated_lengths", "joint1.a, joint2.a") in [(f.kind, f.target) for f in found.effects]
    assert "batch.refuted" in {one.id for one in found.batch.statements}


@pytest.mark.long
def test_a_batch_whose_postures_are_measured_once_does_not_tell_which_joint_scatters() -> None:
    example = po.load_problem("insert_planar_2r_measured")
    found = po.diagnose_batch(example, po.read_measurements(PROBLEMS / "planar_2r_batch.csv", example))
    document = found.to_json()
    assert [e["kind"] for e in document["effects"]] == ["correlated_lengths"]
    assert document["verdict"] == "unexplained"
    assert set(document["unexplained"]["place"]) == {"joint1", "joint2"}
    assert document["unexplained"]["p_value"] < 0.002
    (uneven,) = (one for one in found.statements if one.id == "diagnosis.uneven")
    assert uneven.about == "joint1 and joint2"
    assert found.statements[0].id == "batch.causes"
