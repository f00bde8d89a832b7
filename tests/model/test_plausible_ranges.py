"""What a cause can be on an arm: ranges with their sources, against loads and figures worked out by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

import posture_opt as po
from posture_opt.model.effects import EFFECTS, Effect
from posture_opt.model.effects.base.multiples import harmonic_order, resolution, rotating_parts
from posture_opt.model.effects.base.plausible_range import CATALOGUE, PlausibleRange, least_stiffness
from posture_opt.model.effects.cyclic_error import CyclicError
from tests.helpers.effect_cases import SHAPES, instances


def arm(mass: float) -> po.Problem:
    """Two links of 1 m in a vertical plane, a point mass at the end of each."""
    joint = {"type": "revolute", "a": "1 m", "alpha": "0 deg", "d": "0 m", "theta": "0 deg"}
    limits = {"limits": ["-180 deg", "180 deg"], "mass": f"{mass} kg", "com": ["0 m", "0 m", "0 m"]}
    joints = [{"name": name, **joint, **limits} for name in ("joint1", "joint2")]
    return po.problem_from_dict({"robot": {"kind": "dh", "joints": joints, "gravity": [0, -9.81, 0]}})


@pytest.mark.parametrize("mass", [0.05, 10.0])
def test_the_softest_gear_is_the_smallest_that_carries_the_stretched_arm(mass: float) -> None:
    robot = arm(mass).robot
    stretched = (9.81 * mass * (1 + 2), 9.81 * mass * 1)  # N m
    for joint, load in enumerate(stretched):
        smallest = next(stiffness for _, rated, stiffness in CATALOGUE if rated >= load)
        assert least_stiffness(robot, joint) == pytest.approx(smallest / 4)


@pytest.mark.parametrize(
    ("lines", "stated", "expected"),
    [
        ((80.0,), math.nan, [(80.0, 1)]), ((239.7,), math.nan, [(120.0, 2)]),
        ((101.2, 202.1), math.nan, [(101.0, 1), (101.0, 2)]),
        ((80.1, 160.1, 240.2), math.nan, [(80.0, 1), (80.0, 2), (80.0, 3)]), ((13.5, 27.0), math.nan, []),
        ((40.0, 80.0, 160.0), math.nan, []), ((80.0,), 101.0, []), ((202.0,), 101.0, [(101.0, 2)]),
    ],
)  # fmt: skip
def test_lines_are_told_by_the_part_that_turns_so_often(
    lines: tuple[float, ...], stated: float, expected: list
) -> None:
    parts = rotating_parts(lines, stated)
    assert [(part.ratio, part.per_turn) for part in parts] == expected
    assert all("per revolution of the motor" in part.words for part in parts)


@pytest.mark.parametrize("cls", EFFECTS, ids=lambda cls: cls.kind_name())
def test_every_range_has_a_source_and_says_what_it_takes(cls: type[Effect], sites) -> None:
    for name in SHAPES:
        site, robot, _ = sites[name]
        for effect in instances(cls, site, robot):
            known = effect.plausible(robot)
            if known is None:
                continue
            assert isinstance(known, PlausibleRange)
            assert known.low <= known.high
            assert known.source
            assert known.needs
            assert known.to_json()["unit"]
            assert effect.title in effect.looks_like


# --- Several lines of one joint as one error: the largest leads, and multiples are harmonics only where that is sure --


def lines(*cycles: float) -> list[CyclicError]:
    return [CyclicError(joint="elbow", cycles=k) for k in cycles]


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
