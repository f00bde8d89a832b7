"""Calibration against a simulator of its own that hides errors, and against measurements of real arms."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import posture_opt as po
from tests.helpers.free_arms import BASE, SIX, TOOL, TWO, hidden_errors, problem_of, rows, simulated_points
from tests.helpers.real_arms import DATA, long_on_real_arms


@pytest.fixture(scope="module")
def six() -> tuple[Any, po.Measurements, dict[str, float], po.Calibration]:
    rng = np.random.default_rng(1)
    problem = problem_of(SIX)
    errors = hidden_errors(SIX, rng, ("j2",))
    q = rng.uniform(-2.5, 2.5, (120, 6))
    data = rows(problem, q, simulated_points(SIX, q, BASE, TOOL, errors) + rng.normal(0, 2e-5, (120, 3)))
    return problem, data, errors, po.calibrate(problem, data)


def test_hidden_errors_of_a_6r_arm_are_found_within_their_stated_errors(six: Any) -> None:
    _, _, errors, result = six
    geometry = [i for i, p in enumerate(result.parameters) if result.fixed[i] and p.group == "geometry"]
    assert len(geometry) >= 12
    z = [(result.x[i] - errors.get(result.parameters[i].name, 0.0)) / result.std[i] for i in geometry]
    # Correlated standard normals: beyond 4 happens once in ten thousand.
    assert np.abs(z).max() < 4
    assert 0.8 < result.variance < 1.25  # χ² over its ~330 degrees of freedom: ± 3 σ


def test_what_cannot_be_told_apart_is_said_in_words(six: Any) -> None:
    result = six[3]
    words = "\n".join(result.identifiability.words)
    assert "j6.d and tool.z move what was measured the same way" in words
    assert "j2.d and j3.d move what was measured the same way" in words
    names = {p.name: bool(fixed) for p, fixed in zip(result.parameters, result.fixed, strict=True)}
    assert not names["j1.theta"]  # base.yaw turns the same way
    assert names["j2.a"]
    rank, count = result.identifiability.rank, len(result.parameters)
    assert rank + result.identifiability.null.shape[1] == count


def test_a_planar_arm_measured_in_its_plane() -> None:
    rng = np.random.default_rng(4)
    problem = problem_of(TWO, robot={"base": {"xyz": ["0 m"] * 3}, "tool": {"xyz": ["0 m"] * 3}})
    errors = {"j1.theta": 2e-3, "j2.theta": -3e-3, "j1.a": 1e-3, "j2.a": -2e-3}
    q = rng.uniform(-2.5, 2.5, (60, 2))
    points = simulated_points(TWO, q, np.eye(4), np.eye(4), errors) + rng.normal(0, 2e-5, (60, 3))
    result = po.calibrate(problem, rows(problem, q, points[:, :2]))
    names = [p.name for p in result.parameters]
    assert not any(name.startswith(("base", "tool")) for name in names)  # stated, hence known
    for name in ("j1.theta", "j1.a", "j2.theta", "j2.a"):
        j = names.index(name)
        assert result.fixed[j]
        assert abs(result.x[j] - errors[name]) < 4 * result.std[j]
    assert "j1.d moves nothing that was measured" in result.identifiability.words
    assert result.calibrated.rms < 2e-5 * np.sqrt(2) * 1.3


def test_stated_sigmas_are_priors_and_decide_what_data_cannot() -> None:
    rng = np.random.default_rng(6)
    sigma = {"j1.theta": "1 mrad", "j2.theta": "1 mrad", "j1.a": "1 mm", "j2.a": "1 mm"}
    problem = problem_of(TWO, robot={"base": "free", "tool": {"xyz": ["0 m"] * 3}}, uncertainty={"sigma": sigma})
    q = rng.uniform(-2.5, 2.5, (60, 2))
    points = simulated_points(TWO, q, np.eye(4), np.eye(4), {"j1.a": 1e-3}) + rng.normal(0, 2e-5, (60, 3))
    data = rows(problem, q, points)
    with_priors, without = po.calibrate(problem, data), po.calibrate(problem, data, priors=False)
    names = [p.name for p in with_priors.parameters]
    j = names.index("j1.theta")
    assert not without.fixed[j]
    assert with_priors.fixed[j]
    # The data say nothing about it beside base.yaw, so that the prior's σ is what is left.
    assert with_priors.std[j] == pytest.approx(1e-3, rel=0.02)
    assert abs(with_priors.x[names.index("j1.a")] - 1e-3) < 4 * with_priors.std[names.index("j1.a")]


def test_gross_outliers_are_named_and_good_rows_kept(six: Any) -> None:
    problem, data, _, clean = six
    points = np.array(data.position)
    points[[3, 50, 99]] += [[2e-3, 0, 0], [0, -0.05, 0], [0.3, 0.3, 0.0]]
    result = po.calibrate(problem, rows(problem, data.q, points))
    assert result.outliers == (3, 50, 99)
    fixed = result.fixed & clean.fixed
    assert np.abs((result.x - clean.x)[fixed] / clean.std[fixed]).max() < 1.5


def test_too_few_poses_and_several_robots_are_refused(six: Any) -> None:
    problem, data, _, _ = six
    with pytest.raises(po.errors.InsufficientDataError, match="poses"):
        po.calibrate(problem, data.take(np.arange(5)))
    batch = rows(problem, data.q, np.array(data.position), robot=["a", "b"] * 60)
    with pytest.raises(po.errors.InputError, match="several robots"):
        po.calibrate(problem, batch)


def load(folder: str, file: str, problem: str = "problem.yaml") -> tuple[Any, Callable[[str], po.Measurements]]:
    loaded = po.load_problem(DATA / folder / problem)
    return loaded, lambda name=file: po.read_measurements(DATA / folder / name, loaded)


@long_on_real_arms
def test_ur5_predicts_another_session() -> None:
    problem, read = load("jacobi_ur5", "grid.csv")
    result = po.calibrate(problem, read("grid.csv"), test=read("random.csv"))
    # 0.155 mm was published, with a neural network; nothing is refitted here, the frames neither.
    assert result.test.models["calibrated"].mean < 0.105e-3
    assert result.test.models["nominal"].mean > 0.4e-3
    assert result.calibrated.rms < 0.115e-3


@long_on_real_arms
@pytest.mark.parametrize(("file", "every"), [("series_b.csv", 3), ("series_a.csv", 20)])
def test_ur10_geometry(file: str, every: int) -> None:
    problem, read = load("ipa_ur10", file)
    data = read(file)
    result = po.calibrate(
        problem, data.take(np.arange(0, len(data), every))
    )  # a third of 1495, a twentieth of 11911: for time
    assert result.calibrated.rms < 0.45e-3
    assert result.nominal.rms > 0.8e-3


@long_on_real_arms
@pytest.mark.parametrize(("file", "problem", "most"), [("panda_3", "panda", 0.22e-3), ("kuka_14", "iiwa", 0.30e-3)])
def test_sockets_calibrate_without_an_instrument(file: str, problem: str, most: float) -> None:
    loaded, read = load("mukca_sockets", f"{file}.csv", f"problem_{problem}.yaml")
    result = po.calibrate(loaded, read(f"{file}.csv"))
    # All rows, the two outliers of kuka_14 among them; every place is predicted by an arm that never touched it.
    # The published figures are spreads about the mean of n touches: √((n − 1) / n) of the error of a touch.
    n = np.bincount(result.request.data.point)[result.request.data.point]
    assert np.sqrt(((result.errors**2).sum(axis=1) * (n - 1) / n).mean()) < most
    assert any("size of the arm" in note for note in result.notes)


def test_progress_is_told_from_the_first_fit_to_the_last(six: Any) -> None:
    problem, data, _, _ = six
    told: list[tuple[int, int]] = []
    po.calibrate(problem, data, folds=3, progress=lambda done, total: told.append((done, total)))
    assert told == [(i, 7) for i in range(1, 8)]  # one fit to everything, three folds twice
