"""Free frames wherever they stand: on a wall, upside down, with a tool that looks back, with measured orientations."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import posture_opt as po
from tests.helpers.free_arms import SIX, hidden_errors, problem_of, quaternion, rows, simulated_poses
from tests.helpers.simulated_arm import shift, turn

NOISE, TWIST = 2e-5, 1e-4  # m, rad


def rpy(roll: float, pitch: float, yaw: float) -> np.ndarray:
    return turn(2, np.radians(yaw)) @ turn(1, np.radians(pitch)) @ turn(0, np.radians(roll))


def measured(base: np.ndarray, tool: np.ndarray, orientation: bool) -> tuple[Any, po.Measurements]:
    rng = np.random.default_rng(21)
    q = rng.uniform(-2.5, 2.5, (100, 6))
    T = simulated_poses(SIX, q, base, tool, hidden_errors(SIX, rng, ("j2",)))
    points = T[:, :3, 3] + rng.normal(0, NOISE, (100, 3))
    more = {}
    if orientation:
        wxyz = []
        for R in T[:, :3, :3]:
            angle = rng.normal(0, TWIST, 3)
            wxyz.append(
                quaternion(turn(2, angle[2])[:3, :3] @ turn(1, angle[1])[:3, :3] @ turn(0, angle[0])[:3, :3] @ R)
            )
        more = {name: np.array(wxyz)[:, i] for i, name in enumerate(("qw", "qx", "qy", "qz"))}
    instrument = {"position": "0.02 mm"} | ({"orientation": "0.1 mrad"} if orientation else {})
    problem = problem_of(SIX, uncertainty={"measurement": instrument})
    return problem, rows(problem, q, points, **more)


@pytest.mark.parametrize(
    ("base", "tool", "orientation"),
    [
        ((0, 90, 0), (0, 0, 0), False),  # on a wall
        ((30, -89.97, 50), (0, 90, 0), True),  # on another, nearly, and a tool that looks sideways
        ((170, 40, -175), (-120, 60, 150), False),
    ],
)
def test_free_frames_are_found_wherever_they_stand(base: Any, tool: Any, orientation: bool) -> None:
    T_base, T_tool = shift(0.4, -1.3, 0.8) @ rpy(*base), shift(0.03, -0.05, 0.12) @ rpy(*tool)
    problem, data = measured(T_base, T_tool, orientation)
    result = po.calibrate(problem, data)
    assert 0.8 < result.variance < 1.25  # χ² over more than 270 degrees of freedom: ± 3 σ
    # Told in roll, pitch and yaw it is the same arm: the errors that it leaves are those that were fitted.
    again = result.residuals.error(result.x)
    np.testing.assert_allclose(again, result.errors_fitted, atol=1e-9)
    assert result.calibrated.rms < np.sqrt(3) * NOISE * 1.5
    value = {p.name: p.nominal + x for p, x in zip(result.parameters, result.x, strict=True)}
    angles = [np.degrees(value[f"base.{turned}"]) for turned in ("roll", "pitch", "yaw")]
    apart = rpy(*angles)[:3, :3].T @ T_base[:3, :3]
    # The zero of the first joint, up to 1 mrad off, cannot be told from the base.
    assert np.arccos(np.clip((np.trace(apart) - 1) / 2, -1, 1)) < 4e-3
    # On a wall that zero is in the pitch too, which is what the base's own turn about its axis makes of it.
    for turned, true in zip(("roll", "pitch", "yaw"), base, strict=True):
        i = [p.name for p in result.parameters].index(f"base.{turned}")
        off = np.remainder(value[f"base.{turned}"] - np.radians(true) + np.pi, 2 * np.pi) - np.pi
        assert not result.fixed[i] or abs(off) < 4 * result.std[i]
    assert not result.notes or all("rest" not in note for note in result.notes)


def test_on_a_wall_roll_and_yaw_have_no_values_of_their_own() -> None:
    # The first joint's zero is known to 0.5 mrad beforehand, so that the base's three turns are determined; told in
    # roll, pitch and yaw they are not, as the pitch of 90 deg lies within their errors.
    rng = np.random.default_rng(23)
    errors = {f"{name}.{k}": rng.normal(0, 5e-4) for name, *_ in SIX for k in ("theta", "d", "a", "alpha")}
    sigma = {name: "0.5 mm" if name.endswith((".d", ".a")) else "0.5 mrad" for name in errors}
    instrument = {"position": "0.02 mm"}
    problem = problem_of(SIX, uncertainty={"measurement": instrument, "sigma": sigma})
    q = rng.uniform(-2.5, 2.5, (60, 6))
    T_base = shift(0.4, -1.3, 0.8) @ rpy(0, 90, 0)
    points = simulated_poses(SIX, q, T_base, shift(0.03, -0.05, 0.12), errors)[:, :3, 3] + rng.normal(0, NOISE, (60, 3))
    result = po.calibrate(problem, rows(problem, q, points))
    at = {p.name: i for i, p in enumerate(result.parameters)}
    assert not result.fixed[at["base.roll"]]
    assert not result.fixed[at["base.yaw"]]
    pitch = at["base.pitch"]
    assert result.fixed[pitch]
    assert abs(result.parameters[pitch].nominal + result.x[pitch] - np.pi / 2) < 4 * result.std[pitch]
