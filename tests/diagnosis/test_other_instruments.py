"""A hidden backlash is named from touched plates and from lengths of a wire, of a simulator of its own."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import posture_opt as po
from tests.helpers.instruments import TrueArm, distance_table, level_table, plane_table
from tests.helpers.planar_2r import position
from tests.helpers.planar_files import PROBLEM, write
from tests.helpers.variants import conformance

WIDTH = 6e-4  # rad


@pytest.mark.parametrize("kind", conformance(("plane", "distance", "level"), ("distance",)))
def test_a_hidden_backlash_is_named(kind: str) -> None:
    rng = np.random.default_rng(1)
    arm = TrueArm.drawn(rng, backlash=(2, WIDTH))
    tables = {
        "plane": (plane_table, 40, 2e-5),
        "distance": (distance_table, 40, 2e-5),
        "level": (level_table, 60, 3e-5),
    }
    make, count, sigma = tables[kind]
    table = make(arm, rng, count, sigma)
    given = po.problem_from_dict(
        {
            "robot": {
                "kind": "preset",
                "name": "ur10",
                "tool": {"xyz": ["0 m", "0 m", "0.1 m"], "rpy": ["0 deg", "0 deg", "0 deg"], "free": True},
            },
            "uncertainty": {"measurement": {kind: "0.03 mrad" if kind == "level" else "0.02 mm"}},
        }
    )
    found = po.diagnose(given, po.read_measurements(table, given), flips=99, plan=False)
    first = found.effects[0]
    assert (first.kind, first.target) == ("backlash", "elbow")
    value, std, _ = first.estimate["width"]
    assert abs(value - WIDTH) < 3 * std < 0.15 * WIDTH
    assert found.verdict == "effects_found"


# --- A smooth error over the room is one of the instrument as far as the instrument can err, and no further -----------

SIGMA = 2e-5  # m, stated
NOISE = 1e-5  # m


def diagnosed(folder: Path, size: float, stated: str = "0.02 mm") -> po.Diagnosis:
    """Points off by a quadratic function of where they are, by so much RMS beyond what is linear [m]."""
    rng = np.random.default_rng(17)
    q = rng.uniform(-2.5, 2.5, (120, 2))
    p = position(q)
    field = np.stack([p[:, 0] * p[:, 1], p[:, 0] ** 2 - 0.5 * p[:, 1] ** 2], axis=1)
    plane = np.column_stack([np.ones(len(p)), p])
    bent = field - plane @ np.linalg.lstsq(plane, field, rcond=None)[0]
    points = p + field * size / np.sqrt(np.mean(bent**2))
    write(folder / "data.csv", q, points + rng.normal(0, NOISE, points.shape))
    problem = po.problem_from_dict({**PROBLEM, "uncertainty": {"measurement": {"position": stated}}})
    return po.diagnose(problem, po.read_measurements(folder / "data.csv", problem), flips=99, plan=False)


def kinds(found: po.Diagnosis) -> set[str]:
    effects = found.to_json()["effects"]
    return {cause["kind"] for e in effects for cause in (e, *e["confounded_with"])}


@pytest.mark.parametrize("times", [1.5, 25.0])
def test_a_field_is_the_instruments_up_to_three_times_what_is_stated(times: float, tmp_path: Path) -> None:
    found = diagnosed(tmp_path, times * SIGMA)
    assert ("instrument_field" in kinds(found)) is (times < 3)
    assert all(e.kind != "instrument_field" for e in found.fitted_arm.effects)
    if times > 3:
        assert found.verdict == "unexplained"
        assert "instrument_field" not in {e["kind"] for e in found.to_json()["delivered"]["left_out"]}


def test_an_instrument_that_is_not_stated_may_err_by_anything(tmp_path: Path) -> None:
    assert "instrument_field" in kinds(diagnosed(tmp_path, 25 * SIGMA, "0.5 mm"))


# --- Three reflectors that sag together under a heavy payload: their rows stay, and the compliance is found -----------

UR10_DH = (
    (0, np.pi / 2, 0.1273), (-0.612, 0, 0), (-0.5723, 0, 0), (0, np.pi / 2, 0.163941), (0, -np.pi / 2, 0.1157),
    (0, 0, 0.0922),
)  # fmt: skip

TARGETS = {"r1": (0.05, 0.0, 0.05), "r2": (-0.05, 0.03, 0.05), "r3": (0.0, -0.06, 0.08)}


def frames(q: np.ndarray) -> list[np.ndarray]:
    """Frames of the joints and of the flange, by the textbook product of Denavit-Hartenberg matrices."""
    found = [np.eye(4)]
    for (a, alpha, d), t in zip(UR10_DH, q, strict=True):
        c, s, ca, sa = np.cos(t), np.sin(t), np.cos(alpha), np.sin(alpha)
        step = [[c, -s * ca, s * sa, a * c], [s, c * ca, -c * sa, a * s], [0, sa, ca, d], [0, 0, 0, 1]]
        found.append(found[-1] @ np.array(step))
    return found


@pytest.mark.long
def test_rows_that_agree_are_kept_and_their_cause_is_found() -> None:
    rng = np.random.default_rng(4)
    rows = []
    for k in range(40):
        q = rng.uniform([-2, -2.4, -2, -2, -2, -3], [2, -0.7, 2, 2, 2, 3])
        mass = 30.0 if k % 8 == 0 else 0.5
        plain = frames(q)
        lever = plain[-1][:3, 3] - plain[2][:3, 3]
        q_true = q + np.array([0, 0, 8e-6 * plain[2][:3, 2] @ np.cross(lever, [0, 0, -9.81 * mass]), 0, 0, 0])
        flange = frames(q_true)[-1]
        for name, at in TARGETS.items():
            point = 1e3 * (flange[:3, :3] @ at + flange[:3, 3]) + rng.normal(0, 0.03, 3)
            rows.append([name, *np.degrees(q), *point, mass])
    problem = po.problem_from_dict({
        "robot": {"kind": "preset", "name": "ur10", "base": "free", "tool": "free"},
        "uncertainty": {"measurement": {"position": "0.03 mm"}},
    })  # fmt: skip
    joints = [f"{name} [deg]" for name in problem.robot.joint_names]
    table = pd.DataFrame(rows, columns=["target", *joints, "x [mm]", "y [mm]", "z [mm]", "payload [kg]"])
    found = po.diagnose(problem, po.read_measurements(table, problem), plan=False)
    assert not found.calibration.outliers
    assert ("joint_compliance", "elbow") in [(f.kind, f.target) for f in found.effects]
