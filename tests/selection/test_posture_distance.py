"""How far a posture is from measured ones, counted by hand."""

from __future__ import annotations

import numpy as np
import pytest

from posture_opt.robot import load_preset
from posture_opt.selection.comparison.predicted_error import PostureDistance

PLANAR = load_preset("planar_2r")
MEASURED = np.radians([[0.0, 10.0], [40.0, 30.0], [20.0, -50.0]])


def distance(*degrees: float) -> PostureDistance:
    return PostureDistance.of(PLANAR, np.radians(degrees), MEASURED)


def test_within_the_measured_ranges() -> None:
    found = distance(35.0, 20.0)
    assert found.joint == ""
    assert found.beyond == 0.0
    assert np.degrees(found.nearest) == pytest.approx(10.0)  # of the second row


def test_the_joint_that_is_farthest_outside_is_named() -> None:
    found = distance(50.0, -90.0)
    assert (found.joint, np.degrees(found.beyond)) == ("joint2", pytest.approx(40.0))
    assert np.degrees(found.nearest) == pytest.approx(40.0)
    assert found.to_json() == {"nearest": found.nearest, "joint": "joint2", "beyond": found.beyond}


def test_a_whole_turn_is_none() -> None:
    assert distance(20.0 + 360.0, -50.0).nearest == pytest.approx(0.0, abs=1e-12)
    assert distance(20.0 + 360.0, -50.0).joint == ""
    assert np.degrees(distance(-20.0, 0.0).beyond) == pytest.approx(20.0)


def test_slides_have_a_range_of_their_own() -> None:
    scara = load_preset("scara")
    measured = np.array([[0.0, 0.0, 0.02, 0.0], [0.5, 0.5, 0.05, 0.5]])
    found = PostureDistance.of(scara, np.array([0.2, 0.2, 0.15, 0.2]), measured)
    assert found.joint == scara.joint_names[2]
    assert found.beyond == pytest.approx(0.1)
    assert found.nearest == pytest.approx(0.2)  # of the joints that turn
