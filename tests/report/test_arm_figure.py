"""The picture of an arm: what is in front is seen, and callouts stand beside the arm."""

from __future__ import annotations

from itertools import combinations
from typing import Any

import numpy as np
import pytest

import posture_opt as po
from posture_opt.report.scene.arm_figure import MAX_CALLOUTS, draw_arm
from posture_opt.report.scene.arm_geometry import ArmGeometry
from posture_opt.report.scene.arm_solids import Solid
from posture_opt.report.scene.shaded_picture import Camera, Layer
from tests.helpers.variants import conformance

CELL = {"obstacles": [
    {"name": "table", "kind": "box", "size": ["1.6 m", "1.2 m", "40 mm"], "xyz": ["0.5 m", "0 m", "-20 mm"]},
    {"name": "post", "kind": "cylinder", "radius": "60 mm", "length": "0.8 m", "xyz": ["0.3 m", "0.6 m", "0.4 m"]},
    {"name": "lamp", "kind": "sphere", "radius": "80 mm", "xyz": ["0.7 m", "-0.4 m", "0.6 m"]},
]}  # fmt: skip
CELLS = {"bare": None, "cell": CELL}


def geometry_at(preset: str, draw: int, cell: Any = None) -> ArmGeometry:
    """A preset at one of its postures drawn by lot."""
    data = {
        "robot": {"kind": "preset", "name": preset},
        "uncertainty": {"repeatability": "0.1 mm"},
        "cell": cell or "none",
        "task": {"kind": "insert", "direction": [0, 0, -1], "position": ["0.4 m", "0.1 m", "0.1 m"]},
    }
    problem = po.problem_from_dict(data)
    lower, upper = np.maximum(problem.robot.lower, -2.0), np.minimum(problem.robot.upper, 2.0)
    q = np.random.default_rng(draw).uniform(lower, upper)
    return ArmGeometry.of_spread(po.propagate(problem, q))


@pytest.mark.usefixtures("coarse")
@pytest.mark.parametrize(
    ("preset", "cell", "draw"),
    conformance([("panda", "cell", 0), ("scara", "bare", 0), ("irb120", "cell", 1)], [("panda", "cell", 0)]),
)
def test_callouts_stand_beside_the_arm_and_their_lines_do_not_cross(preset: str, cell: str, draw: int) -> None:
    geometry = geometry_at(preset, draw, CELLS[cell])
    figure = draw_arm(geometry, preset, [(f"joint {k}", "0.0 deg") for k in range(6)])
    (axes,), (width, height) = figure.axes, figure.get_size_inches()
    boxes = {text.get_text(): text.get_window_extent() for text in axes.texts if text.get_text()}
    told = {text.replace("\n", " ") for text in boxes}
    assert any(text.startswith("tool point with its 95 %") for text in told)
    assert {"direction of the task", *(solid.name for solid in geometry.obstacles if solid.name == "post")} <= told
    for (one, a), (other, b) in combinations(boxes.items(), 2):
        assert not a.overlaps(b), (one, other)
    shares = np.array([box.extents for box in boxes.values()]) / np.tile(figure.dpi * np.array([width, height]), 2)
    assert shares.min() >= 0
    assert shares.max() <= 1
    lines = [line.get_xydata() for line in axes.lines if line.get_linewidth() == 0.8]
    assert 2 <= len(lines) <= MAX_CALLOUTS
    for (a, b), (c, d) in combinations(lines, 2):
        sides = [
            np.linalg.det(np.column_stack([three, np.ones(3)])) > 0
            for three in ((a, b, c), (a, b, d), (c, d, a), (c, d, b))
        ]
        assert sides[0] == sides[1] or sides[2] == sides[3]
    column = axes.transData.inverted().transform(boxes["joint 0"].extents.reshape(2, 2))[:, 0]
    assert arm_pixels(axes, column).mean() < 0.02


def arm_pixels(axes: Any, column: np.ndarray) -> Any:
    """(H, W) whether the pixels of a column [inch] are as blue as joints or orange as the region are."""
    pixels = np.asarray(axes.images[0].get_array())
    low, high = (column / axes.get_xlim()[1] * pixels.shape[1]).astype(int)
    return np.ptp(pixels[:, low:high], axis=2) > 0.35


def test_the_nearest_face_is_seen_as_rays_find_it() -> None:
    """Faces through each other, by the crossing of each face with the ray of each point (Möller, Trumbore 1997)."""
    rng = np.random.default_rng(3)
    corner, u, v = rng.normal(size=(3, 25, 1, 3))
    faces = corner + np.concatenate([0 * u, u, u + v, v], axis=1)
    camera = Camera.at(0.7, 0.4).framing(faces.reshape(-1, 3), 1.3, (0.05,) * 4)
    layer = Layer.of([Solid(f"{k}", "link", -1, face[None]) for k, face in enumerate(faces)], camera, (40, 52))
    found, depth = rays(camera.project(faces), camera, (40, 52))
    np.testing.assert_array_equal(layer.owner, found)
    assert len(np.unique(found)) > 10
    np.testing.assert_allclose(layer.depth[layer.there], depth[layer.there], atol=1e-9)


def rays(seen: np.ndarray, camera: Camera, shape: tuple[int, int]) -> tuple[Any, np.ndarray]:
    best = np.full(shape, -np.inf)
    face = np.full(shape, -1)
    for row, column in np.ndindex(*shape):
        point = camera.lower + (np.array([column, row]) + 0.5) / [shape[1], shape[0]] * camera.size
        for k, (a, b, _, d) in enumerate(seen):
            s, t = np.linalg.solve(np.column_stack([b - a, d - a])[:2], point - a[:2])
            depth = a[2] + s * (b - a)[2] + t * (d - a)[2]
            if 0 <= s <= 1 and 0 <= t <= 1 and depth > best[row, column]:
                best[row, column], face[row, column] = depth, k
    return face, best
