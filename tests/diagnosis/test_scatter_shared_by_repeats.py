"""Rows of one visit share the joints' scatter: they are no repeats, and no independent witnesses of it."""

from __future__ import annotations

import numpy as np
import pytest
import yaml

import posture_opt as po
from posture_opt.calibration.calibrate import calibrate
from posture_opt.calibration.estimation.effects_fit import fit_with_effects
from posture_opt.diagnosis.noise import noise_causes
from posture_opt.diagnosis.noise.noise_candidates import score_stated_sigma, score_uneven_noise
from posture_opt.diagnosis.noise.uneven_noise import NoiseSample, find_uneven_noise
from posture_opt.diagnosis.scores import levels
from posture_opt.diagnosis.scores.lack_of_fit import assess_adequacy
from posture_opt.diagnosis.scores.score_tests import ProjectedBaseline
from posture_opt.diagnosis.search.linearised_data import linearise_calibration
from posture_opt.measurements.repeats import Contrasts, repeat_groups
from posture_opt.model.effects import Rows
from posture_opt.validation.scatter_model import whitened_repeats
from tests.helpers.planar_files import SHORT


def lack_of_fit(seed: int, passes: int, readings: int, targets: int, wrong: float = 0.0) -> float:
    """Of visits that scatter by 5 about a model that is ``wrong`` at each of 40 poses, by 1 from row to row."""
    rng = np.random.default_rng(seed)
    order = np.tile(np.repeat(np.arange(40), readings * targets), passes)
    visit = np.repeat(np.arange(40 * passes), readings * targets)
    q = rng.uniform(-2, 2, (40, 2))[order]
    table = {"joint1 [rad]": q[:, 0], "joint2 [rad]": q[:, 1], "x [m]": rng.normal(size=len(q)), "y [m]": 0.0 * order}
    table["target"] = np.tile(np.arange(targets), len(q) // targets).astype(str)
    data = po.read_measurements(table, po.problem_from_dict(yaml.safe_load(SHORT)))
    e = 5 * rng.normal(size=(visit.max() + 1, 2))[visit] + rng.normal(size=(len(q), 2))
    e += wrong * rng.normal(size=(40, 2))[order]
    baseline = ProjectedBaseline.of(e.ravel(), rng.normal(size=(e.size, 4)), np.repeat(order, 2), 19, 0)
    groups = repeat_groups(data, np.zeros(2, dtype=bool))
    return assess_adequacy(baseline, data, groups, np.column_stack([q, order]), 2).lack_of_fit


@pytest.mark.parametrize(("readings", "targets"), [(3, 1), (1, 2), (2, 2)])
def test_readings_and_targets_of_one_visit_are_no_repeats(readings: int, targets: int) -> None:
    assert lack_of_fit(1, 1, readings, targets) == 1.0
    # Visits with others between them are: right models pass, wrong ones do not.
    assert min(lack_of_fit(seed, 3, readings, targets) for seed in range(4)) > 0.01
    assert lack_of_fit(1, 3, readings, targets, wrong=15.0) < 1e-3


@pytest.mark.parametrize(("wrong", "verdict"), [(0.0, "effects_found"), (2e-4, "unexplained")])
def test_a_noisy_joint_is_no_lack_of_fit_where_the_repeats_hardly_show_it(wrong: float, verdict: str) -> None:
    """Repeats of a folded arm, which its first joint moves a fourth as far as most rows, and a model that is wrong."""
    rng = np.random.default_rng(1)
    q = np.concatenate([rng.uniform(-2.8, 2.8, (70, 2)), np.tile([[0.4, 2.75]], (15, 1))])
    shift = np.concatenate([rng.normal(0, wrong, (70, 2)), np.tile(rng.normal(0, wrong, (1, 2)), (15, 1))])
    order = rng.permutation(len(q))
    q, shift = q[order], shift[order]
    first = q[:, 0] + rng.normal(0, 5e-4, len(q))
    both = first + q[:, 1]
    p = 0.5 * np.stack([np.cos(first), np.sin(first)], 1) + 0.4 * np.stack([np.cos(both), np.sin(both)], 1)
    p += shift + rng.normal(0, 2e-5, p.shape)
    table = {"joint1 [rad]": q[:, 0], "joint2 [rad]": q[:, 1], "x [m]": p[:, 0], "y [m]": p[:, 1]}
    problem = po.problem_from_dict(yaml.safe_load(SHORT) | {"uncertainty": {"measurement": {"position": "0.02 mm"}}})
    found = po.diagnose(problem, po.read_measurements(table, problem), plan=False)
    assert found.verdict == verdict
    if not wrong:
        assert ("joint_noise", "joint1") in [(effect.kind, effect.target) for effect in found.effects]
        assert 0.01 < found.adequacy.lack_of_fit < 0.99


def test_a_scatter_of_nothing_leaves_the_residual_variance_as_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    """24 residuals and some 5 unknowns: leverage taken off twice would swell the variance by a fourth."""
    seen = []
    monkeypatch.setattr(
        noise_causes, "score_stated_sigma", lambda *given: seen.append(given[0]) or score_stated_sigma(*given)
    )
    rng = np.random.default_rng(3)
    q = rng.uniform(-2, 2, (12, 2))
    first, both = q[:, 0], q.sum(axis=1)
    p = 0.5001 * np.stack([np.cos(first), np.sin(first)], 1) + 0.4 * np.stack([np.cos(both), np.sin(both)], 1)
    p += rng.normal(0, 2e-5, p.shape)
    table = {"joint1 [rad]": q[:, 0], "joint2 [rad]": q[:, 1], "x [m]": p[:, 0], "y [m]": p[:, 1]}
    for scatter in ({}, {"joint1.theta": "1e-9 mrad"}):
        document = yaml.safe_load(SHORT) | {"uncertainty": {"measurement": {"position": "0.02 mm"}, "scatter": scatter}}
        stated = po.problem_from_dict(document)
        calibration = calibrate(stated, po.read_measurements(table, stated), folds=2)
        model = fit_with_effects(calibration.residuals, calibration.x, calibration.identifiability.directions, [])
        noise_causes.noise_causes(stated, calibration, model, linearise_calibration(calibration, 9).baseline(), 1.0, 0)
    assert seen[1] == pytest.approx(seen[0], rel=0.1)


@pytest.mark.campaign
def test_rows_of_one_visit_are_no_independent_witnesses_of_a_noisy_joint(monkeypatch: pytest.MonkeyPatch) -> None:
    """40 sets of 30 visits, four readings each that repeat what the visit was off by, anywhere: 5 % are below 5 %."""
    monkeypatch.setattr(levels, "NOISE_DRAWS", 99)
    rng, visits = np.random.default_rng(5), np.repeat(np.arange(30), 4)
    robot = po.problem_from_dict(yaml.safe_load(SHORT)).robot
    p = []
    for seed in range(40):
        e = rng.normal(size=(30, 2))[visits] + 0.1 * rng.normal(size=(120, 2))
        rows = Rows(robot, rng.normal(size=(2, 30, 2))[:, visits], None, 2e-5, visits)
        p.append(score_uneven_noise(e, rows, seed)[0].p_value)
    assert np.sum(np.array(p) < 0.05) <= 6


def test_stated_scatter_of_a_joint_is_taken_off_whole_visits() -> None:
    rng, visits = np.random.default_rng(6), np.array([0, 0, 0, 1, 2, 2])
    S, own = rng.normal(size=(6, 2, 2)), rng.uniform(1, 2, (6, 2))
    shared = np.where(visits[:, None] == visits, 1.0, 0.0).repeat(2, axis=0).repeat(2, axis=1)
    covariance = np.diag(own.ravel()) + shared * (S.reshape(12, 2) @ S.reshape(12, 2).T)
    e = rng.normal(size=(6, 2))
    found, columns = whitened_repeats(e, np.stack([e, 2 * e]), S, visits, own)
    assert np.sum(found**2) == pytest.approx(e.ravel() @ np.linalg.solve(covariance, e.ravel()))
    np.testing.assert_allclose(columns, np.stack([found, 2 * found]))


def sample(rng: np.random.Generator, rows: int, sigma: tuple[float, float]) -> NoiseSample:
    """Residuals of a planar arm whose joints scatter by ``sigma``, in units of its instrument."""
    q = rng.uniform(-2.5, 2.5, (rows, 2))
    elbow, tool = (np.stack([-np.sin(a), np.cos(a)], 1) / 2e-5 for a in (q[:, 0], q.sum(axis=1)))
    c = np.stack([0.5 * elbow + 0.4 * tool, 0.4 * tool])
    e = rng.normal(size=(rows, 2)) + np.einsum("nj,jnd->nd", rng.normal(size=(rows, 2)) * sigma, c)
    robot = po.problem_from_dict(yaml.safe_load(SHORT)).robot
    return NoiseSample(e, Rows(robot, c, None, 2e-5))


@pytest.mark.parametrize(("sigma", "named"), [((1e-4, 1e-4), ["joint1", "joint2"]), ((2e-4, 0.0), ["joint1"])])
def test_every_noisy_joint_is_named(sigma: tuple[float, float], named: list[str]) -> None:
    rng = np.random.default_rng(1)
    found, uneven = find_uneven_noise(sample(rng, 150, sigma), sample(rng, 100, sigma), 0)
    assert not uneven
    assert [cause.effect.target for cause in found] == named
    assert not any(cause.confounded_with for cause in found)
    for cause, true in zip(found, sigma, strict=False):
        assert cause.effect.stated[0][1] == pytest.approx(true, rel=0.3)


@pytest.mark.parametrize(("contrasts", "refuted"), [(0, False), (4, False), (100, True)])
def test_a_joint_whose_repeats_do_not_scatter_is_not_named(contrasts: int, refuted: bool) -> None:
    rng = np.random.default_rng(2)
    found, uneven = find_uneven_noise(sample(rng, 150, (2e-4, 0.0)), sample(rng, contrasts, (0.0, 0.0)), 0)
    assert not found
    assert [(errors.effect.target, errors.refuted) for errors in uneven] == [("joint1", refuted)]
    assert uneven[0].p_value < 1e-3


def test_contrasts_are_what_repeats_differ_by() -> None:
    """Helmert's contrasts of four repeats by hand; readings that follow each other count by their mean."""
    order = [0, 1, 0, 2, 0, 0, 1, 0]
    q = np.array([[0.1, 0.2], [0.5, -0.3], [1.0, 1.0]])[order]
    x = np.array([1.0, 5.0, 2.0, 9.0, 3.0, 5.0, 8.0, 7.0])
    table = {"joint1 [rad]": q[:, 0], "joint2 [rad]": q[:, 1], "x [m]": x, "y [m]": 0 * x}
    data = po.read_measurements(table, po.problem_from_dict(yaml.safe_load(SHORT)))
    contrasts = Contrasts.of(data, np.zeros(2, dtype=bool))
    h = [np.sqrt(1 / 2) * (1 - 2), np.sqrt(2 / 3) * (1.5 - 4), np.sqrt(3 / 4) * (7 / 3 - 7), np.sqrt(1 / 2) * (5 - 8)]
    np.testing.assert_allclose(contrasts.differences(x), h)
    half = [1.0, 2 / 3 * (1 / 2 + 1 / 2), 3 / 4 * ((1 + 1 + 1 / 2) / 9 + 1), 1.0]
    np.testing.assert_allclose(contrasts.reading, half)
    # The same at every repeat, whatever it is from posture to posture: nothing is left.
    np.testing.assert_allclose(contrasts.differences(q[:, 0] ** 2), 0.0, atol=1e-12)


def test_sides_separate_repeats_of_joints_whose_side_matters() -> None:
    q = np.array([0.1, 0.5, 0.1, 0.5])
    table = {"joint1 [rad]": q, "joint2 [rad]": q, "x [m]": q, "y [m]": q}
    table |= {"joint1.approach": [1, 1, -1, -1], "joint2.approach": [1, 1, 1, 1]}
    data = po.read_measurements(table, po.problem_from_dict(yaml.safe_load(SHORT)))
    still = np.zeros(2, dtype=bool)
    assert [len(Contrasts.of(data, still, np.array(sided))) for sided in ([], [1], [0])] == [2, 2, 0]


@pytest.mark.parametrize("column", ["target", "payload [kg]"])
def test_what_was_measured_otherwise_is_no_repeat(column: str) -> None:
    q = np.array([0.1, 0.5, 0.1, 0.5])
    values = {"target": ["a", "a", "b", "b"], "payload [kg]": [0, 0, 5, 5]}[column]
    table = {"joint1 [rad]": q, "joint2 [rad]": q, "x [m]": q, "y [m]": q}
    problem = po.problem_from_dict(yaml.safe_load(SHORT))
    still = np.zeros(2, dtype=bool)
    assert len(Contrasts.of(po.read_measurements(table, problem), still)) == 2
    assert len(Contrasts.of(po.read_measurements(table | {column: values}, problem), still)) == 0
