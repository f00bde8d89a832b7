"""Plans with cameras: with the readings of a simulator of its own in further columns, they are files to calibrate."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import posture_opt as po
from tests.helpers.cameras import TOOL_SCENE, Scene, camera_problem, camera_table, grid
from tests.helpers.instruments import ANCHORS, TrueArm, distance_table, mixed_table

SCENE = replace(TOOL_SCENE, corners=grid(3, 4, 0.05))
WIRE = 1e-4


def problem(folder: Path) -> po.Problem:
    text = camera_problem(folder, SCENE)
    text["robot"]["tool"]["free"] = True  # type: ignore[index]
    text["uncertainty"]["measurement"]["distance"] = "0.1 mm"  # type: ignore[index]
    text["data"]["markers"]["board"]["chessboard"] = {"rows": 3, "columns": 4, "square": "50 mm"}  # type: ignore[index]
    return po.problem_from_dict(text, folder)


def filled(plan: str, scene: Scene, arm: TrueArm, rng: np.random.Generator) -> str:
    """The text of a plan with readings in further columns: pixels where a marker is named, lengths at anchors."""
    head, *lines = plan.splitlines()
    names = [name.strip() for name in head.split(",")]
    written = [f"{head}, u [px], v [px], distance [mm]"]
    for line in lines:
        row = dict(zip(names, (cell.strip() for cell in line.split(",")), strict=True))
        pose = arm.pose(np.radians([[float(cell) for cell in list(row.values())[:6]]]))[0]
        if row["marker"]:
            uv = scene.pixels(pose)[int(row["marker"].removeprefix("board/"))] + rng.normal(0, 0.2, 2)
            read = f"{uv[0]:.4f}, {uv[1]:.4f}, "
        else:
            anchor = ANCHORS[int(row["anchor"].removeprefix("bar"))]
            read = f", , {1e3 * (np.linalg.norm(pose[:3, 3] - anchor) + rng.normal(0, WIRE)):.5f}"
        written.append(f"{line}, {read}")
    return "\n".join(written) + "\n"


@pytest.mark.long
def test_a_mixed_plan_with_a_camera_is_filled_in_and_calibrated(tmp_path: Path) -> None:
    rng = np.random.default_rng(41)
    arm, given = TrueArm.drawn(rng), problem(tmp_path)
    tables = {"eye": camera_table(arm, rng, 8, 0.2, SCENE), "wire": distance_table(arm, rng, 4, WIRE)}
    bare = {k: {c: v for c, v in t.items() if "approach" not in c} for k, t in tables.items()}
    data = po.read_measurements(mixed_table(bare), given)
    plan = po.plan_measurements(given, 12, given=data, candidates=60, repeats=2)
    assert {*plan.instruments} == {"eye", "wire"}
    pictures = plan.instruments.count("eye")
    (tmp_path / "measured.csv").write_text(filled(plan.to_csv(), SCENE, arm, rng))
    again = po.read_measurements(tmp_path / "measured.csv", given)
    assert len(again) == 2 * (2 * len(SCENE.corners) * pictures + len(plan.q) - pictures)
    found = po.calibrate(given, again, plan=False, folds=2)
    assert 0.8 < found.variance < 1.25
