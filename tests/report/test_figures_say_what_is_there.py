"""Small truths of figures and tables: counts agree with the report, marks stand whole where they belong."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from matplotlib.text import Text

import posture_opt as po
from posture_opt.report.figures.spread_check import plot_reliability
from posture_opt.report.page.style import image
from tests.helpers.shipped import PROBLEMS


@pytest.fixture(scope="module")
def calibration() -> po.Calibration:
    problem = po.load_problem("insert_planar_2r_measured")
    return po.calibrate(problem, po.read_measurements(PROBLEMS / "planar_2r_measured.csv", problem), plan=False)


def test_the_shares_of_the_95_percent_regions_stand_at_95(calibration: po.Calibration) -> None:
    problem: Any = calibration.request.problem
    found = po.check_spread(problem, calibration.request.data, calibration)
    (axes,) = plot_reliability(found).axes
    dots = [line for line in axes.lines if line.get_marker() == "o"]
    assert [line.get_xdata()[0] for line in dots] == [95, 95]  # type: ignore[index]
    shares = [100 * c.share for c in found.coverage.values()]
    np.testing.assert_allclose([line.get_ydata()[0] for line in dots], shares)  # type: ignore[index]


NAMES = ("$a_$", "_b", "c^{", "<d> & e", "関節")


@pytest.mark.long
def test_names_are_drawn_as_they_are_written() -> None:
    """No formula, no label that matplotlib hides, no warning of a letter that the font lacks."""
    path = [[f"{x} m", "0.5 m", "0 m"] for x in (1.5, 1.8, 2.1)]
    problem = po.problem_from_dict({
        "name": "at $\\frac$",
        "robot": {"kind": "dh", "joints": [{"name": name, "type": "revolute", "a": "1 m"} for name in NAMES]},
        "uncertainty": {"sigma": {f"{name}.theta": "1 deg" for name in NAMES}},
        "task": {"kind": "trace", "points": path},
        "solver": {"kind": "ipopt", "starts": 2},
    })  # fmt: skip
    figures = po.select_posture(problem).figures()
    told = {
        name: " | ".join(text.get_text() for text in figure.findobj(Text) if text.get_visible())
        for name, figure in figures.items()
    }
    for name in NAMES:
        assert f"{name} [deg]" in told["path"]
    assert "$a_$.theta | _b.theta" in told["budget"]
    for figure in figures.values():
        assert image(figure, "svg")


@pytest.mark.long
def test_a_map_colours_a_target_inside_an_obstacle_by_the_name_of_it() -> None:
    problem = po.load_problem("insert_panda_cell")
    post = next(obstacle for obstacle in problem.scene.stated_obstacles if obstacle.name == "post")
    x, y, _ = np.mean(post.facets(np.full(3, -2.0), np.full(3, 2.0)), axis=(0, 1))
    found = po.map_targets(problem, counts=(3, 2), low=(x, y - 0.3, 0.2), high=(x + 0.4, y, 0.2))
    blocked = {tuple(np.round(p["position"], 6)[:2]): p["blocked_by"] for p in found.to_json()["targets"]}  # type: ignore[index]
    assert blocked[tuple(np.round([x, y], 6))] == "post"
    assert all(not by for p, by in zip(found.map_points, blocked.values(), strict=True) if p.feasible)
    (legend,) = found.plot().legends
    assert {"post in the way", "best place", "base of the arm"} <= {text.get_text() for text in legend.get_texts()}
