"""Postures planned for a camera: a simulator of its own sees the whole board from each, and no link hides it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import posture_opt as po
from tests.helpers.cameras import TOOL_SCENE, Scene, camera_problem, camera_table, grid
from tests.helpers.instruments import TrueArm

SMALL = grid(3, 4, 0.05)
SCENES = {"cell": replace(Scene(), corners=SMALL), "tool": replace(TOOL_SCENE, corners=SMALL)}


def given(where: str, folder: Path, n: int) -> tuple[po.Problem, po.Measurements, TrueArm]:
    """A problem, n pictures of the whole board, and the arm that took them."""
    rng = np.random.default_rng(2)
    arm = TrueArm.drawn(rng)
    text = camera_problem(folder, SCENES[where])
    text["data"]["markers"]["board"]["chessboard"] = {"rows": 3, "columns": 4, "square": "50 mm"}  # type: ignore[index]
    problem = po.problem_from_dict(text, folder)
    return problem, po.read_measurements(camera_table(arm, rng, n, 0.2, SCENES[where]), problem), arm


@pytest.mark.long
@pytest.mark.parametrize("where", ["cell", "tool"])
def test_the_whole_board_is_seen_from_planned_postures(where: str, tmp_path: Path) -> None:
    problem, data, arm = given(where, tmp_path, 15)
    scene = SCENES[where]
    plan = po.plan_measurements(problem, 8, given=data, candidates=120)
    assert plan.places == ("left",) * 8
    assert plan.gain > 1
    head, *rows = plan.to_csv().splitlines()
    assert head.endswith("camera, marker")
    assert [row.split(", ")[-2:] for row in rows] == [["left", f"board/{k}"] for k in range(12)] * 8
    fronts = []
    for q in (plan.q, np.unique(data.q, axis=0)):
        for pose in arm.pose(q):
            assert scene.camera.seen(scene.pixels(pose)).all()
            world = scene.board if scene.on_tool else pose @ scene.board
            eye = (pose @ scene.camera.pose if scene.on_tool else scene.camera.pose)[:3, 3]
            middle = world[:3, :3] @ scene.corners.mean(axis=0) + world[:3, 3]
            fronts.append(float((middle - eye) @ world[:3, 2] / np.linalg.norm(middle - eye)))
            assert 0.6 < np.linalg.norm(middle - eye) < 1.5  # as far as given pictures, and so as large
    assert min(fronts) > 0.4 or max(fronts) < -0.4  # all from the same side, none edge on
