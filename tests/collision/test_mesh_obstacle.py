"""Obstacles from CAD: enclosed by boxes that nothing of the part looks out of, held against coal; drawn as they are."""

from __future__ import annotations

from pathlib import Path

import coal
import numpy as np
import pytest
import trimesh

import posture_opt as po
from posture_opt.collision.obstacles import Mesh
from posture_opt.collision.obstacles.mesh import enclosed_mesh


def tray() -> trimesh.Trimesh:
    """A floor of 400 x 300 x 20 mm with two walls [mm]."""
    walls = [trimesh.creation.box((20, 300, 190)).apply_translation([x, 0, 105]) for x in (-190, 190)]
    return trimesh.util.concatenate([trimesh.creation.box((400, 300, 20)), *walls])


PARTS = {
    "tray.stl": tray,
    "ring.obj": lambda: trimesh.creation.annulus(80, 120, 100, sections=16),
    "ball.ply": lambda: trimesh.creation.icosphere(1, 100),
    "leaning.stl": lambda: trimesh.creation.box((300, 40, 20)).apply_transform(
        trimesh.transformations.rotation_matrix(0.5, [1, 2, 3])
    ),
}


def part(folder: Path, name: str) -> tuple[trimesh.Trimesh, Path]:
    mesh = PARTS[name]()
    mesh.export(folder / name)
    return mesh, folder / name


@pytest.mark.parametrize("name", PARTS)
def test_nothing_of_the_solid_looks_out_of_its_boxes(tmp_path: Path, name: str) -> None:
    mesh, path = part(tmp_path, name)
    found = enclosed_mesh(path, 1e-3, 12)
    assert len(found.boxes) <= 12
    rng = np.random.default_rng(0)
    inside = mesh.bounds[0] + rng.random((4000, 3)) * np.ptp(mesh.bounds, axis=0)
    if name == "tray.stl":  # solids that overlap: by hand
        x, y, z = inside.T
        inside = inside[(np.abs(y) < 150) & ((np.abs(z) < 10) | ((np.abs(np.abs(x) - 190) < 10) & (z > 0)))]
    elif name == "ring.obj":
        radius = np.hypot(*inside.T[:2])
        inside = inside[(radius > 80) & (radius < 117)]
    else:
        hull = mesh.face_normals, mesh.triangles_center
        inside = inside[[bool(np.all(np.einsum("ij,ij->i", hull[0], p - hull[1]) < 0)) for p in inside]]
    points = np.vstack([inside, mesh.vertices]) * 1e-3
    held = np.zeros(len(points), dtype=bool)
    for box in found.boxes:
        local = (points - box.middle) @ box.rotation
        held |= np.all(np.abs(local) <= box.size / 2 + 1e-7, axis=1)
    assert held.all()


def test_boxes_of_parts_with_straight_sides_are_the_part(tmp_path: Path) -> None:
    for name, count in (("tray.stl", 3), ("leaning.stl", 1)):
        found = enclosed_mesh(part(tmp_path, name)[1], 1e-3, 12)
        assert (len(found.boxes), found.outside) == (count, pytest.approx(0.0, abs=1e-6))
    rough = enclosed_mesh(part(tmp_path, "ring.obj")[1], 1e-3, 1).outside
    fine = enclosed_mesh(part(tmp_path, "ring.obj")[1], 1e-3, 24).outside
    assert 0 < fine < rough / 2 == pytest.approx((80 / 2) * 1e-3, rel=0.2)


