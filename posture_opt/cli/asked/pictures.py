"""Pictures of boards that a command line names."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from posture_opt.errors import BadValueError, InputError
from posture_opt.measurements.board_detection import Board, Detections, detect_board


def detected(
    images: Sequence[Path], board: str, joints: Path | None, camera: str, name: str, dictionary: str
) -> Detections:
    """The points of a board in pictures, with the joints of every picture.

    Args:
        board: as ``charuco:5x7:30mm:22mm``; joints: None for ``joints.csv`` beside the first picture.

    Raises:
        InputError: no board, no OpenCV, or files that cannot be read.
    """
    try:
        return detect_board(
            images, Board.of(board, dictionary), joints or images[0].with_name("joints.csv"), camera, name
        )
    except BadValueError as error:
        raise InputError(error.issue(("--board",), board)) from None
