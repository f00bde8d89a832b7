"""Lost motion of either sign on a planar arm with formulas of its own, directions stated or taken from the rows."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import posture_opt as po
from posture_opt.model.arm_state import Inputs
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


@pytest.mark.parametrize(("stops_short", "stated"), [(True, True), (True, False), (False, True)])
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
