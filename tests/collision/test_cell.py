"""The section ``cell`` of a problem file: what it holds, and what is said of a bad one."""

from __future__ import annotations

import math

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
        ({"clearance": 5}, "unit"),
        ({"clearance": "5 deg"}, "length"),
        ({"obstacles": [{"kind": "box", "size": ["1 m", "1 m", "1 m"]}]}, "name"),
        ({"obstacles": [{"name": " ", "kind": "sphere", "radius": "1 m"}]}, "an obstacle needs a name"),
        ({"obstacles": [LAMP, LAMP]}, "2 obstacles are called 'lamp'"),
        ({"obstacles": [{"name": "b", "kind": "box", "size": ["1 m", "0 m", "1 m"]}]}, "size"),
        ({"obstacles": [{"name": "b", "kind": "box", "size": ["1 m", "1 m"]}]}, "size"),
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
