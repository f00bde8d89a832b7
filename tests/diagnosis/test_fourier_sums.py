"""Sums of sines by a fast Fourier transform are those of the definition, digit by digit of what decides anything."""

from __future__ import annotations

import numpy as np
import pytest

from posture_opt.diagnosis.scores.fourier_sums import FourierSums, weighted_squares


@pytest.mark.parametrize(
    ("rows", "count", "step"),
    [(300, 2500, 0.1), (1000, 7, 0.3), (400, 33, 0.05), (50, 1, 1.0), (3, 600, 2.7)],
    ids=["many", "few", "narrow", "one", "three rows"],
)
def test_the_sums_are_those_of_the_definition(rows: int, count: int, step: float) -> None:
    rng = np.random.default_rng(rows)
    q, a = rng.uniform(-6.2, 6.2, rows), rng.normal(size=(rows, 70))
    cycles = 0.5 + step * np.arange(count)
    angles = np.outer(cycles, q)
    S, C = np.sin(angles), np.cos(angles)
    sines, cosines = FourierSums.of(q, cycles)(a)
    close = {"rtol": 0, "atol": 1e-7 * float(np.abs(a).sum(axis=0).max())}
    np.testing.assert_allclose(sines, S @ a, **close)
    np.testing.assert_allclose(cosines, C @ a, **close)
    for found, pair in zip(weighted_squares(q, cycles, a**2), (S * S, S * C, C * C), strict=True):
        np.testing.assert_allclose(found, pair @ a**2, rtol=0, atol=1e-7 * float((a**2).sum(axis=0).max()))
