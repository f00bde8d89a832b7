"""The narrowest gap as a segment, beside the exact distances and the distances of its two ends."""

from __future__ import annotations

import numpy as np
import pytest

import posture_opt as po
from posture_opt.collision.scene import narrowest

START = np.radians([37.0, -112.0, 128.0, -29.0, 90.0, -26.0])
OBSTACLES = {
    "box": {"kind": "box", "size": ["0.2 m", "0.3 m", "0.1 m"], "rpy": ["20 deg", "40 deg", "10 deg"]},
    "cylinder": {"kind": "cylinder", "radius": "60 mm", "length": "0.5 m", "rpy": ["70 deg", "0 deg", "0 deg"]},
    "sphere": {"kind": "sphere", "radius": "0.1 m"},
}


@pytest.mark.parametrize("kind", OBSTACLES)
def test_the_gap_joins_the_two_surfaces_at_the_least_distance(kind: str) -> None:
    """Its ends are as far apart as the exact distance says; one is on the obstacle, the other so far from it."""
    obstacle = {"name": "thing", "xyz": ["0.55 m", "0.1 m", "0.5 m"], **OBSTACLES[kind]}
    problem = po.load_problem("insert_ur10").replace(cell={"obstacles": [obstacle], "clearance": "20 mm"})
    scene, rng, met = problem.scene, np.random.default_rng(2), 0
    (solid,) = scene.stated_obstacles
    for q in START + rng.uniform(-0.5, 0.5, (12, 6)):
        gap = narrowest(scene, q)
        assert gap is not None
        away = zip(scene.pairs, scene.distances(q)[0], scene.required, strict=True)
        assert gap.distance == min(d for pair, d, least in away if pair[1] == "thing" and least >= scene.margin)
        if gap.distance > 1e-3:
            assert np.linalg.norm(gap.end - gap.start) == pytest.approx(gap.distance, abs=1e-7)
            assert float(solid.distance(gap.end, gap.end)) == pytest.approx(0.0, abs=1e-7)
            assert float(solid.distance(gap.start, gap.start)) == pytest.approx(gap.distance, abs=1e-6)
            met += 1
    assert met >= 6


def test_nothing_is_narrow_where_nothing_is_checked() -> None:
    problem = po.load_problem("insert_ur10").replace(cell="none")
    assert narrowest(problem.scene, np.zeros(6)) is None
