"""The arm in space: what is in front is seen, labels meet neither each other nor the arm, and the picture is filled."""

from __future__ import annotations

from itertools import combinations, product
from typing import Any

import numpy as np
import pytest

import posture_opt as po
from posture_opt.collision.facets import capsule_facets
from posture_opt.numerics import Array
from posture_opt.problem.load import load_builtin
from posture_opt.report.page.style import WIDTH
from posture_opt.report.scene import scene_image
from posture_opt.report.scene.arm_geometry import ArmGeometry
from posture_opt.report.scene.arm_in_plane import hull
from posture_opt.report.scene.arm_in_space import draw_in_space, label_boxes
from posture_opt.report.scene.camera import Camera, best_camera
from posture_opt.report.scene.depth_image import DepthImage
from posture_opt.report.scene.label_placement import overlap
from posture_opt.report.scene.shading import corner_normals
from tests.helpers.variants import conformance

CELL = {"obstacles": [
    {"name": "table", "kind": "box", "size": ["1.6 m", "1.2 m", "40 mm"], "xyz": ["0.5 m", "0 m", "-20 mm"]},
    {"name": "post", "kind": "cylinder", "radius": "60 mm", "length": "0.8 m", "xyz": ["0.3 m", "0.6 m", "0.4 m"]},
    {"name": "lamp", "kind": "sphere", "radius": "80 mm", "xyz": ["0.7 m", "-0.4 m", "0.6 m"]},
]}  # fmt: skip
CELLS = {"bare": None, "cell": CELL}
PRESETS = ("panda", "ur5e", "scara", "irb120")


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
    conformance(product(PRESETS, CELLS, range(2)), [("panda", "cell", 0), ("scara", "bare", 0)]),
)
def test_labels_are_apart_and_the_picture_is_filled(preset: str, cell: str, draw: int) -> None:
    geometry = geometry_at(preset, draw, CELLS[cell])
    figure = draw_in_space(geometry, preset, [(f"joint {k}", "0.0 deg") for k in range(6)])
    labels, scene = label_boxes(figure), scene_of(figure, geometry)
    arm, filled = scene.arm_mask, scene.filled
    assert {"tool point", "direction of the task"} <= {label.label.text for label in labels}
    for a, b in combinations(labels, 2):
        assert overlap(a.box, b.box) == 0, (a.label.text, b.label.text)
    shares = np.array([label.box for label in labels]) / np.tile(72 * figure.get_size_inches(), 2)
    assert shares.min() >= 0
    assert shares.max() <= 1
    for label, (left, low, right, high) in zip(labels, shares, strict=True):
        rows, columns = (
            slice(int(a * n), int(b * n) + 1) for a, b, n in zip((low, left), (high, right), arm.shape, strict=True)
        )
        assert arm[rows, columns].mean() < 0.15, label.label.text
    rows, columns = (np.flatnonzero(filled.any(axis=axis)) / arm.shape[1 - axis] for axis in (1, 0))
    across = 1.0 - min(columns[0], shares[:, 0].min())
    # To the right there are the values of the joints.
    upwards = max(rows[-1], shares[:, 3].max()) - min(rows[0], shares[:, 1].min())
    assert across > 2 / 3
    assert upwards > 2 / 3


def scene_of(figure: Any, geometry: ArmGeometry) -> scene_image.SceneImage:
    """The picture of a figure."""
    left, right, low, high = figure.axes[0].images[0].get_extent()
    view = best_camera(geometry)
    camera = Camera(view.azimuth, view.elevation, np.array([left, low]), np.array([right - left, high - low]))
    return scene_image.SceneImage(geometry, camera, float(figure.get_size_inches()[1]))


def test_the_nearest_face_is_seen_as_rays_find_it() -> None:
    """Faces through each other, by the crossing of each face with the ray of each point (Möller, Trumbore 1997)."""
    rng = np.random.default_rng(3)
    corner, u, v = rng.normal(size=(3, 25, 1, 3))
    faces = corner + np.concatenate([0 * u, u, u + v, v], axis=1)
    camera = Camera.at(0.7, 0.4).framing(faces.reshape(-1, 3), 1.3, (0.05, 0.05))
    image = DepthImage.of(faces, camera, (40, 52))
    found = rays(camera.project(faces.reshape(-1, 3)).reshape(-1, 4, 3), camera, (40, 52))
    np.testing.assert_array_equal(image.face, found)
    assert len(np.unique(found)) > 10
    there = image.face >= 0
    world = np.einsum("mk,mkj->mj", image.weights[there], faces[image.face[there]])
    np.testing.assert_allclose(world @ camera.axes[2], image.depth[there], atol=1e-9)


def rays(seen: Array, camera: Camera, shape: tuple[int, int]) -> Any:
    best = np.full(shape, -np.inf)
    face = np.full(shape, -1)
    for row, column in np.ndindex(*shape):
        point = camera.lower + (np.array([column, row]) + 0.5) / [shape[1], shape[0]] * camera.size
        for k, (a, b, _, d) in enumerate(seen):
            s, t = np.linalg.solve(np.column_stack([b - a, d - a])[:2], point - a[:2])
            depth = a[2] + s * (b - a)[2] + t * (d - a)[2]
            if 0 <= s <= 1 and 0 <= t <= 1 and depth > best[row, column]:
                best[row, column], face[row, column] = depth, k
    return face


def test_a_ball_is_shaded_as_a_ball() -> None:
    faces = capsule_facets(np.zeros(3), np.zeros(3), 0.1)
    faces = faces[np.linalg.norm(np.cross(faces[:, 3] - faces[:, 1], faces[:, 2] - faces[:, 0]), axis=1) > 1e-9]
    outward = faces / np.linalg.norm(faces, axis=-1, keepdims=True)
    normals = corner_normals(faces)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    # Facets of 18 deg: their mean at a corner leans by less than half of that.
    assert np.abs(np.sum(normals * outward, axis=-1)).min() > np.cos(np.radians(9.0))


def test_the_frame_holds_what_it_must() -> None:
    points = np.random.default_rng(0).normal(size=(50, 3))
    camera = Camera.at(1.0, 0.3).framing(points, 1.6, (0.2, 0.1))
    np.testing.assert_allclose(camera.axes @ camera.axes.T, np.eye(3), atol=1e-12)
    share = (camera.project(points)[:, :2] - camera.lower) / camera.size
    assert np.all(share.min(axis=0) > np.array([0.2, 0.1]) - 1e-9)
    assert np.all(share.max(axis=0) < np.array([0.8, 0.9]) + 1e-9)


def test_hull_of_points_is_scipys() -> None:
    from scipy.spatial import ConvexHull

    points = np.random.default_rng(1).normal(size=(60, 2))
    ours = hull(points)
    assert sorted(map(tuple, ours.round(6))) == sorted(map(tuple, points[ConvexHull(points).vertices].round(6)))


@pytest.mark.long
def test_the_figure_says_which_arm_it_is() -> None:
    figure = po.propagate(load_builtin("insert_panda"), [0, -0.8, 0, -2.4, 0, 1.6, 0.8]).plot()
    assert "Franka Emika Panda" in {text.get_text() for text in figure.axes[0].texts}
    assert figure.get_size_inches()[0] == WIDTH
