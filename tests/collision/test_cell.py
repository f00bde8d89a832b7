"""The section ``cell`` of a problem file and planning scenes of MoveIt: what they hold, what is said of bad ones."""

from __future__ import annotations

import math
from pathlib import Path

import coal
import numpy as np
import pytest

import posture_opt as po
from tests.helpers.cells import GROUND, LAMP, POST, TABLE, problem_in_cell

ROBOT = {"kind": "preset", "name": "ur10"}


def test_a_cell_is_read_in_si_units() -> None:
    problem = problem_in_cell("ur10", TABLE, POST, LAMP, GROUND)
    assert problem.cell is not None
    table, post, lamp, ground = problem.scene.stated_obstacles
    assert problem.scene.margin == 0.02
    assert table.half == (0.35, 0.6, 0.01)
    assert (post.radius, post.length, post.xyz) == (0.06, 0.8, (0.35, 0.4, 0.4))
    assert lamp.radius == 0.08
    assert (ground.normal, ground.offset) == ((0, 0, 1), -0.02)


def test_an_obstacle_is_turned_by_its_angles() -> None:
    problem = problem_in_cell("ur10", {**TABLE, "rpy": ["0 deg", "0 deg", "90 deg"], "xyz": ["1 m", "0 m", "0 m"]})
    (table,) = problem.scene.stated_obstacles
    x, y, z = table.local([1.0, 0.5, 0.0])
    assert (x, y, z) == pytest.approx((0.5, 0.0, 0.0))


def test_none_switches_all_checks_off() -> None:
    shape = [{"joint": "elbow", "from": ["0 m", "0 m", "0 m"], "to": ["0.5 m", "0 m", "0 m"], "radius": "60 mm"}]
    document = {"robot": {**ROBOT, "shape": shape}, "cell": "none"}
    problem = po.problem_from_dict(document)
    assert problem.scene.switched_off
    assert not problem.scene.active
    assert problem.to_dict()["cell"] == "none"


@pytest.mark.parametrize(
    ("cell", "message"),
    [
        ("off", "'off' is no cell"),
        ({"clearance": "-5 mm"}, "clearance"),
        ({"clearance": "5 deg"}, "length"),
        ({"obstacles": [{"kind": "box", "size": ["1 m", "1 m", "1 m"]}]}, "name"),
        ({"obstacles": [{"name": " ", "kind": "sphere", "radius": "1 m"}]}, "an obstacle needs a name"),
        ({"obstacles": [LAMP, LAMP]}, "2 obstacles are called 'lamp'"),
        ({"obstacles": [{"name": "b", "kind": "box", "size": ["1 m", "0 m", "1 m"]}]}, "size"),
        ({"obstacles": [{"name": "b", "kind": "sphere", "radius": "-80 mm"}]}, "radius"),
        ({"obstacles": [{"name": "b", "kind": "cone", "radius": "80 mm"}]}, "cone"),
        ({"obstacles": [{"name": "b", "kind": "half_space", "normal": [0, 0, 0]}]}, "a normal of length zero"),
        ({"obstacles": [{**POST, "lenght": "1 m"}]}, "lenght"),
        ({"obstacles": [{**POST, "xyz": [0.3, 0.4, 0.4]}]}, "unit"),
    ],
)
def test_a_bad_cell_is_refused_by_what_is_wrong(cell: object, message: str) -> None:
    with pytest.raises(po.errors.InputError) as refused:
        po.problem_from_dict({"robot": ROBOT, "cell": cell})
    assert message in str(refused.value)
    assert "cell" in str(refused.value)


def test_the_default_clearance_is_zero() -> None:
    problem = po.problem_from_dict({"robot": ROBOT, "cell": {"obstacles": [LAMP]}})
    assert problem.scene.margin == 0
    assert math.isfinite(problem.scene.clearance([0.0] * 6).distance)


TODAY = """(noname)+
* table
0.5 0 -0.1
0 0 0.3826834323650898 0.9238795325112867
2
box
1.2 0.8 0.2
0 0.1 0
0 0 0 1
0.5 0.5 0.5 1
cylinder
0.05 0.4
0.2 0 0.3
0.7071067811865476 0 0 0.7071067811865476
0 0 0 0
1
grasp point
0 0 0.2
0 0 0 1
* ball: red
0 0 1
0 0 0 1
1
sphere
0.08
0.1 0 0
0 0 0 1
1 0 0 1
0
* ground
0 0 0
0 0 0 1
1
plane
0 0 2 1.6
0 0 0
0 0 0 1
0 0 0 0
0
.
"""
BEFORE = """scene
* wall
1
box
0.1 2 2
0.9 0 1
0 0 0 1
0 0 0 0
.
"""


