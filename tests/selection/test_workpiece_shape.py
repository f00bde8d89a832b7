"""A workpiece with a shape: kept clear of where it is fixed, checked where it was put, in the scene in any case."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

import posture_opt as po
from posture_opt.errors import InputError
from tests.helpers.said import said

WALL = {"file": "wall.stl", "unit": "mm"}


def wall(folder: Path) -> None:
    """A block of 60 x 40 x 100 mm beside the hole at the origin: 30 mm away from it along x."""
    trimesh.creation.box((60, 40, 100)).apply_translation([60, 0, 0]).export(folder / "wall.stl")


def planar(folder: Path, **workpiece: object) -> po.Problem:
    """The lecture's arm with links of 20 mm radius, and a part with one hole."""
    data = po.load_problem("insert_planar_2r").to_dict()
    data["robot"]["shape"] = {"radius": "20 mm"}
    data["task"] = {
        "kind": "insert", "direction": [0, -1, 0], "workpiece": {"x": "1.2 m", "y": "0.4 m", **workpiece},
        "features": [{"name": "hole", "position": ["0 m", "0 m", "0 m"]}],
    }  # fmt: skip
    (folder / "problem.yaml").write_text(po.problem_from_dict({**data}, folder=folder).to_yaml(), encoding="utf-8")
    return po.load_problem(folder / "problem.yaml")


def faces(problem: po.Problem) -> np.ndarray:
    (part,) = (obstacle for obstacle in problem.scene.obstacles if obstacle.name == "workpiece")
    return part.facets(np.full(3, -9.0), np.full(3, 9.0)).reshape(-1, 3)


def test_a_fixed_workpiece_is_an_obstacle_at_its_place(tmp_path: Path) -> None:
    wall(tmp_path)
    turned = planar(tmp_path, yaw="90 deg", **WALL)
    corners = faces(turned)  # a quarter turn: x of the part is y of the world
    np.testing.assert_allclose(corners.min(axis=0), [1.18, 0.43, -0.05], atol=1e-9)
    np.testing.assert_allclose(corners.max(axis=0), [1.22, 0.49, 0.05], atol=1e-9)


@pytest.mark.long
def test_the_arm_keeps_clear_of_a_fixed_workpiece(tmp_path: Path) -> None:
    wall(tmp_path)
    beside, free = po.select_posture(planar(tmp_path, **WALL)), po.select_posture(planar(tmp_path))
    assert beside.clearance is not None
    assert beside.clearance.cell is not None
    assert beside.clearance.cell.distance > 0
    assert beside.sigma_max >= free.sigma_max - 1e-9  # one more requirement cannot help


@pytest.mark.long
def test_a_workpiece_that_is_put_is_checked_there(tmp_path: Path) -> None:
    wall(tmp_path)
    problem = planar(tmp_path, x=["1.1 m", "1.2 m"], **WALL)
    assert problem.part is None
    found = po.select_posture(problem)
    assert found.placement is not None
    corners = faces(found.problem)
    assert corners[:, 0].min() == pytest.approx(found.placement.w[0] + 0.03, abs=1e-9)
    assert any("chosen without looking at it" in str(note) for note in found.notes)
    hit = found.clearance.cell.distance <= 0
    assert hit == ("collision.workpiece-hit" in said(found))


def test_its_file_goes_along_and_faults_are_named(tmp_path: Path) -> None:
    wall(tmp_path)
    files = planar(tmp_path, **WALL).files("copy")
    assert files["copy_workpiece.stl"] == (tmp_path / "wall.stl").read_bytes()
    with pytest.raises(InputError, match="no such file") as caught:
        planar(tmp_path, file="none.stl", unit="mm")
    assert caught.value.issues[0].key == ("task", "workpiece", "file")
    with pytest.raises(InputError, match="the unit of the lengths in the file is missing"):
        planar(tmp_path, file="wall.stl")
