"""A tool or reflector that is knocked out of place half-way: named as that, and no error of the last joint.

The seeds 1 to 16 were used while this was made; those here were not.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import posture_opt as po
from posture_opt.model.arm_state import Inputs
from posture_opt.model.effects.slip import Slip
from tests.helpers.simulated_session import SimulatedSession, beyond_geometry
from tests.hidden.effects import Effect

FIRST = 70  # row from which on the tool is elsewhere
KNOCK = 0.5e-3  # m
TURN = 1e-3  # rad
ORIENTATION = 1e-4  # rad, σ of the instrument


def vector(case: SimulatedSession, length: float) -> np.ndarray:
    drawn = case.rng.normal(size=3)
    return np.asarray(drawn * length / np.linalg.norm(drawn))


def from_first(case: SimulatedSession, target: str, size: dict[str, float]) -> Effect:
    return Effect("slip", target, size, {"t0": float(case.session.time[FIRST])})


@pytest.mark.long
def test_measured_orientations_show_that_the_tool_turned() -> None:
    case = SimulatedSession(104)
    turn, R = vector(case, TURN), case.site.walk.R_link[:, -1]
    after = np.arange(len(R)) >= FIRST
    turned = R @ np.where(after[:, None, None], Rotation.from_rotvec(turn).as_matrix(), np.eye(3))
    noise = Rotation.from_rotvec(case.rng.normal(0, ORIENTATION, (len(R), 3)))
    q = (noise * Rotation.from_matrix(turned)).as_quat(scalar_first=True)
    points = case.points(from_first(case, "tool", dict(zip("xyz", vector(case, KNOCK), strict=True))))
    document = case.document()
    document["uncertainty"]["measurement"]["orientation"] = f"{ORIENTATION} rad"
    found = case.diagnosis(case.table(points) | dict(zip(("qw", "qx", "qy", "qz"), q.T, strict=True)), document)
    assert beyond_geometry(found) == [("slip", "tool")]
    (slip,) = [f for f in found.effects if f.kind == "slip"]
    for angle, true in zip(("roll", "pitch", "yaw"), turn, strict=True):
        value, std, _ = slip.estimate[angle]
        assert abs(value - true) < 4 * std


def test_a_slip_of_the_tool_shifts_and_turns_it_about_the_flange() -> None:
    case = SimulatedSession(105)
    document = case.document(free=False)
    parts = {"x": "0.1 mm", "y": "-0.2 mm", "z": "0.3 mm", "roll": "1e-4 rad", "pitch": "2e-4 rad", "yaw": "-3e-4 rad"}
    document["effects"] = [Slip(of="tool", moment="10 s", way="settle", estimate=parts).to_dict()]
    arm = po.problem_from_dict(document).arm
    before, after = (np.asarray(arm.under(Inputs(time=t)).pose(case.session.q[5]), dtype=float) for t in (0.0, 20.0))
    lever = np.array([f.value for f in case.arm.tool[:3]])
    shift = np.array([1e-4, -2e-4, 3e-4]) + np.cross([1e-4, 2e-4, -3e-4], lever)
    np.testing.assert_allclose(before[:3, :3].T @ (after[:3, 3] - before[:3, 3]), shift, atol=1e-7)
