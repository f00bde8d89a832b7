"""OpenCV's hand-eye calibrations on the same pictures, the arm held, have the larger error."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.helpers.hand_eye import errors_of


@pytest.mark.long
@pytest.mark.parametrize("where", ["cell", "tool"])
def test_opencv_has_the_larger_error(where: str, tmp_path: Path) -> None:
    cv2 = pytest.importorskip("cv2")
    if not hasattr(cv2, "calibrateRobotWorldHandEye"):
        pytest.skip("this OpenCV has no hand-eye calibration")
    ours, held, theirs = errors_of(cv2, where, tmp_path, 4)
    assert held < 1.25 * min(theirs)  # frames alone are worth as much, whoever fits them
    assert ours < 0.5 * min(theirs)
