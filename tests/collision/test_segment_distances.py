"""Exact distances of capsules, against coal."""

from __future__ import annotations

import numpy as np
import pytest

from posture_opt.collision.obstacles import OBSTACLES
from posture_opt.collision.segment_distances import to_segment
from tests.helpers import coal_distance

COUNT = 1500
RADIUS = 1e-3  # of the capsules given to coal: it has no segments
EXACT = 2e-8  # m: what coal leaves at its tolerance; a minimiser over both shares agrees with us to 1e-15


def random_segments(rng, count=COUNT):
    """(count, 3) starts and ends: long and short ones, points, and many along an axis of the world."""
    start = rng.uniform(-1, 1, (count, 3))
    along = rng.normal(size=(count, 3)) * rng.choice([0.0, 0.05, 0.5, 1.5], count)[:, None]
    along[::5] *= np.eye(3)[rng.integers(3, size=len(along[::5]))]
    return start, start + along


def parallel(start, end, rng):
    """Segments along the given ones, or nearly so."""
    other = start + rng.normal(size=start.shape) * 0.4
    along = (end - start) * rng.uniform(-2, 2, (len(start), 1))
    return other, other + along + rng.normal(size=start.shape) * rng.choice([0.0, 1e-9, 1e-4], len(start))[:, None]


def test_capsules_are_as_far_apart_as_coal_says() -> None:
    rng = np.random.default_rng(1)
    start, end = random_segments(rng)
    others = [random_segments(rng), parallel(start, end, rng)]
    for other_start, other_end in others:
        ours = to_segment(start, end, other_start, other_end)
        pairs = zip(start, end, other_start, other_end, strict=True)
        theirs = [coal_distance.distance(coal_distance.capsule(a, b, RADIUS), coal_distance.capsule(c, d, RADIUS))
                  for a, b, c, d in pairs]  # fmt: skip
        np.testing.assert_allclose(ours, np.array(theirs) + 2 * RADIUS, rtol=0, atol=EXACT)


def test_crossing_segments_have_no_distance() -> None:
    start, end = np.array([[-1.0, 0, 0]]), np.array([[1.0, 0, 0]])
    assert to_segment(start, end, np.array([[0.3, -1.0, 0]]), np.array([[0.3, 1.0, 0]]))[0] == pytest.approx(
        0, abs=1e-15
    )
    assert to_segment(start, end, start, end)[0] == 0


OBSTACLE_DATA = {
    "box": [
        {"size": ["0.6 m", "0.4 m", "20 mm"], "xyz": ["0.1 m", "0 m", "0.2 m"], "rpy": ["10 deg", "-20 deg", "70 deg"]},
        {"size": ["0.3 m", "0.3 m", "0.3 m"]},
    ],
    "cylinder": [
        {"radius": "60 mm", "length": "0.8 m", "xyz": ["0.3 m", "0 m", "0 m"], "rpy": ["90 deg", "0 deg", "30 deg"]},
        {"radius": "0.4 m", "length": "30 mm"},
    ],
    "sphere": [{"radius": "80 mm", "xyz": ["0.2 m", "0 m", "1 m"]}],
    "half_space": [{"normal": [0, 1, 2], "offset": "-0.5 m"}],
}


def obstacles():
    for listed in OBSTACLES:
        kind = listed.model_fields["kind"].annotation.__args__[0]
        for k, data in enumerate(OBSTACLE_DATA.get(kind, ())):
            yield pytest.param(listed.model_validate({"name": kind, "kind": kind, **data}), id=f"{kind}{k}")


@pytest.mark.parametrize("obstacle", list(obstacles()))
def test_capsules_are_as_far_from_obstacles_as_coal_says(obstacle) -> None:
    start, end = random_segments(np.random.default_rng(2))
    ours = obstacle.distance(start, end)
    solid = coal_distance.solid(obstacle)
    theirs = np.array([coal_distance.distance(coal_distance.capsule(a, b, RADIUS), solid)
                       for a, b in zip(start, end, strict=True)]) + RADIUS  # fmt: skip
    apart = theirs > 2 * RADIUS
    assert apart.sum() > COUNT / 4
    np.testing.assert_allclose(ours[apart], theirs[apart], rtol=0, atol=EXACT)
    assert np.all(ours[theirs < 0] <= 1e-9)


def test_a_half_space_says_how_deep() -> None:
    (floor,) = (listed for listed in OBSTACLES if listed.__name__ == "HalfSpace")
    ground = floor.model_validate({"name": "ground", "kind": "half_space", "normal": [0, 0, 5]})
    assert ground.distance(np.array([[0, 0, 0.1]]), np.array([[0, 0, -0.3]]))[0] == pytest.approx(-0.3)


@pytest.mark.parametrize("obstacle", list(obstacles()))
class TestObstaclesThatMakeRoom:
    def test_a_smaller_one_is_farther_by_that_at_least_and_above_a_face_by_just_that(self, obstacle) -> None:
        start, end = random_segments(np.random.default_rng(4), 200)
        by = min(0.4 * obstacle.half_thickness, 0.05)
        before, after = obstacle.distance(start, end), obstacle.smaller(by).distance(start, end)
        apart = before > 0
        gained = (after - before)[apart]
        assert np.all(gained >= by - 1e-12)
        assert np.min(gained) == pytest.approx(by, abs=1e-9)
