"""Several lines of one joint as one error: the largest leads, and multiples are harmonics only where that is sure."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from posture_opt.model.effects.backlash import Backlash
from posture_opt.model.effects.base.cause import FittedSizes
from posture_opt.model.effects.base.multiples import harmonic_order, resolution
from posture_opt.model.effects.cyclic_error import CyclicError
from posture_opt.robot.preset import load_preset


def lines(*cycles: float) -> list[CyclicError]:
    return [CyclicError(joint="elbow", cycles=k) for k in cycles]


def test_the_largest_leads_and_the_others_follow_by_size() -> None:
    found = CyclicError.joined(lines(101.0, 202.0, 303.0, 7.5), (1e-4, 3e-4, 1e-5, 2e-4))
    assert found.lines == (202.0, 7.5, 101.0, 303.0)


def test_a_sentence_names_the_first_of_many_lines() -> None:
    found = CyclicError.joined(lines(3.574, 13.36, 27.3, 15, 22.85), (5, 4, 3, 2, 1))
    assert found.words == "elbow has a cyclic error of 5 lines (3.57, 13.4, 27.3 … cycles per revolution)"
    assert found.label == "cyclic error (elbow, 3.57/rev + 4 more)"
    assert lines(13.36)[0].words == "elbow has a cyclic error of 13.4 cycles per revolution"


def sizes(rms: tuple[float, float] | None = None, std: float = 1e-6, span: float = 4.0) -> FittedSizes:
    """Lines of 0.3 and 0.4 mrad, then of 0.1 mrad."""
    values = {"sin": 3e-4, "cos": 4e-4, "sin 2": 0.0, "cos 2": 1e-4}
    entries = {name: (value, std, "rad") for name, value in values.items()} | {"cycles": (20.0, float("nan"), "1")}
    return FittedSizes(entries, std**2 * np.eye(4), rms=rms, span=span)


def test_several_lines_have_one_number() -> None:
    error = CyclicError(joint="elbow", cycles=20.0, further=(40.0,))
    assert error.headline(sizes((3.6e-4, 2e-5))) == "0.360 ± 0.020 mrad RMS"
    # Over whole cycles: sqrt((0.5² + 0.1²) / 2) mrad.
    assert error.headline(sizes()).startswith("0.361 mrad")
    together, each = error.sizes(sizes())
    assert str(together).endswith("RMS, 2 lines together")
    assert each.text == "0.50 mrad at 20.0; 0.10 mrad at 40.0 (harmonic 2)"


@pytest.mark.parametrize(("std", "span", "further"), [(1e-5, 0.5, 40.0), (1e-6, 0.0, 40.0), (1e-6, 4.0, 40.3)])
def test_a_multiple_that_is_not_sure_is_no_harmonic(std: float, span: float, further: float) -> None:
    error = CyclicError(joint="elbow", cycles=20.0, further=(further,))
    assert "harmonic" not in error.sizes(sizes(std=std, span=span))[1].text


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


def test_a_joint_that_goes_beyond_its_command_is_looked_at_elsewhere() -> None:
    robot = load_preset("puma560")
    joint = robot.joints[0].name
    texts = [
        Backlash(joint=joint).inspect_fitted(robot, FittedSizes({"width": (sign * 1e-4, 1e-5, "rad")}))
        for sign in (1, -1)
    ]
    assert "gear mesh" in texts[0]
    assert "friction or backlash compensation in the controller, and nothing is tightened" in texts[1]


def test_with_the_gear_ratio_the_part_that_turns_so_often_is_named() -> None:
    robot = load_preset("puma560")
    joint = robot.joints[2]
    line = CyclicError(joint=joint.name, cycles=2 * abs(joint.gear_ratio))
    assert line.inspect(robot) == (
        f"wave generator or pinion, motor shaft and motor encoder of {joint.name}: 107.4 cycles per revolution is "
        "twice per revolution of the motor"
    )
    assert "what comes 7.50 times per revolution" in CyclicError(joint=joint.name, cycles=7.5).inspect(robot)


def test_the_size_of_a_play_is_said_to_be_the_whole_width() -> None:
    found = FittedSizes({"width": (1.897e-4, 8.6e-6, "rad")})
    assert Backlash(joint="elbow").headline(found) == "0.1897 ± 0.0086 mrad whole width"
    assert str(Backlash(joint="elbow").sizes(found)[0]) == "0.1897 ± 0.0086 mrad, whole width"


def test_what_has_no_period_within_the_range_is_a_curve_and_has_no_frequency() -> None:
    """Over a radian 3.6 cycles per revolution are 0.57 periods, 20 are 3.2."""
    robot = load_preset("ur10")
    slow = CyclicError(joint="elbow", cycles=3.6, further=(20.0,))
    assert slow.worded(sizes(span=1.0)) == (
        "elbow has a slow error over its range and a cyclic error of 20.0 cycles per revolution"
    )
    assert slow.labelled(sizes(span=1.0)) == "cyclic error (elbow, slow and 20.0/rev)"
    assert "20.0 times per revolution" in slow.inspect_fitted(robot, sizes(span=1.0))
    alone = CyclicError(joint="elbow", cycles=3.6)
    assert alone.worded(sizes(span=1.0)) == "elbow has a slow error over its range"
    assert alone.inspect_fitted(robot, sizes(span=1.0)).startswith("elbow over its whole range: encoder or gear off")
    assert alone.worded(sizes(span=4.0)) == "elbow has a cyclic error of 3.60 cycles per revolution"


def test_cycles_are_as_certain_as_the_range_lets_them_be() -> None:
    """√12 s / (A w) of 0.5 ± 0.05 mrad over 2 rad is 0.17."""
    error = CyclicError(joint="elbow", cycles=20.0, further=(40.0,))
    assert "the largest at 20.0 ± 0.2 cycles per revolution" in error.worded(sizes(std=5e-5, span=2.0))
    assert "the largest at 20.0 cycles per revolution" in error.worded(sizes(span=2.0))


def test_lines_that_the_values_do_not_tell_apart_are_one_band() -> None:
    error = CyclicError(joint="elbow", cycles=20.4, further=(22.0,))
    found = replace(sizes(span=2.0), resolution=1.7)
    assert error.worded(found) == "elbow has a cyclic error of 20 to 22 cycles per revolution"
    assert error.labelled(found) == "cyclic error (elbow, 20 to 22/rev)"
    assert error.sizes(found)[1].text == "0.51 mrad at 20 to 22"  # √(0.5² + 0.1²)
    apart = replace(found, resolution=1.5)
    assert "2 lines, the largest at 20.4 cycles per revolution" in error.worded(apart)


def test_values_in_clumps_tell_less_apart_than_their_range_says() -> None:
    """Even values have the window |sin(Δ w / 2) / (Δ w / 2)|, one half at Δ w = 3.79; two clumps |cos(Δ w / 2)|."""
    even = np.linspace(0.0, 2.0, 400)
    assert resolution(even) == pytest.approx(3.79 / 2.0, abs=0.05)
    clumps = np.where(even < 1.0, 0.0, 2.0)
    assert resolution(clumps) > 2 * np.pi / 2.0
    assert resolution(np.zeros(5)) == 0.0
