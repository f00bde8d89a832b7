"""Boards in pictures of a renderer of its own: found to a part of a pixel, and every way in which they are not."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

import posture_opt as po
from posture_opt.measurements.board_detection import Board, detect_board
from tests.helpers.cameras import TrueCamera, frame
from tests.helpers.pictures import chessboard, rendered, write_png

CAMERA = TrueCamera(np.eye(4), focal=(450.0, 448.0), centre=(202.0, 148.0), size=(400, 300))
LARGE = TrueCamera(np.eye(4), focal=(720.0, 718.0), centre=(322.0, 238.0), size=(640, 480))
POSES = [frame([0.3, -0.2, 0.1], [-0.12, -0.08, 0.55]), frame([-0.3, 0.25, -0.3], [-0.13, -0.04, 0.5])]
JOINTS = "image, joint1 [deg], joint2 [deg]\n0.png, 1, 2\n1.png, 3, 4\nblank.png, 5, 6\n"


def folder_of(
    folder: Path, camera: TrueCamera, pattern: np.ndarray, cell: float, poses: Sequence[np.ndarray] = POSES
) -> list[Path]:
    """Pictures 0.png, 1.png, … with a table of joints beside them."""
    rng = np.random.default_rng(0)
    for k, pose in enumerate(poses):
        grey = rendered(camera, pose, pattern, cell)
        write_png(folder / f"{k}.png", grey + rng.normal(0, 2, grey.shape))
    (folder / "joints.csv").write_text(JOINTS, encoding="utf-8")
    return [folder / f"{k}.png" for k in range(len(poses))]


def pixels_of(text: str, image: str) -> dict[int, np.ndarray]:
    """Number of a point -> its pixels, of one picture."""
    rows = [line.split(", ") for line in text.splitlines()[1:]]
    return {int(r[4].partition("/")[2]): np.array(r[5:], dtype=float) for r in rows if r[2] == image}


def corners(columns: int, rows: int, cell: float, rim: int) -> np.ndarray:
    """(rows·columns, 3) of inner corners in the frame of the rendered board."""
    return np.array([[(c + 1 + rim) * cell, (r + 1 + rim) * cell, 0.0] for r in range(rows) for c in range(columns)])


def test_a_chessboard_is_found_to_a_tenth_of_a_pixel(tmp_path: Path) -> None:
    pytest.importorskip("cv2")
    images = folder_of(tmp_path, CAMERA, chessboard(5, 4), 0.035, POSES[:1])
    write_png(tmp_path / "blank.png", np.full((300, 400), 128.0))
    found = detect_board(
        [*images, tmp_path / "blank.png"], Board.of("chessboard:5x4:35mm"), tmp_path / "joints.csv", "left"
    )
    assert dict(found.found) == {"0.png": 20, "blank.png": 0}
    assert found.text.splitlines()[0] == "joint1 [deg], joint2 [deg], pose, camera, marker, u [px], v [px]"
    seen = pixels_of(found.text, "0.png")
    true = CAMERA.pixels(corners(5, 4, 0.035, 1) @ POSES[0][:3, :3].T + POSES[0][:3, 3])
    off = np.array([seen[k] for k in range(20)])
    error = min(float(np.sqrt(np.mean((off - way) ** 2))) for way in (true, true[::-1]))
    assert error < 0.1


@pytest.mark.long
def test_a_charuco_board_is_found_to_a_seventh_of_a_pixel(tmp_path: Path) -> None:
    cv2 = pytest.importorskip("cv2")
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_1000)
    printed = cv2.aruco.CharucoBoard((7, 5), 0.030, 0.021, dictionary)
    cells = 10  # of 3 mm in a square, so that marks of 7 x 7 cells fill 21 mm
    pattern = np.pad(printed.generateImage((70 * 4, 50 * 4), marginSize=0), 40, constant_values=255)
    images = folder_of(tmp_path, LARGE, pattern, 0.030 / cells / 4)
    found = detect_board(images, Board.of("charuco:7x5:30mm:21mm"), tmp_path / "joints.csv", "left")
    for k, pose in enumerate(POSES):
        seen = pixels_of(found.text, f"{k}.png")
        assert len(seen) > 20
        place = corners(6, 4, 0.030, 0) + np.array([0.030, 0.030, 0.0])  # 40 pixels of rim are a square
        true = LARGE.pixels(place @ pose[:3, :3].T + pose[:3, 3])
        assert np.sqrt(np.mean((np.array(list(seen.values())) - true[list(seen)]) ** 2)) < 0.15


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("board:5x7:30mm", "is no board"),
        ("charuco:5x7:30mm", "is no board"),
        ("chessboard:5:30mm", "no number of columns and rows"),
        ("charuco:5x7:20mm:30mm", "marks within their squares"),
        ("grid:1x7:20mm", "at least 2 x 2"),
        ("grid:4x7:20", "unit"),
        ("chessboard:100000000000000000000x6:25mm", "more than the 2500 that are accepted"),
    ],
)
def test_what_is_no_board_is_refused(text: str, words: str) -> None:
    with pytest.raises(po.errors.BadValueError) as caught:
        Board.of(text)
    assert words in f"{caught.value.message} {caught.value.hint}"


def test_files_that_do_not_fit_are_named(tmp_path: Path) -> None:
    pytest.importorskip("cv2")
    board, table = Board.of("grid:4x7:20mm"), tmp_path / "joints.csv"
    picture = tmp_path / "0.png"
    picture.write_bytes(b"no picture")
    for text, words in (
        ("picture, joint1 [deg]\n0.png, 1\n", "no column image"),
        ("image, joint1 [deg]\n1.png, 1\n", r"no row is of the picture 0\.png"),
        ("image, joint1 [deg]\n0.png, 1\n0.png, 2\n", "named twice"),
        ("image, joint1 [deg]\n0.png, 1\n", "this is no picture"),
    ):
        table.write_text(text, encoding="utf-8")
        with pytest.raises(po.errors.InputError, match=words):
            detect_board([picture], board, table, "left")


def test_a_board_that_no_picture_shows_is_no_empty_table(tmp_path: Path) -> None:
    pytest.importorskip("cv2")
    table, picture = tmp_path / "joints.csv", tmp_path / "0.png"
    table.write_text("image, joint1 [deg]\n0.png, 1\n", encoding="utf-8")
    write_png(picture, np.full((60, 80), 128.0))
    with pytest.raises(po.errors.InsufficientDataError, match=r"the board was not found in 0\.png"):
        detect_board([picture], Board.of("grid:4x7:20mm"), table, "left")
    with pytest.raises(po.errors.BadValueError, match="10 x 20 squares has 100 marks, and dictionary 4X4_50 has 50"):
        detect_board([picture], Board.of("charuco:10x20:20mm:15mm", "4X4_50"), table, "left")
    (tmp_path / "other").mkdir()
    same = tmp_path / "other" / "0.png"
    same.write_bytes(picture.read_bytes())
    with pytest.raises(po.errors.InputError, match=r"2 of the named pictures are called 0\.png"):
        detect_board([picture, same], Board.of("grid:4x7:20mm"), table, "left")


def test_without_opencv_the_command_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "cv2", None)
    (tmp_path / "joints.csv").write_text("image, joint1 [deg]\n0.png, 1\n", encoding="utf-8")
    with pytest.raises(po.errors.InputError, match=r"pip install 'posture_opt\[camera\]'") as caught:
        detect_board([tmp_path / "0.png"], Board.of("grid:4x7:20mm"), tmp_path / "joints.csv", "left")
    assert caught.value.exit_code == 2
