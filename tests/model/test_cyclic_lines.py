"""Several lines of one joint as one error: the largest leads, and multiples are harmonics only where that is sure."""

from __future__ import annotations

import numpy as np
import pytest

from posture_opt.model.effects.base.multiples import harmonic_order, resolution
from posture_opt.model.effects.cyclic_error import CyclicError


def lines(*cycles: float) -> list[CyclicError]:
    return [CyclicError(joint="elbow", cycles=k) for k in cycles]


def test_the_largest_leads_and_the_others_follow_by_size() -> None:
    found = CyclicError.joined(lines(101.0, 202.0, 303.0, 7.5), (1e-4, 3e-4, 1e-5, 2e-4))
    assert found.lines == (202.0, 7.5, 101.0, 303.0)


def test_harmonics_are_told_from_lines_that_only_come_near() -> None:
    """Frequencies that scatter as least squares has them: Monte Carlo with a fit of its own on 400 values."""
    rng = np.random.default_rng(0)
    q, noise, amplitudes, cycles = np.linspace(-2, 2, 400), 1e-4, (4e-4, 2e-4), np.array([20.0, 40.0])

    def wave(k: np.ndarray) -> np.ndarray:
        return np.stack([f(c * q) for c in k for f in (np.sin, np.cos)], axis=1)

    met = 0
    drawn = 200
    for _ in range(drawn):
        y = wave(cycles) @ [amplitudes[0], 0, amplitudes[1], 0] + rng.normal(0, noise, len(q))
        k = cycles.copy()
        for _ in range(3):
            A = wave(k)
            theta = np.linalg.lstsq(A, y, rcond=None)[0]
            slopes = [q * (A[:, 2 * i + 1] * theta[2 * i] - A[:, 2 * i] * theta[2 * i + 1]) for i in (0, 1)]
            k = k + np.linalg.lstsq(np.column_stack([A, *slopes]), y - A @ theta, rcond=None)[0][4:]
        std = noise * np.sqrt(2 / len(q))
        found = [(float(np.hypot(*theta[2 * i : 2 * i + 2])), std) for i in (0, 1)]
        met += harmonic_order(k, found, 1, 4.0) == 2
    # Two standard errors hold 95.4 %; three of the count beyond that.
    assert abs(met / drawn - 0.954) < 3 * np.sqrt(0.954 * 0.046 / drawn)


def test_values_in_clumps_tell_less_apart_than_their_range_says() -> None:
    """Even values have the window |sin(Δ w / 2) / (Δ w / 2)|, one half at Δ w = 3.79; two clumps |cos(Δ w / 2)|."""
    even = np.linspace(0.0, 2.0, 400)
    assert resolution(even) == pytest.approx(3.79 / 2.0, abs=0.05)
    clumps = np.where(even < 1.0, 0.0, 2.0)
    assert resolution(clumps) > 2 * np.pi / 2.0
    assert resolution(np.zeros(5)) == 0.0
