"""Calibration against a simulator of its own that hides errors, and against measurements of real arms."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import posture_opt as po
from tests.helpers.free_arms import BASE, SIX, TOOL, TWO, hidden_errors, problem_of, rows, simulated_points
from tests.helpers.instruments import TrueArm, distance_table
from tests.helpers.real_arms import DATA, long_on_real_arms, needs_real_arms
from tests.helpers.small_volume import NOISE, small_volume
from tests.helpers.variants import conformance
from tests.hidden.files import write


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


@needs_real_arms
@pytest.mark.parametrize(("file", "every"), [("series_b.csv", 3), ("series_a.csv", 20)])
def test_ur10_geometry(file: str, every: int) -> None:
    problem, read = load("ipa_ur10", file)
    data = read(file)
    result = po.calibrate(
        problem, data.take(np.arange(0, len(data), every))
    )  # a third of 1495, a twentieth of 11911: for time
    assert result.calibrated.rms < 0.45e-3
    assert result.nominal.rms > 0.8e-3


@needs_real_arms
@pytest.mark.parametrize(("file", "problem", "most"), [("panda_3", "panda", 0.22e-3), ("kuka_14", "iiwa", 0.30e-3)])
def test_sockets_calibrate_without_an_instrument(file: str, problem: str, most: float) -> None:
    loaded, read = load("mukca_sockets", f"{file}.csv", f"problem_{problem}.yaml")
    result = po.calibrate(loaded, read(f"{file}.csv"))
    # All rows, the two outliers of kuka_14 among them; every place is predicted by an arm that never touched it.
    # The published figures are spreads about the mean of n touches: √((n − 1) / n) of the error of a touch.
    n = np.bincount(result.request.data.point)[result.request.data.point]
    assert np.sqrt(((result.errors**2).sum(axis=1) * (n - 1) / n).mean()) < most
    assert any("size of the arm" in note for note in result.notes)


# --- Tolerances of parts as data ask for them: against densities of samples, and at an arm whose zeros are far off ----


def test_zeros_set_by_hand_do_not_loosen_the_lengths() -> None:
    """Zeros off by 5 mrad beside lengths of 0.1 mm, as of real arms: one width for all would leave lengths open."""
    rng = np.random.default_rng(31)
    errors = rng.normal(0, 1, (6, 4)) * np.array([5e-3, 1e-4, 1e-4, 3e-4])
    arm = TrueArm(errors=errors)
    tool = {"xyz": ["30 mm", "-20 mm", "120 mm"], "rpy": ["0 deg"] * 3, "free": True}
    given = po.problem_from_dict(
        {
            "robot": {"kind": "preset", "name": "ur10", "tool": tool},
            "uncertainty": {"measurement": {"distance": "0.02 mm"}},
        }
    )
    table = {k: v for k, v in distance_table(arm, rng, 15, 2e-5).items() if not k.endswith(".approach")}
    found = po.calibrate(given, po.read_measurements(table, given), folds=2, plan=False)
    width = dict(zip((p.name for p in found.parameters), found.prior.tolist(), strict=True))
    assert width["elbow.a"] < 0.4e-3
    assert width["elbow.theta"] > 2e-3
    assert any("lengths 0." in note and "zeros of joints" in note for note in found.notes)


# --- Very many rows: thinned, said in a field and in words, the rest predicted as it is by hand -----------------------

COUNT, USED = 900, 150


@pytest.fixture(scope="module")
def large() -> tuple[Any, Any]:
    rng = np.random.default_rng(5)
    problem = problem_of(SIX)
    q = rng.uniform(-2.5, 2.5, (COUNT, 6))
    data = rows(problem, q, simulated_points(SIX, q, BASE, TOOL, hidden_errors(SIX, rng, ("j2",))))
    return problem, replace(data, position=data.position + rng.normal(0, 2e-5, (COUNT, 3)))


def test_a_calibration_says_what_it_used_and_predicts_the_rest(large: Any) -> None:
    problem, data = large
    found = po.calibrate(problem, data, most_rows=USED, plan=False)
    told = found.to_json()["thinned"]
    assert told["rows"] == COUNT
    assert told["rows_used"] + told["rows_left_out"] == COUNT
    assert abs(told["rows_used"] - USED) <= 2
    rest = found.large.thinning.rest  # type: ignore[union-attr]
    by_hand = po.calibrate(problem, found.request.data, test=data.take(rest), plan=False).test
    assert told["left_out"]["calibrated"]["rms"] == pytest.approx(by_hand.models["calibrated"].rms, rel=1e-9)  # type: ignore[union-attr]
    # Noise of 20 µm a coordinate, and what 150 rows leave uncertain of some thirty parameters.
    assert told["left_out"]["calibrated"]["rms"] == pytest.approx(2e-5 * 3**0.5, rel=0.1)
    assert told["fit_uncertainty_rms"] == pytest.approx(2e-5 * (found.fit.directions.shape[1] / USED) ** 0.5, rel=0.2)
    assert f"{told['rows_used']} of {COUNT} rows were fitted" in " ".join(found.report().split())


# --- Free frames in small volumes at constant orientation: base and tool stay near, and the errors are noise ----------
# Seeds 100 to 106 were used while the method was chosen; those here were not.


@pytest.mark.parametrize(
    ("seed", "name", "rows", "tilt", "digits"),
    conformance(
        [
            (700, "ur10", 60, 0.0, 9),
            (701, "kr16", 100, 0.0, 3),
            (702, "seven", 150, 0.0, 4),
            (703, "kr16", 60, 0.0, 2),
            (704, "ur10", 100, 0.02, 4),
            (705, "seven", 60, 0.001, 3),
        ],
        always=[(704, "ur10", 100, 0.02, 4)],
    ),
)
def test_frames_stay_near_and_errors_are_noise(
    seed: int, name: str, rows: int, tilt: float, digits: int, tmp_path: Path
) -> None:
    case, arm = small_volume(seed, name, rows, tilt=tilt, digits=digits)
    problem = po.load_problem(write(case, tmp_path))
    found = po.calibrate(problem, po.read_measurements(tmp_path / "data.csv", problem))
    value = {p.name: p.nominal + x for p, x in zip(found.parameters, found.x, strict=True)}
    for frame, factors in (("base", arm.base), ("tool", arm.tool)):
        off = [value[f"{frame}.{axis}"] - f.value for axis, f in zip("xyz", factors[:3], strict=True)]
        assert np.linalg.norm(off) < 0.5  # m: far less than the arms' reach of 1.1 to 1.8
    fitted = np.sqrt(np.mean(np.sum(found.errors_fitted**2, axis=1)))
    assert fitted < np.sqrt(3) * NOISE * 1.1
    assert found.calibrated.rms < np.sqrt(3) * NOISE * 1.5
    # At constant orientation nothing tells base and tool apart, and that is said.
    if not tilt:
        assert "tool." in " ".join(found.identifiability.words)
        where = [p.name for p in found.parameters].index("tool.x")
        assert not found.fixed[where] or found.std[where] > 0.01
