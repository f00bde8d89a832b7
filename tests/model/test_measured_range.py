"""Periodic errors are used where they were measured: what is promised beyond holds for arms whose phase is unknown.

The true arms are two links in a plane, in the kinematics of this file.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import posture_opt as po

AMPLITUDE = 0.6e-3
LOW, HIGH = -23.0, 57.0


def problem(cycles: float = 3.37, measured: tuple[float, float] | None = (LOW, HIGH), **task: Any) -> Any:
    joint = {"type": "revolute", "a": "1 m", "alpha": "0 deg", "d": "0 m", "theta": "0 deg"}
    limits = ["-270 deg", "270 deg"]
    effect: dict[str, Any] = {"kind": "cyclic_error", "joint": "joint1", "cycles": cycles, "centre": "0.3 rad"}
    effect["estimate"] = {"sin": f"{AMPLITUDE} rad", "cos": "0 rad"}
    if measured is not None:
        effect["measured_range"] = [f"{end} deg" for end in measured]
    return po.problem_from_dict({
        "robot": {"kind": "dh", "joints": [{"name": f"joint{k}", "limits": limits, **joint} for k in (1, 2)]},
        "uncertainty": {"sigma": {"joint2.theta": "0.05 mrad"}},
        "effects": [effect],
        "task": {"kind": "insert", "direction": [0, -1, 0], "position": ["1.2 m", "0.6 m", "0 m"], **task},
    })  # fmt: skip


def tool(q: np.ndarray, first: np.ndarray | float = 0.0, second: np.ndarray | float = 0.0) -> np.ndarray:
    """(..., 2) tool point with the errors of both joints [rad]."""
    a, b = q[0] + first, q[0] + first + q[1] + second
    return np.stack([np.cos(a) + np.cos(b), np.sin(a) + np.sin(b)], axis=-1)


def error(value: float, cycles: float = 3.37) -> float:
    return AMPLITUDE * float(np.sin(cycles * (value - 0.3)))


@pytest.mark.parametrize("angle", [-20.0, 10.0, 56.0])
def test_within_its_range_the_error_is_corrected(angle: float) -> None:
    q = np.radians([angle, 70.0])
    assert np.asarray(problem().arm.position(q))[:2] == pytest.approx(tool(q, error(q[0])), abs=1e-12)
    assert po.propagate(problem(), q).covariance == pytest.approx(po.propagate(problem(measured=None), q).covariance)


@pytest.mark.parametrize("angle", [192.0, -168.0, 65.0, -30.0, 57.0 - 360 + 100])
def test_beyond_it_the_promise_holds_for_arms_of_any_phase(angle: float) -> None:
    """192 deg is as far from what was measured as -168 deg, whole turns or not: the phase has drifted away."""
    q, rng = np.radians([angle, 70.0]), np.random.default_rng(3)
    spread = po.propagate(problem(), q)
    assert spread.position[:2] == pytest.approx(tool(q), abs=1e-12)
    phase = rng.uniform(0, 2 * np.pi, 40_000)
    drawn = tool(q, AMPLITUDE * np.sin(phase), rng.normal(0, 5e-5, len(phase)))
    assert spread.covariance[:2, :2] == pytest.approx(np.cov(drawn.T), rel=0.05, abs=3e-10)
    cloud = po.simulate(problem(), q, n=20_000, seed=0)
    assert cloud.covariance[:2, :2] == pytest.approx(np.cov(drawn.T), rel=0.05, abs=3e-10)


def test_an_error_that_repeats_after_a_whole_turn_is_used_everywhere() -> None:
    """Of four cycles a revolution, the phase at 192 deg is that at -168 deg, whatever was measured."""
    repeats = problem(4.0)
    assert not repeats.arm.measured_ranges
    for angle in (192.0, -168.0):
        q = np.radians([angle, 70.0])
        expected = tool(q, AMPLITUDE * np.sin(4 * (q[0] - 0.3)))
        assert np.asarray(repeats.arm.position(q))[:2] == pytest.approx(expected, abs=1e-12)


def test_a_posture_is_chosen_within_the_range_though_the_other_elbow_is_as_good() -> None:
    """Both elbows reach the target: joint1 at -21.3 deg, or at 74.4 deg, or a turn away."""
    answer = po.select_posture(problem())
    assert LOW <= np.degrees(answer.q[0]) <= HIGH
    assert answer.to_json()["beyond_measured"] == []
    p = tool(answer.q, error(answer.q[0]))
    assert p == pytest.approx([1.2, 0.6], abs=1e-7)
    repeated = po.PostureSelector(problem(), compiled=False).solve((1.3, 0.6, 0.0))
    assert LOW <= np.degrees(repeated.q[0]) <= HIGH


def test_what_cannot_be_done_within_it_is_said_first_and_costs_what_is_lost() -> None:
    answer = po.select_posture(problem(position=["-1.2 m", "-0.6 m", "0 m"]))
    assert not LOW <= np.degrees(answer.q[0]) <= HIGH
    assert tool(answer.q) == pytest.approx([-1.2, -0.6], abs=1e-7)
    (lost,) = answer.to_json()["beyond_measured"]
    assert lost["effect"] == {"kind": "cyclic_error", "target": "joint1"}
    assert lost["range"] == pytest.approx(np.radians([LOW, HIGH]))
    danger = next(one for one in answer.statements if one.severity == "danger")
    assert (danger.id, danger.about) == ("selection.beyond-measured", "joint1")
    assert np.degrees([danger.values[end].value for end in ("low", "high")]) == pytest.approx([LOW, HIGH])  # type: ignore[union-attr]
    x = AMPLITUDE / np.sqrt(2) * np.array([-tool(answer.q)[1], tool(answer.q)[0]])
    assert answer.sigma_max >= abs(x[0])


def test_a_diagnosis_writes_down_what_it_measured(tmp_path: Any) -> None:
    rng = np.random.default_rng(8)
    q = np.column_stack([np.radians(rng.uniform(LOW, HIGH, 90)), rng.uniform(-2.5, 2.5, 90)])
    p = np.array([tool(row, error(row[0], 5.37)) for row in q]) + rng.normal(0, 2e-5, (90, 2))
    plain = problem().replace(effects=None, uncertainty__measurement={"position": "0.02 mm"})
    data = po.read_measurements(
        {"joint1 [rad]": q[:, 0], "joint2 [rad]": q[:, 1], "x [m]": p[:, 0], "y [m]": p[:, 1]}, plain
    )
    extended = po.extended_problem(plain, po.diagnose(plain, data))
    for name, content in extended.files("extended").items():
        (tmp_path / name).write_bytes(content)
    (known,) = po.load_problem(tmp_path / "extended.yaml").arm.measured_ranges
    assert known.effect.kind == "cyclic_error"
    assert np.degrees([known.low, known.high]) == pytest.approx(np.degrees([q[:, 0].min(), q[:, 0].max()]), abs=0.01)
