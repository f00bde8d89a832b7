"""Standard errors with the choice of effects in them: by hand, and where every fold chooses alike."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import posture_opt as po
from posture_opt.calibration.estimation.error_statistics import folds_of, groups_of
from posture_opt.diagnosis.causes.selected_sizes import selection_factors, with_selection_errors
from posture_opt.diagnosis.search.linearised_data import linearise_calibration
from posture_opt.diagnosis.search.nested_selection import NestedSelection
from posture_opt.model.effects.gear_eccentricity import GearEccentricity
from posture_opt.model.effects.gear_second_harmonic import GearSecondHarmonic
from tests.helpers.planar_2r import position
from tests.helpers.planar_files import PROBLEM, write

NOISE = 2e-5  # m
FIRST, OTHER = GearEccentricity(joint="joint1"), GearSecondHarmonic(joint="joint1")


def test_a_size_that_depends_on_its_neighbour_is_less_sure(tmp_path: Path) -> None:
    """A joint that turned by 57 degrees: its first and second harmonic trade, and two of five folds take both."""
    rng = np.random.default_rng(4)
    q = rng.uniform((-0.5, -2.5), (0.5, 2.5), (120, 2))
    turned = q + np.outer(3e-4 * np.sin(q[:, 0]) + 2e-4 * np.sin(2 * q[:, 0]), [1, 0])
    write(tmp_path / "data.csv", q, position(turned) + rng.normal(0, NOISE, q.shape))
    problem = po.problem_from_dict(PROBLEM)
    calibration = po.calibrate(problem, po.read_measurements(tmp_path / "data.csv", problem))
    linearised = linearise_calibration(calibration, flips=0)
    residuals = linearised.sensitivities.residuals
    groups = groups_of(residuals.data, "pose", 5)
    folds = folds_of(groups, 5, "pose")
    geometry, model = (calibration.fit_effects(residuals, effects) for effects in ([], [FIRST]))

    def factor(*second: bool) -> float:
        sets = tuple(((), (FIRST,), (FIRST, OTHER) if more else (FIRST,)) for more in second)
        nested = NestedSelection(linearised, folds, groups, sets, np.zeros((3, len(q))))
        return selection_factors(model, geometry, nested, 2)[FIRST.kind, FIRST.target]

    # Five estimates of two parameters: between 1 and the root of a mean of 8 squares, 1.6 at 1 in 100.
    assert 1 <= factor(*[False] * 5) < 1.7
    found = factor(True, True, False, False, False)
    assert found == pytest.approx(by_hand(q, np.asarray(residuals.data.position), folds, model), rel=0.05)
    assert found > 3
    wider = with_selection_errors(model, {(FIRST.kind, FIRST.target): found})
    own = model.slices[0]
    np.testing.assert_allclose(wider.std[own], found * model.std[own])
    np.testing.assert_allclose(wider.covariance[: own.start], model.covariance[: own.start])
    assert np.linalg.eigvalsh(wider.C).min() > 0


def by_hand(q: np.ndarray, measured: np.ndarray, folds: list[np.ndarray], model) -> float:  # type: ignore[no-untyped-def]
    """Root of the jackknife variance of the first harmonic over its variance by least squares of all rows."""
    J = np.stack([(position(q + d) - position(q - d)) / 2e-6 for d in 1e-6 * np.eye(2)], axis=2)
    x, y = (position(q, a) for a in ((1, 0), (0, 1)))
    w = q[:, 0]
    waves = [J[:, :, 0] * f(k * w)[:, None] for k in (1, 2) for f in (np.sin, np.cos)]
    A = np.stack([J[:, :, 0], J[:, :, 1], x, y, *waves], axis=2)
    e = measured[:, :2] - position(q)
    moved = []
    for k, left in enumerate(folds):
        learn = np.setdiff1d(np.arange(len(q)), left)
        n = 8 if k < 2 else 6
        z = np.linalg.lstsq(A[learn][:, :, :n].reshape(-1, n), e[learn].ravel(), rcond=None)[0]
        moved.append(A[:, :, 4:6] @ z[4:6])
    spread = np.array(moved) - np.mean(moved, axis=0)
    B, C = A[:, :, 4:6].reshape(-1, 2), model.covariance[model.slices[0], model.slices[0]]
    return float(np.sqrt(4 / 5 * np.sum(spread**2) / np.trace(B.T @ B @ C)))
