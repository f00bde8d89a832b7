"""Cameras: projection, derivatives, starts without a guess, files of intrinsics, and what is wrong in files."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest
import yaml

import posture_opt as po
from posture_opt.measurements.camera_section import Intrinsics
from posture_opt.measurements.kinds import MarkerPixels
from posture_opt.problem.named_files import read_intrinsics
from tests.helpers.cameras import TOOL_SCENE, Scene, camera_problem, camera_table, grid
from tests.helpers.instruments import TrueArm


@cache
def nominal_pictures(on_tool: bool) -> dict[str, np.ndarray]:
    """24 exact pictures of the nominal arm."""
    scene = TOOL_SCENE if on_tool else Scene()
    return {k: np.asarray(v) for k, v in camera_table(TrueArm(), np.random.default_rng(2), 24, 0.0, scene).items()}


def pictures(on_tool: bool, n: int) -> dict[str, np.ndarray]:
    """The first n of them, all corners of each."""
    return {key: column[: n * len(grid())] for key, column in nominal_pictures(on_tool).items()}


def test_a_key_that_yaml_1_1_makes_true_is_read_as_on() -> None:
    text = "{markers: {board: {on: tool, chessboard: {rows: 6, columns: 8, square: 25 mm}}}}"
    given = po.problem_from_dict({"robot": {"kind": "preset", "name": "ur10"}, "data": yaml.safe_load(text)})
    assert given.data.markers["board"].on == "tool"


def test_pixels_are_those_of_opencv() -> None:
    cv2 = pytest.importorskip("cv2")
    from posture_opt.measurements.camera_section import projected

    k = np.array([-0.2, 0.1, 1e-3, -2e-3, 0.03])
    points = np.random.default_rng(0).uniform([-0.3, -0.3, 0.8], [0.3, 0.3, 1.2], (50, 3))
    K = np.array([[1200.0, 0, 640], [0, 1190, 510], [0, 0, 1]])
    theirs, J = cv2.projectPoints(points, np.zeros(3), np.zeros(3), K, k)
    intrinsics = Intrinsics((1200.0, 1190.0), (640.0, 510.0), tuple(k))
    found = projected(points, np.tile(intrinsics.row, (50, 1)), np.zeros((50, 7)))
    assert np.allclose(found.pixels, theirs[:, 0], atol=1e-9)
    assert np.allclose(found.by_point.reshape(100, 3), J[:, 3:6], atol=1e-9)
    assert np.allclose(found.by_intrinsics[:, :, 3:].reshape(100, 4), J[:, 10:14], atol=1e-9)
    assert np.allclose(intrinsics.rays(found.pixels), points[:, :2] / points[:, 2:], atol=1e-9)


@pytest.mark.parametrize(("scene", "known"), [(Scene(), True), (TOOL_SCENE, False)], ids=["cell", "tool, markers"])
def test_cameras_and_boards_start_without_a_guess(scene: Scene, known: bool, tmp_path: Path) -> None:
    table = pictures(scene.on_tool, 24)
    given = po.problem_from_dict(camera_problem(tmp_path, scene, known=known), tmp_path)
    data = po.read_measurements(table, given)
    kind = data.kind
    assert isinstance(kind, MarkerPixels)
    assert kind.fixes_size is known
    assert np.allclose(kind.camera_frames[0], scene.camera.pose, atol=2e-3 if known else 2e-2)
    if known:
        assert np.allclose(kind.body_frames[0], scene.board, atol=2e-3)
    else:
        corners = scene.corners @ scene.board[:3, :3].T + scene.board[:3, 3]
        assert np.allclose(kind.body_frames[:, :3, 3], corners, atol=2e-2)
    again = po.read_measurements(data.to_dataframe(), given)
    assert np.array_equal(again.reading, data.reading)
    assert again.second_names == data.second_names


ROS = """image_width: 640
image_height: 480
camera_name: left
camera_matrix: {rows: 3, cols: 3, data: [500.5, 0, 320, 0, 501, 240, 0, 0, 1]}
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [0.1, -0.2, 0.001, 0.002, 0.0]
rectification_matrix: {rows: 3, cols: 3, data: [1, 0, 0, 0, 1, 0, 0, 0, 1]}
"""


def test_files_of_opencv_and_ros_are_read(tmp_path: Path) -> None:
    (tmp_path / "ros.yaml").write_text(ROS, encoding="utf-8")
    (tmp_path / "cv.yaml").write_text(Scene().camera.text(), encoding="utf-8")
    ros, opencv = (read_intrinsics(tmp_path / name) for name in ("ros.yaml", "cv.yaml"))
    assert ros == Intrinsics((500.5, 501.0), (320.0, 240.0), (0.1, -0.2, 0.001, 0.002, 0.0), (640, 480))
    assert opencv.focal == Scene().camera.focal
    assert opencv.distortion == Scene().camera.k


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("- 1", "no YAML of a camera"),
        ("camera_matrix: {data: [1, 2]}", "not nine numbers"),
        ("camera_matrix: {data: [a, 0, 1, 0, 2, 1, 0, 0, 1]}", "camera_matrix is missing, or has no numbers"),
        ("camera_matrix: {data: [0, 0, 1, 0, 2, 1, 0, 0, 1]}", "focal lengths are not positive"),
        (ROS.replace("plumb_bob", "equidistant"), "distortion model equidistant is not known"),
        ("camera_matrix: {data: [5, 0, 1, 0, 5, 1, 0, 0, 1]}\nD: [0, 0, 0, 0, 0, 1, 2, 3]", "more than five"),
    ],
)
def test_files_that_are_none_of_a_camera_are_refused(text: str, words: str, tmp_path: Path) -> None:
    (tmp_path / "left.yaml").write_text(text, encoding="utf-8")
    with pytest.raises(po.errors.InputError, match=words):
        read_intrinsics(tmp_path / "left.yaml")


def test_what_the_problem_leaves_open_is_said(tmp_path: Path) -> None:
    table = pictures(False, 4)
    given = camera_problem(tmp_path)
    elsewhere = {"cameras": {"left": {"mount": "cell", "intrinsics": "right.yaml"}}}
    with pytest.raises(po.errors.InputError, match=r"no such file.*: .*right\.yaml"):
        po.problem_from_dict({**given, "data": elsewhere}, tmp_path)
    small = {"rows": 3, "columns": 4, "square": "25 mm"}
    for change, words in (
        ({"cameras": {}}, r"says nothing of the camera left"),
        ({"markers": {"board": {"on": "cell"}}}, r"the board 'board' and a camera are both on the cell"),
        (
            {"markers": {"board": {"on": "tool", "grid": small}}},
            "has no point '12'",
        ),
    ):
        problem = po.problem_from_dict({**given, "data": {**given["data"], **change}}, tmp_path)  # type: ignore[dict-item]
        with pytest.raises(po.errors.InputError, match=words):
            po.read_measurements(table, problem)
    few = {key: value[: len(grid()) * 2] for key, value in table.items()}  # type: ignore[index]
    with pytest.raises(po.errors.InputError, match="too few pictures to say where the camera is"):
        po.read_measurements(few, po.problem_from_dict(given, tmp_path))


def test_points_of_a_board_come_from_a_file(tmp_path: Path) -> None:
    rows = [f"{k}, {1e3 * x:.3f}, {1e3 * y:.3f}" for k, (x, y, _) in enumerate(grid())]
    (tmp_path / "board.csv").write_text("\n".join(["marker, x [mm], y [mm]", *rows, ""]), encoding="utf-8")
    text = camera_problem(tmp_path)
    text["data"]["markers"] = {"board": {"on": "tool", "points": "board.csv"}}  # type: ignore[index]
    data = po.read_measurements(pictures(False, 6), po.problem_from_dict(text, tmp_path))
    assert isinstance(data.kind, MarkerPixels)
    assert np.allclose(data.kind.bodies.points, grid(), atol=1e-9)
