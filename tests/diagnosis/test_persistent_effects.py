"""The part of a fitted arm that outlasts its session: it is fitted for the rest to be absent, and as sure as it is."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares

import posture_opt as po
from posture_opt.calibration.estimation.error_statistics import folds_of, groups_of
from tests.helpers.planar_2r import position
from tests.helpers.planar_files import PLANAR, write

NOISE = 2e-5  # m, of each measured coordinate
SINE, SHIFT = 1e-4, 1e-4  # rad of joint1's gear; m in x and y
WAVE = np.array([0.55e-4, 0.23e-4, 20.3])  # rad, rad of joint1; cycles a turn
PROBLEM = PLANAR + "uncertainty: {measurement: {position: 0.02 mm}}\n"


def measured(folder: Path) -> tuple[po.Problem, po.Measurements]:
    """150 rows, one every 10 s, of an arm with an eccentric gear that drifts with 300 s."""
    rng = np.random.default_rng(5)
    q, t = rng.uniform(-2.5, 2.5, (150, 2)), np.arange(150) * 10.0
    turned = q + np.stack([SINE * np.sin(q[:, 0]), 0 * t], axis=1)
    drifted = SHIFT * (1 - np.exp(-t / 300))
    write(folder / "data.csv", q, position(turned) + drifted[:, None] + rng.normal(0, NOISE, q.shape), time=("s", t))
    (folder / "problem.yaml").write_text(PROBLEM, encoding="utf-8")
    problem = po.load_problem(folder / "problem.yaml")
    return problem, po.read_measurements(folder / "data.csv", problem)


@pytest.mark.long
def test_the_file_says_what_the_report_says(tmp_path: Path) -> None:
    problem, data = measured(tmp_path)
    found = po.diagnose(problem, data, flips=99)
    assert "drift" in [f.kind for f in found.effects]
    (effect,) = found.extended.effects
    own = found.delivery.fit
    assert effect.values == pytest.approx(own.x[own.sizes], abs=1e-12)
    sigma = dict(zip(found.extended.sources.names, found.extended.sources.sigma, strict=True))
    assert sigma["gear_eccentricity(joint1).sin"] == pytest.approx(own.std[own.sizes][0], rel=1e-6)
    # Its error is of rows left out, by the effects that each fold chose, less the drift.
    way = found.search.nested.each[0]
    errors, seen = np.zeros((len(data), 2)), np.asarray(data.position)[:, :2]
    for left, sets in zip(folds_of(groups_of(data, "pose", 5), 5, "pose"), way.sets, strict=True):
        lasting = {(e.kind, e.target) for e in sets[min(found.search.size, len(sets) - 1)] if e.kind != "drift"}
        assert lasting <= {("gear_eccentricity", "joint1"), ("joint_coupling", "joint1->joint2")}
        free = [*range(4), *[4, 5] * (("gear_eccentricity", "joint1") in lasting), *[6] * (len(lasting) > 1)]
        learn = np.setdiff1d(np.arange(len(data)), left)

        def off(x: np.ndarray, rows: np.ndarray, free: list[int] = free) -> np.ndarray:
            z, q = np.zeros(7), data.q[rows]
            z[free] = x
            return wavy(q + np.outer(z[6] * q[:, 0], [0, 1]), np.r_[z[:6], 1.0]) - seen[rows]

        z = least_squares(lambda x, rows=learn: off(x, rows).ravel(), np.zeros(len(free)), x_scale=1e-4, ftol=1e-14).x
        errors[left] = off(z, left)
    by_hand = np.sqrt(np.mean(np.sum(errors**2, axis=1)))
    assert found.to_json()["residual_rms"]["delivered_heldout"] == pytest.approx(by_hand, rel=5e-3)


def wavy(q: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Points (N, 2) of an arm with offsets of joints [rad] and links [m], sine, cosine and cycles ``z`` (7,)."""
    wave = z[4] * np.sin(z[6] * q[:, 0]) + z[5] * np.cos(z[6] * q[:, 0])
    return position(q + z[:2] + np.stack([wave, 0 * wave], axis=1), 1 + z[2:4])


def correction(q: np.ndarray, z: np.ndarray) -> np.ndarray:
    """The gradients (N, 3) of a wave by sine, cosine and cycles."""
    s, c = np.sin(z[6] * q), np.cos(z[6] * q)
    return np.stack([s, c, q * (z[4] * c - z[5] * s)], axis=1)


def test_a_wave_is_exported_as_sure_as_it_is_with_its_cycles_held(tmp_path: Path) -> None:
    """Against the linear errors of all seven unknowns together, by differences of the arm by hand."""
    rng = np.random.default_rng(3)
    q = np.column_stack([rng.uniform(0.5, 2.5, 150), rng.uniform(-2.5, 2.5, 150)])
    z = np.r_[np.zeros(4), WAVE]
    steps = np.diag([1e-6] * 6 + [1e-4])
    J = np.stack([(wavy(q, z + h) - wavy(q, z - h)).ravel() / (2 * h.sum()) for h in steps], axis=1)
    C = NOISE**2 * np.linalg.inv(J.T @ J)[4:, 4:]
    write(tmp_path / "data.csv", q, wavy(q, z) + rng.normal(0, NOISE, q.shape))
    (tmp_path / "problem.yaml").write_text(PROBLEM, encoding="utf-8")
    problem = po.load_problem(tmp_path / "problem.yaml")
    found = po.diagnose(problem, po.read_measurements(tmp_path / "data.csv", problem), flips=49, folds=2)
    (effect,) = found.extended.effects
    assert effect.kind == "cyclic_error"
    own = [found.extended.sources.names.index(f"{effect.name}.{name}") for name in ("sin", "cos")]
    held = found.extended.sources.covariance[np.ix_(own, own)]

    def sigma(at: np.ndarray, covariance: np.ndarray) -> np.ndarray:
        G = correction(at, z)[:, : len(covariance)]
        return np.asarray(np.sqrt(np.einsum("ni,ij,nj->n", G, covariance, G)))

    middle = np.linspace(1.2, 1.8, 13)  # at the edges the cycles' error is more than sine and cosine can say
    ratio = sigma(middle, held) / sigma(middle, C)
    assert np.all(np.abs(ratio - 1) < 0.25)  # residual variance of 300 numbers, and the amplitude's own error
    claimed, true = (np.linalg.norm(sigma(middle, part)) for part in (C[:2, :2], C))
    assert claimed > 1.8 * true  # by sine and cosine with the error of the cycles in them