@pytest.mark.parametrize("name", ["tray.stl", "ring.obj"])
def test_distances_are_coals(tmp_path: Path, name: str) -> None:
    """Never more than coal's distance to the mesh itself, and less by no more than what the note states."""
    mesh, _ = part(tmp_path, name)
    keys = {"name": "part", "kind": "mesh", "file": name, "unit": "mm"}
    place = {"xyz": ["0.3 m", "-0.1 m", "0.2 m"], "rpy": ["10 deg", "-30 deg", "50 deg"]}
    obstacle = Mesh(**keys, **place).in_folder(tmp_path)  # type: ignore[arg-type]
    model = coal.BVHModelOBBRSS()
    model.beginModel(len(mesh.faces), len(mesh.vertices))
    model.addVertices(np.asarray(mesh.vertices) * 1e-3)
    for a, b, c in mesh.faces:
        model.addTriangle(*(np.asarray(mesh.vertices[k]) * 1e-3 for k in (a, b, c)))
    model.endModel()
    there = coal.Transform3s(obstacle.rotation, np.array(obstacle.xyz))
    rng = np.random.default_rng(1)
    start, end = rng.uniform(-0.6, 1.0, (2, 40, 3))
    found = obstacle.distance(start, end)
    for k in range(len(start)):
        along = end[k] - start[k]
        length = float(np.linalg.norm(along))
        z = along / length
        x = np.cross(z, np.eye(3)[np.argmin(np.abs(z))])
        x /= np.linalg.norm(x)
        pose = coal.Transform3s(np.column_stack([x, np.cross(z, x), z]), (start[k] + end[k]) / 2)
        radius = 1e-4
        exact = coal.distance(
            model, there, coal.Capsule(radius, length), pose, coal.DistanceRequest(), coal.DistanceResult()
        )
        exact = max(exact + radius, 0.0)
        assert found[k] <= exact + 1e-6
        assert found[k] >= exact - obstacle.enclosed.outside - 1e-6 or exact < 2 * radius


def scene(folder: Path, obstacle: dict[str, object]) -> po.Problem:
    return po.problem_from_dict({
        "robot": {"kind": "preset", "name": "ur5e"},
        "uncertainty": {"repeatability": "0.03 mm"},
        "cell": {"obstacles": [{"name": "tray", **obstacle}], "clearance": "10 mm"},
        "task": {"kind": "insert", "direction": [0, 0, -1], "position": ["0.45 m", "0 m", "0.05 m"]},
        "solver": {"starts": 2, "seed": 0},
    }, folder)  # fmt: skip


PLACED = {"kind": "mesh", "file": "tray.stl", "unit": "mm", "xyz": ["0.5 m", "0 m", "0.011 m"]}


@pytest.mark.long
def test_the_arm_keeps_clear_of_a_tray_and_the_report_shows_it(tmp_path: Path) -> None:
    part(tmp_path, "tray.stl")
    problem = scene(tmp_path, PLACED)
    (note,) = [note for note in problem.notes if "tray.stl" in note]
    assert note == "tray (tray.stl, 36 faces) is checked by 3 boxes about it, at most 0.0 mm outside"
    found = po.select_posture(problem)
    assert found.status == "optimal"
    sides = [{"size": ["0.4 m", "0.3 m", "20 mm"]}, *({"size": ["20 mm", "0.3 m", "190 mm"]},) * 2]
    places = [["0.5 m", "0 m", "0.011 m"], ["0.31 m", "0 m", "0.116 m"], ["0.69 m", "0 m", "0.116 m"]]
    boxes = [
        {"name": f"b{k}", "kind": "box", **s, "xyz": p} for k, (s, p) in enumerate(zip(sides, places, strict=True))
    ]
    same = problem.replace(cell__obstacles=boxes)
    assert found.clearance is not None
    assert same.scene.least(found.q[None])[0] == pytest.approx(problem.scene.least(found.q[None])[0], abs=1e-6)
    assert {"p.yaml", "p_obstacle1.stl"} <= {*problem.files("p")}
    again = tmp_path / "elsewhere"
    again.mkdir()
    for name, data in problem.files("p").items():
        (again / name).write_bytes(data)
    assert po.load_problem(again / "p.yaml").notes == tuple(
        n.replace("tray.stl", "p_obstacle1.stl") for n in problem.notes
    )


@pytest.mark.parametrize(("keys", "message"), [
    ({"file": "none.stl"}, r"cell\.obstacles\[0\]\.file: no such file"),
    ({"file": "broken.stl"}, r"cell\.obstacles\[0\]\.file: mesh broken\.stl"),
    ({"file": "part.step"}, r"mesh part\.step is none of \.dae, \.obj, \.off, \.ply, \.stl"),
    ({"unit": "furlong"}, "unit"),
])  # fmt: skip
def test_files_that_cannot_be_used(tmp_path: Path, keys: dict[str, object], message: str) -> None:
    (tmp_path / "broken.stl").write_bytes(b"solid nothing\nendsolid nothing\n")
    (tmp_path / "part.step").write_text("ISO-10303-21;")
    part(tmp_path, "tray.stl")
    with pytest.raises(po.errors.InputError, match=message):
        scene(tmp_path, {**PLACED, **keys})
