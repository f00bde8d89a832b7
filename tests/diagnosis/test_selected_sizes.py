"""Standard errors with the choice of effects in them: by hand, where folds choose alike, differ, or lack an effect."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import posture_opt as po
from posture_opt.calibration.estimation.error_statistics import folds_of, groups_of
from posture_opt.diagnosis.causes.selected_sizes import choice_deviations, with_choice_errors
from posture_opt.diagnosis.search.linearised_data import linearise_calibration
from posture_opt.diagnosis.search.nested_selection import NestedSelection
from posture_opt.model.effects import Effect
from posture_opt.model.effects.gear_eccentricity import GearEccentricity
from posture_opt.model.effects.gear_second_harmonic import GearSecondHarmonic
from tests.helpers.planar_2r import position
from tests.helpers.planar_files import PROBLEM, write

NOISE = 2e-5  # m
FIRST, OTHER = GearEccentricity(joint="joint1"), GearSecondHarmonic(joint="joint1")


def test_a_size_that_depends_on_its_neighbour_is_less_sure(tmp_path: Path) -> None:
    """A joint that turned by 57 degrees: its first and second harmonic trade, and three of five folds take both."""
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
    names = [p.name for p in model.residuals.parameters]
    own = [names.index(name) for name in ("joint1.theta", *FIRST.parameter_names)]

    def added(*sets: tuple[Effect, ...]) -> np.ndarray:
        nested = NestedSelection(linearised, folds, groups, tuple(((), *[s] * 2) for s in sets), np.zeros((3, len(q))))
        wider = with_choice_errors(model, choice_deviations(model, geometry, nested, 2))
        return np.asarray((wider.covariance - model.covariance)[np.ix_(own, own)])

    measured = np.asarray(residuals.data.position)
    scale = np.sqrt(np.diag(model.covariance)[own])
    np.testing.assert_allclose(added(*[(FIRST,)] * 5) / np.outer(scale, scale), 0, atol=1e-4)  # chosen alike
    # A fold that lacks the first harmonic says how large it would be beside the second.
    found = added((FIRST, OTHER), (OTHER, FIRST), (FIRST,), (FIRST,), (OTHER,))
    expected = by_hand(q, measured, folds, [True, True, False, False, True])
    np.testing.assert_allclose(found / np.outer(scale, scale), expected / np.outer(scale, scale), rtol=0.05)
    assert np.all(np.diag(found) > 9 * scale**2)
    # One is enough, two predict better: half of the sets that are compared have both.
    losses = np.repeat([[3.0], [2.0], [1.0]], len(q), axis=1)
    nested = NestedSelection(linearised, folds, groups, (((), (FIRST,), (FIRST, OTHER)),) * 5, losses)
    wider = with_choice_errors(model, choice_deviations(model, geometry, nested, 1))
    found = (wider.covariance - model.covariance)[np.ix_(own, own)]
    expected = by_hand(q, measured, folds, [True] * 5) / 2
    np.testing.assert_allclose(found / np.outer(scale, scale), expected / np.outer(scale, scale), rtol=0.05)


def by_hand(q: np.ndarray, measured: np.ndarray, folds: list[np.ndarray], second: list[bool]) -> np.ndarray:
    """Mean square (3, 3) of what the second harmonic does to offset, sine and cosine, by least squares of each fold."""
    J = np.stack([(position(q + d) - position(q - d)) / 2e-6 for d in 1e-6 * np.eye(2)], axis=2)
    x, y = (position(q, a) for a in ((1, 0), (0, 1)))
    w = q[:, 0]
    waves = [J[:, :, 0] * f(k * w)[:, None] for k in (1, 2) for f in (np.sin, np.cos)]
    A = np.stack([J[:, :, 0], J[:, :, 1], x, y, *waves], axis=2)
    e = measured[:, :2] - position(q)
    total = np.zeros((3, 3))
    for left in (left for left, both in zip(folds, second, strict=True) if both):
        learn = np.setdiff1d(np.arange(len(q)), left)
        each = [np.linalg.lstsq(A[learn][:, :, :n].reshape(-1, n), e[learn].ravel(), rcond=None)[0] for n in (8, 6)]
        apart = (each[0][:6] - each[1])[[0, 4, 5]]
        total += np.outer(apart, apart)
    return (2.776 / 1.96) ** 2 * total / (len(folds) - 1)  # t of four degrees of freedom, from any table
