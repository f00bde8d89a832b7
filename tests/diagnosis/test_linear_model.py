"""Short ways through inner products, against the long ones through all rows."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

import posture_opt as po
from posture_opt.calibration.cross_validation import held_out
from posture_opt.calibration.estimation.effects_fit import fit_with_effects
from posture_opt.calibration.estimation.fit import Fit
from posture_opt.calibration.estimation.linear_model import LinearModel
from posture_opt.diagnosis.scores.candidates import Candidate, list_candidates
from posture_opt.diagnosis.scores.levels import MIN_SURVIVING_SHARE
from posture_opt.diagnosis.scores.score_tests import explained_squares
from posture_opt.diagnosis.search.linearised_data import LinearisedData, linearise_calibration
from posture_opt.diagnosis.search.selection_criterion import rank_members
from tests.helpers.planar_2r import position
from tests.helpers.planar_files import PROBLEM, write


@pytest.fixture(scope="module")
def linearised(tmp_path_factory: pytest.TempPathFactory) -> LinearisedData:
    rng = np.random.default_rng(3)
    q = rng.uniform(-2.5, 2.5, (80, 2))
    error = np.stack([3e-4 * np.sin(q[:, 0]), 2e-4 * np.cos(2 * q[:, 1])], axis=1)
    file = tmp_path_factory.mktemp("linear") / "data.csv"
    write(file, q, position(q + error) + rng.normal(0, 2e-5, q.shape))
    problem = po.problem_from_dict(PROBLEM)
    return linearise_calibration(po.calibrate(problem, po.read_measurements(file, problem)), flips=20)


@pytest.fixture(scope="module")
def member(linearised: LinearisedData) -> Callable[[str, str], Candidate]:
    everyone = list_candidates(linearised.sensitivities, linearised.excitation, linearised.G)
    return lambda kind, target: next(s for s in everyone if (s.kind, s.target) == (kind, target))


@pytest.fixture(scope="module")
def model(linearised: LinearisedData, member: Callable[[str, str], Candidate]) -> Fit:
    effects = [member("gear_eccentricity", "joint1").what, member("gear_second_harmonic", "joint2").what]
    directions = np.linalg.svd(linearised.G, full_matrices=False)  # any directions do, as long as they are determined
    k = len(linearised.sensitivities.x)
    J = linearised.sensitivities.residuals.residuals_and_jacobian(linearised.sensitivities.x)[1]
    V = np.linalg.svd(J, full_matrices=False)[2][: linearised.G.shape[1]]
    assert V.shape == (len(directions[1]), k)
    return fit_with_effects(linearised.sensitivities.residuals, linearised.sensitivities.x, V.T, effects)


def test_candidates_from_inner_products(linearised: LinearisedData) -> None:
    baseline = linearised.baseline()
    everyone = list_candidates(linearised.sensitivities, linearised.excitation, linearised.G)
    rho, sizes, gains = explained_squares(baseline, [s.Z for s in everyone])
    for i, s in enumerate(everyone):
        unit = s.Z / np.maximum(np.linalg.norm(s.Z, axis=0), 1e-300)
        rest = unit - baseline.Q @ (baseline.Q.T @ unit)
        assert rho[i] == pytest.approx(np.linalg.norm(rest, axis=0).max(), abs=1e-7)
        if rho[i] < MIN_SURVIVING_SHARE:
            assert sizes[i] == 0
            continue
        U, singular, _ = np.linalg.svd(rest, full_matrices=False)
        U = U[:, singular > max(MIN_SURVIVING_SHARE, 1e-6 * singular[0])]
        assert sizes[i] == U.shape[1]
        np.testing.assert_allclose(gains[i], np.sum((U.T @ baseline.flipped) ** 2, axis=0), rtol=1e-8, atol=1e-8)


def test_members_are_worth_as_much_in_few_coordinates(
    linearised: LinearisedData, member: Callable[[str, str], Candidate]
) -> None:
    members = [member("gear_eccentricity", "joint1"), member("gear_second_harmonic", "joint2")]
    small, few = linearised.reduced(members)
    assert len(small.r) < 20
    whole, part = linearised.baseline([members[0]], flips=0), small.baseline([few[0]], flips=0)
    assert part.freedom == whole.freedom
    assert part.rss[0] == pytest.approx(whole.rss[0], rel=1e-10)
    chosen, weights = rank_members(linearised, members)
    rest = linearised.baseline(members, flips=0).rss[0]
    alone = [linearised.baseline([s], flips=0) for s in chosen[::-1]]  # each without the other
    for (p, _), baseline in zip(weights, alone, strict=True):
        # The leading term of the F test of two directions; the rest of it is of the order of one.
        assert p == pytest.approx((baseline.freedom - 2) / 2 * np.log(rest / baseline.rss[0]), abs=1e-6)


@pytest.mark.parametrize("without", [None, 0, 1])
def test_folds_by_coordinates_are_refits_by_rows(model: Fit, without: int | None) -> None:
    residuals = model.residuals
    folds = [np.asarray(part) for part in np.array_split(np.random.default_rng(0).permutation(len(residuals.data)), 5)]
    found = held_out(model, folds, without)
    r, J = residuals.residuals_and_jacobian(model.x)
    kept = [i for i in range(len(model.effects)) if i != without]
    if without is not None:
        r = r - J[:, model.slices[without]] @ model.x[model.slices[without]]
    Z = np.concatenate([J[:, model.slices[i]] for i in kept], axis=1)
    A = np.concatenate([J @ model.directions[:, model.geometry], Z / np.linalg.norm(Z, axis=0)], axis=1)
    for left_out in folds:
        theirs = (left_out[:, None] * 2 + np.arange(2)).ravel()
        mine = np.setdiff1d(np.arange(len(r)), theirs)
        step = np.linalg.lstsq(A[mine], -r[mine], rcond=None)[0]
        expected = (r[theirs] + A[theirs] @ step).reshape(-1, 2) * residuals.sigma
        np.testing.assert_allclose(found.errors[left_out, :2], expected, atol=1e-10)


def test_the_rest_takes_over_what_an_effect_leaves(model: Fit) -> None:
    step = LinearModel.of(model).refitted(0)
    r, J = model.residuals.residuals_and_jacobian(model.x)
    geometry = model.directions[:, model.geometry]
    own, other = model.slices
    A = np.concatenate([J @ geometry, J[:, other]], axis=1)
    direct = np.linalg.lstsq(A, -(r - J[:, own] @ model.x[own]), rcond=None)[0]
    np.testing.assert_allclose(step[: own.start], (geometry @ direct[:-2])[: own.start], atol=1e-9)
    np.testing.assert_allclose(step[other], direct[-2:], atol=1e-9)
    assert not step[own].any()
