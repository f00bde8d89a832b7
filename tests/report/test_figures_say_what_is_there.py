"""Small truths of figures and tables: counts agree with the report, marks stand whole where they belong."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from matplotlib.text import Text

import posture_opt as po
from posture_opt.diagnosis.scores.unnamed_components import UnnamedComponent
from posture_opt.files import problems_folder
from posture_opt.problem.load import load_builtin
from posture_opt.report.figures.bench import _name
from posture_opt.report.figures.diagnosis_curves import _left_by_side
from posture_opt.report.figures.spread_check import plot_reliability
from posture_opt.report.figures.target_map import plot_spread_map
from posture_opt.report.page.style import image
from posture_opt.report.parts.task_parts import budget_block
from posture_opt.report.scene.arm_figure import shortened
from posture_opt.report.text.blocks import Table
from posture_opt.uncertainty.spread.budget import ShareGroup


@pytest.fixture(scope="module")
def calibration() -> po.Calibration:
    problem = load_builtin("insert_ur10_measured")
    return po.calibrate(problem, po.read_measurements(problems_folder() / "ur10_measured.csv", problem), plan=False)


@pytest.mark.long
def test_the_figure_over_joints_counts_the_poses_of_the_report(calibration: po.Calibration) -> None:
    # One of the 110 stands so near to the first axis that this joint hardly moves the tool there.
    figure = calibration.figures()["residual_joints"]
    labels = {text.get_text() for axes in figure.axes for text in (axes.get_legend() or figure.legends[0]).get_texts()}
    assert "110 poses" in labels


def test_the_shares_of_the_95_percent_regions_stand_at_95(calibration: po.Calibration) -> None:
    problem: Any = calibration.request.problem
    found = po.check_spread(problem, calibration.request.data, calibration)
    (axes,) = plot_reliability(found).axes
    dots = [line for line in axes.lines if line.get_marker() == "o"]
    assert [line.get_xdata()[0] for line in dots] == [95, 95]  # type: ignore[index]
    shares = [100 * c.share for c in found.coverage.values()]
    np.testing.assert_allclose([line.get_ydata()[0] for line in dots], shares)  # type: ignore[index]


def test_a_base_on_the_edge_of_a_map_is_drawn_whole() -> None:
    problem = load_builtin("insert_planar_2r_calibrated")
    found = po.map_accuracy(problem, counts=(4, 4), low=(0.15, 0.15, 0.0), high=(1.05, 1.05, 0.0))
    figure = plot_spread_map(found)
    base = [line for axes in figure.axes for line in axes.lines if line.get_label() == "base of the arm"]
    assert len(base) == 1  # the cells are 0.3 m wide: their edge lies at the base
    assert not base[0].get_clip_on()


def test_sources_that_cancel_are_one_line_and_rounding_is_no_share() -> None:
    problem = load_builtin("insert_planar_2r_measured")
    groups = [ShareGroup(("joint1.theta", "joint2.theta"), 1.0002), ShareGroup(("joint1.a",), -2e-4)]
    block = budget_block(problem, groups, "Shares:")
    _, table, note = block.items
    assert isinstance(table, Table)
    assert [row[3] for row in table.rows] == ["100 %", "0 %"]
    assert table.rows[0][:3] == ("joint1 angle, joint2 angle (correlated)", "joint1.theta, joint2.theta", "")
    assert isinstance(note, str)
    assert "only their combined share is meaningful" in note
    assert len(budget_block(problem, [ShareGroup(("joint1.a",), 1.0)], "Shares:").items) == 2


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


def test_names_of_features_lie_apart_and_within_the_map() -> None:
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(4, 6))
    axes.set(xlim=(0, 100), ylim=(0, 200))
    points = np.array([[30.0, 95.0], [52.0, 100.0], [12.0, 84.0], [14.0, 70.0]])
    for k, point in enumerate(points):
        _name(axes, f"hole {k}", point, point - points.mean(axis=0))
    figure.canvas.draw()
    boxes = [text.get_window_extent() for text in axes.texts]
    assert not any(a.overlaps(b) for i, a in enumerate(boxes) for b in boxes[:i])
    pyplot.close(figure)


@pytest.mark.parametrize(("kind", "place", "sided"), [
    ("curve", "joint1", False), ("curve", "side of joint2", True), ("side and posture", "joint1", True)
])  # fmt: skip
def test_what_is_left_by_side_of_approach_is_drawn_so(kind: str, place: str, sided: bool) -> None:
    data = SimpleNamespace(joint_names=("joint1", "joint2"))
    found: Any = SimpleNamespace(
        unexplained=(UnnamedComponent(kind, "joint1"),),
        adequacy=SimpleNamespace(place=place),
        model=SimpleNamespace(residuals=SimpleNamespace(data=data)),
    )
    assert _left_by_side(found) is sided


def test_a_long_name_in_the_column_of_joint_values_is_shortened_in_its_middle() -> None:
    names = [f"left_arm_manipulator_joint_number_{k}" for k in (1, 2)]
    assert shortened("elbow", 25) == "elbow"
    assert len({shortened(name, 25) for name in names}) == 2
    assert all(len(shortened(name, 25)) == 25 for name in names)


def test_a_map_colours_a_target_inside_an_obstacle_by_the_name_of_it() -> None:
    problem = load_builtin("insert_panda_cell")
    post = next(obstacle for obstacle in problem.scene.stated_obstacles if obstacle.name == "post")
    x, y, _ = np.mean(post.facets(np.full(3, -2.0), np.full(3, 2.0)), axis=(0, 1))
    found = po.map_targets(problem, counts=(3, 2), low=(x, y - 0.3, 0.2), high=(x + 0.4, y, 0.2))
    blocked = {tuple(np.round(p["position"], 6)[:2]): p["blocked_by"] for p in found.to_json()["targets"]}  # type: ignore[index]
    assert blocked[tuple(np.round([x, y], 6))] == "post"
    assert all(not by for p, by in zip(found.map_points, blocked.values(), strict=True) if p.feasible)
    (legend,) = found.plot().legends
    assert {"post in the way", "best place", "base of the arm"} <= {text.get_text() for text in legend.get_texts()}
