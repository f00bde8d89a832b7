"""A slide that moves as a wrist turns: the ball-screw spline of a SCARA, simulated by hand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import posture_opt as po
from posture_opt.units import parse_quantity

LEAD = 0.13e-3  # m/rad
NOISE = 1e-5  # m
HEAD = "joint1 [deg], joint2 [deg], joint3 [mm], joint4 [deg], x [mm], y [mm], z [mm]"
ARM = {"kind": "preset", "name": "scara", "tool": {"xyz": ["50 mm", "0 m", "0 m"]}}
PROBLEM = {"name": "SCARA", "robot": ARM, "uncertainty": {"measurement": {"position": "0.01 mm"}}}


def measured(folder: Path, rows: int = 80) -> Path:
    """Links of 220 and 130 mm, the tool 50 mm off the axis of the shaft, which is lifted by its own turn."""
    rng = np.random.default_rng(4)
    q = np.column_stack([rng.uniform(-2, 2, (rows, 2)), rng.uniform(0.01, 0.14, rows), rng.uniform(-3, 3, rows)])
    elbow = q[:, 0] + q[:, 1]
    tool = elbow - q[:, 3]
    x, y = (0.22 * f(q[:, 0]) + 0.13 * f(elbow) + 0.05 * f(tool) for f in (np.cos, np.sin))
    points = np.column_stack([x, y, -(q[:, 2] + LEAD * q[:, 3])]) + rng.normal(0, NOISE, (rows, 3))
    table = np.column_stack([np.degrees(q[:, :2]), 1e3 * q[:, 2], np.degrees(q[:, 3]), 1e3 * points])
    file = folder / "data.csv"
    np.savetxt(file, table, fmt="%.7f", delimiter=",", header=HEAD, comments="")
    return file


def test_the_coupling_is_named_with_its_lead(tmp_path: Path) -> None:
    problem = po.problem_from_dict(PROBLEM)
    found = po.diagnose(problem, po.read_measurements(measured(tmp_path), problem), flips=99, plan=False)
    (one,) = (e for e in found.to_json()["effects"] if e["kind"] == "joint_coupling")
    assert (one["target"], one["plausible"]) == ("joint4->joint3", True)
    ratio = one["estimate"]["ratio"]
    assert ratio["unit"] == "m/rad"
    assert abs(ratio["value"] - LEAD) < 4 * ratio["std"] < 0.1 * LEAD
    text = " ".join(found.report().split())
    assert "joint3 slides as joint4 turns (coupling into a slide)" in text
    assert "mm per revolution" in text
    (entry,) = found.fitted_arm.effects
    again = parse_quantity(entry.to_dict()["estimate"]["ratio"], "length per angle")
    assert again == pytest.approx(ratio["value"])


@pytest.mark.parametrize(
    ("entry", "said"),
    [
        ({"joint": "joint3", "follows": "joint4"}, "into: slide"),
        ({"joint": "joint2", "follows": "joint1", "into": "slide"}, "into: joint"),
        ({"joint": "joint2", "follows": "joint3"}, "joint3 slides"),
    ],
)
def test_what_slides_is_stated(entry: dict[str, str], said: str) -> None:
    with pytest.raises(po.errors.InputError, match=said):
        po.problem_from_dict({**PROBLEM, "effects": [{"kind": "joint_coupling", **entry}]})
