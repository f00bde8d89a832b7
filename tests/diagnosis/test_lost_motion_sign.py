"""Lost motion of either sign on a planar arm with formulas of its own, directions stated or taken from the rows."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import posture_opt as po
from posture_opt.model.arm_state import Inputs
from posture_opt.units import parse_quantity
from tests.helpers.planar_2r import position
from tests.helpers.planar_files import PROBLEM

NOISE = 2e-5  # m
WIDTH = 6e-4  # rad, between both directions of approach
ROWS = 90


def measured(folder: Path, stops_short: bool, stated: bool) -> po.Measurements:
    """joint2 comes to rest half a width before its command, or beyond it; the direction in columns or from the rows."""
    rng = np.random.default_rng(7)
    q = rng.uniform(-2.2, 2.2, (ROWS, 2))
    came_from = rng.uniform(-2.5, 2.5, (ROWS, 2)) if stated else np.vstack([[-3.0, -3.0], q[:-1]])
    increasing = q > came_from
    rests = q.copy()
    before = np.where(increasing[:, 1], -WIDTH / 2, WIDTH / 2)
    rests[:, 1] += before if stops_short else -before
    p = position(rests) + rng.normal(0, NOISE, q.shape)
    header = ["joint1 [deg]", "joint2 [deg]", "x [mm]", "y [mm]"]
    columns = [*np.degrees(q).T, *(1e3 * p).T]
    if stated:
        header += ["joint1.approach", "joint2.approach"]
        columns += [*np.where(increasing, 1, -1).T]
    lines = [", ".join(f"{v:.6f}" for v in row) for row in zip(*columns, strict=True)]
    (folder / "data.csv").write_text("\n".join([", ".join(header), *lines]) + "\n")
    return po.read_measurements(folder / "data.csv", po.problem_from_dict(PROBLEM))


@pytest.mark.parametrize(("stops_short", "stated"), [(True, False), (False, True)])
def test_both_signs_are_found_and_worded(tmp_path: Path, stops_short: bool, stated: bool) -> None:
    problem = po.problem_from_dict(PROBLEM)
    found = po.diagnose(problem, measured(tmp_path, stops_short, stated), flips=99, plan=False)
    first = found.effects[0]
    assert (first.kind, first.target) == ("backlash", "joint2")
    value, std, _ = first.estimate["width"]
    assert abs(value - (WIDTH if stops_short else -WIDTH)) < 3 * std < 0.2 * WIDTH
    assert ("joint2 has backlash and stops short" in found.report()) is stops_short
    assert ("joint2 goes beyond its command, as with friction compensation" in found.report()) is not stops_short
    # The delivered arm rests where the simulated one does: before the command where it stops short.
    arm = found.extended.arm
    rests = {side: np.asarray(arm.under(Inputs(approach=[0.0, side])).position([0.3, 0.9]))[:2] for side in (1.0, -1.0)}
    behind = position(np.array([[0.3, 0.9 - WIDTH / 2], [0.3, 0.9 + WIDTH / 2]]))
    apart = behind[0] - behind[1]
    assert np.allclose(rests[1.0] - rests[-1.0], apart if stops_short else -apart, atol=0.2 * np.linalg.norm(apart))


# --- A slide that moves as a wrist turns: the ball-screw spline of a SCARA, simulated by hand -------------------------

LEAD = 0.13e-3  # m/rad
NOISE_SLIDE = 1e-5  # m
HEAD = "joint1 [deg], joint2 [deg], joint3 [mm], joint4 [deg], x [mm], y [mm], z [mm]"
ARM = {"kind": "preset", "name": "scara", "tool": {"xyz": ["50 mm", "0 m", "0 m"]}}
PROBLEM_SLIDE = {"name": "SCARA", "robot": ARM, "uncertainty": {"measurement": {"position": "0.01 mm"}}}


def measured_slide(folder: Path, rows: int = 80) -> Path:
    """Links of 220 and 130 mm, the tool 50 mm off the axis of the shaft, which is lifted by its own turn."""
    rng = np.random.default_rng(4)
    q = np.column_stack([rng.uniform(-2, 2, (rows, 2)), rng.uniform(0.01, 0.14, rows), rng.uniform(-3, 3, rows)])
    elbow = q[:, 0] + q[:, 1]
    tool = elbow - q[:, 3]
    x, y = (0.22 * f(q[:, 0]) + 0.13 * f(elbow) + 0.05 * f(tool) for f in (np.cos, np.sin))
    points = np.column_stack([x, y, -(q[:, 2] + LEAD * q[:, 3])]) + rng.normal(0, NOISE_SLIDE, (rows, 3))
    table = np.column_stack([np.degrees(q[:, :2]), 1e3 * q[:, 2], np.degrees(q[:, 3]), 1e3 * points])
    file = folder / "data.csv"
    np.savetxt(file, table, fmt="%.7f", delimiter=",", header=HEAD, comments="")
    return file


def test_the_coupling_is_named_with_its_lead(tmp_path: Path) -> None:
    problem = po.problem_from_dict(PROBLEM_SLIDE)
    found = po.diagnose(problem, po.read_measurements(measured_slide(tmp_path), problem), flips=99, plan=False)
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
        po.problem_from_dict({**PROBLEM_SLIDE, "effects": [{"kind": "joint_coupling", **entry}]})