def loaded(folder: Path, text: str, **cell: object) -> po.Problem:
    (folder / "cell.scene").write_text(text)
    document = {"robot": {"kind": "preset", "name": "ur5e"}, "cell": {"scene": "cell.scene", **cell}}
    return po.problem_from_dict(document, folder)


def test_objects_are_obstacles_where_moveit_has_them(tmp_path: Path) -> None:
    found = {o.name: o for o in loaded(tmp_path, TODAY).cell.obstacles}  # type: ignore[union-attr]
    assert list(found) == ["table 1", "table 2", "ball: red", "ground"]
    c = s = np.sqrt(0.5)
    T = np.array([[c, -s, 0, 0.5], [s, c, 0, 0], [0, 0, 1, -0.1], [0, 0, 0, 1]])
    box = coal.Transform3s(T[:3, :3], T[:3, :3] @ [0, 0.1, 0] + T[:3, 3])
    turned = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]])
    cylinder = coal.Transform3s(T[:3, :3] @ turned, T[:3, :3] @ [0.2, 0, 0.3] + T[:3, 3])
    solids = {"table 1": (coal.Box(1.2, 0.8, 0.2), box), "table 2": (coal.Cylinder(0.05, 0.4), cylinder)}
    points = np.random.default_rng(0).uniform(-1.5, 1.5, (40, 3))
    for name, (shape, pose) in solids.items():
        for x, ours in zip(points, found[name].distance(points, points), strict=True):
            at = coal.Transform3s(np.eye(3), x)
            theirs = coal.distance(shape, pose, coal.Sphere(1e-3), at, coal.DistanceRequest(), coal.DistanceResult())
            assert ours == pytest.approx(max(theirs + 1e-3, 0.0), abs=1e-6) or theirs < 0
    ball = np.linalg.norm(points - [0.1, 0, 1], axis=1) - 0.08
    np.testing.assert_allclose(found["ball: red"].distance(points, points), ball, atol=1e-12)
    np.testing.assert_allclose(found["ground"].distance(points, points), points[:, 2] + 0.8, atol=1e-12)


def test_scenes_from_before_moveit_1_1(tmp_path: Path) -> None:
    (wall,) = loaded(tmp_path, BEFORE).cell.obstacles  # type: ignore[union-attr]
    assert float(wall.distance(np.zeros((1, 3)), np.zeros((1, 3)))[0]) == pytest.approx(0.85)


def test_stated_obstacles_stay_and_the_file_goes_along(tmp_path: Path) -> None:
    stated = {"name": "wall", "kind": "sphere", "radius": "10 mm", "xyz": ["2 m", "0 m", "0 m"]}
    problem = loaded(tmp_path, BEFORE, obstacles=[stated], clearance="5 mm")
    assert [o.name for o in problem.cell.obstacles] == ["wall", "wall (scene)"]  # type: ignore[union-attr]
    for name, data in problem.files("copy").items():
        (tmp_path / name).write_bytes(data)
    again = po.load_problem(tmp_path / "copy.yaml").cell.obstacles  # type: ignore[union-attr]
    assert [o.name for o in again] == ["wall", "wall (scene)"]


@pytest.mark.parametrize(("text", "message"), [
    ("", "the file ends in the middle"),
    (BEFORE.replace("\n.\n", "\n"), "line 8: the file ends"),
    (BEFORE.replace("box", "mesh"), "line 4: object 'wall' has a shape 'mesh'.*kind mesh"),
    (BEFORE.replace("0.1 2 2", "0.1 2"), "line 5: '0.1 2' where 3 numbers belong"),
    (BEFORE.replace("0.1 2 2", "0.1 nan 2"), "line 5: "),
    (BEFORE.replace("0.1 2 2", "0 2 2"), "not above zero"),
    (BEFORE.replace("* wall", "wall"), "line 2: 'wall' where an object"),
    (BEFORE.replace("0 0 0 1\n0", "0 0 0 0\n0", 1), "a quaternion of length zero"),
])  # fmt: skip
def test_files_that_are_none(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(po.errors.InputError, match=message) as caught:
        loaded(tmp_path, text)
    assert caught.value.issues[0].key == ("cell", "scene")
