"""Reports: what they say, that they fit a mail, that figures draw what they claim."""

from __future__ import annotations

import json
import math
import re
from html.parser import HTMLParser
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

import posture_opt as po
from posture_opt.errors import NoSolutionError
from posture_opt.report.figures.cloud import plot_cloud, plot_cross_section
from posture_opt.report.figures.solution import plot_budget, plot_joint_map
from posture_opt.report.page.save import OWN_FILES
from posture_opt.report.page.style import image
from posture_opt.report.scene.arm_figure import plot_solution, plot_spread
from posture_opt.report.scene.arm_geometry import ErrorRegion, enlargement
from posture_opt.report.text.words import roll_pitch_yaw
from posture_opt.statements import Quantity, notation
from posture_opt.uncertainty.simulation.cloud import cloud_of
from posture_opt.uncertainty.sources.sources import source_words
from posture_opt.units import plus_minus
from tests.helpers import factors
from tests.helpers.folders import names as names_in
from tests.helpers.fresh import loaded_by
from tests.helpers.said import said
from tests.helpers.variants import conformance

DOWN = {"kind": "insert", "direction": [0, 0, -1]}
PROBLEMS: dict[str, dict[str, Any]] = {
    "planar": {
        "name": "Planar arm, fixed hole",
        "robot": {"kind": "preset", "name": "planar_2r"},
        "uncertainty": {"sigma": {"joint1.theta": "1 deg", "joint2.theta": "3 deg", "joint1.a": "10 mm"}},
        "task": {"kind": "insert", "direction": [0, -1, 0], "position": ["0.9 m", "0.4 m", "0 m"], "clearance": "5 cm"},
    },
    "ur10": {
        "name": "UR10, vertical hole",
        "robot": {"kind": "preset", "name": "ur10"},
        "uncertainty": {
            "sigma": {f"{j}.theta": "0.02 deg" for j in ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1")}
        },
        "task": {**DOWN, "position": ["0.7 m", "0.2 m", "0.1 m"], "clearance": "0.5 mm"},
        "solver": {"kind": "ipopt", "starts": 8},
    },
    "panda": {
        "name": "Panda, the workpiece may be placed",
        "robot": {"kind": "preset", "name": "panda"},
        "uncertainty": {"sigma": {f"panda_joint{k}.theta": "0.02 deg" for k in range(1, 8)}},
        "task": {**DOWN, "region": {"min": ["0.3 m", "-0.3 m", "0.05 m"], "max": ["0.6 m", "0.3 m", "0.4 m"]}},
        "solver": {"kind": "ipopt", "starts": 8},
    },
    "scara": {
        "name": "SCARA",
        "robot": {"kind": "preset", "name": "scara"},
        "uncertainty": {"sigma": {"joint1.theta": "0.01 deg", "joint2.theta": "0.01 deg", "joint3.d": "0.01 mm"}},
        "task": {**DOWN, "position": ["0.2 m", "0.2 m", "-0.1 m"], "clearance": "0.2 mm"},
        "solver": {"kind": "ipopt", "starts": 8},
    },
    "probe": {
        "name": "Touch with a UR10",
        "robot": {"kind": "preset", "name": "ur10"},
        "uncertainty": {"sigma": {"shoulder_pan.theta": "0.02 deg", "elbow.theta": "0.02 deg"}},
        "task": {"kind": "probe", "direction": [1, 0, 0], "position": ["0.7 m", "0.2 m", "0.3 m"], "clearance": "1 mm"},
        "solver": {"kind": "ipopt", "starts": 4},
    },
    "measure": {
        "name": "Measure with a UR10",
        "robot": {"kind": "preset", "name": "ur10"},
        "uncertainty": {"sigma": {"shoulder_pan.theta": "0.02 deg", "elbow.theta": "0.02 deg", "elbow.a": "0.1 mm"}},
        "task": {"kind": "measure", "position": ["0.7 m", "0.2 m", "0.3 m"]},
        "solver": {"kind": "ipopt", "starts": 4},
    },
}


@pytest.fixture(scope="module", params=conformance(PROBLEMS, ["planar", "ur10"]))
def solved(request: pytest.FixtureRequest) -> tuple[Any, Any]:
    problem = po.problem_from_dict(PROBLEMS[request.param])
    return problem, po.select_posture(problem)


@pytest.fixture(scope="module")
def planar() -> tuple[Any, Any]:
    problem = po.problem_from_dict(PROBLEMS["planar"])
    return problem, po.select_posture(problem)


def contents(result: Any, figures: bool = True) -> dict[str, bytes]:
    """File name -> content of what a result saves."""
    with TemporaryDirectory() as folder:
        return {path.name: path.read_bytes() for path in result.save(folder, figures=figures)}


def check_text(report: str) -> None:
    assert max(map(len, report.splitlines())) <= 100
    assert not re.search(r"\bnan\b|\binf\b|array\(|<.*object", report, re.IGNORECASE)
    assert not re.search(r"\bNone\b", report)  # cell: mounting: none is a word of problem files
    assert not re.search(r"\d[eE][-+]\d", report), "people do not read exponents"
    assert "-0.00 " not in report
    assert report.endswith("\n")


class TestText:
    def test_blocks_stand_in_order(self, solved: tuple[Any, Any]) -> None:
        report = solved[1].report()
        check_text(report)
        blocks = ["Problem", "Posture", "Spread of the tool point", "Error budget", "Alternatives", "Checks"]
        places = [report.index(f"\n{block}\n---") for block in blocks]
        assert places == sorted(places)

    def test_every_joint_is_shown_in_its_unit_with_digits_to_be_used(self, solved: tuple[Any, Any]) -> None:
        problem, solution = solved
        report, shown = solution.report(), []
        for joint, value in zip(problem.robot.joints, solution.q, strict=True):
            unit, factor = ("deg", 180 / math.pi) if joint.type == "revolute" else ("mm", 1e3)
            found = re.search(rf"^{joint.name} +(-?[0-9.]+) {unit} ", report, re.MULTILINE)
            assert found is not None
            assert float(found[1]) == pytest.approx(factor * value, abs=0.06)  # a decimal at least
            shown.append(float(found[1]) / factor)
        moved = np.linalg.norm(solution.spread.position - np.asarray(problem.arm.position(np.array(shown))))
        assert moved < solution.critical.sigma_max  # what people read; programs have two digits more

    def test_the_answer_the_probability_and_the_floor_are_those_of_the_solution(self, planar: tuple[Any, Any]) -> None:
        _, solution = planar
        report, told = " ".join(solution.report().split()), said(solution)
        best = told["selection.best-posture"].values
        assert (best["sigma"], best["part"]) == (Quantity(solution.sigma_max), "across the insertion direction")
        assert told["uncertainty.success"].values["probability"].value == solution.success_probability
        assert "(2.448 σ)" in report  # a plane ellipse, chi-square of two degrees of freedom
        assert "(1.960 σ)" in report  # the one direction across, of one degree
        least = f"{1e3 * solution.lower_bound.sigma:.2f}"
        assert re.search(rf"lower bound \(joint1.theta [0-9.]+ %, lever 984.9 mm\) +{least}", report)
        # |(900, 400)| mm from the base: the lever of the first joint
        assert math.hypot(900, 400) == pytest.approx(984.9, abs=0.05)

    def test_a_small_gain_at_a_fixed_hole_offers_placement(self, solved: tuple[Any, Any]) -> None:
        _, solution = solved
        typical, told = solution.statistics.typical, said(solution)
        small = solution.target.kind == "point" and math.isfinite(typical) and solution.gain_over(typical) < 0.05
        assert ("selection.state-region" in told) == small
        assert ("selection.place-target" in told) == (solution.target.kind != "point")

    def test_budget_sums_to_all_of_it(self, solved: tuple[Any, Any]) -> None:
        report = solved[1].report()
        block = report.split("\nError budget\n")[1].split("\n\n")[1]
        assert re.findall(r"(\d+) %\s*$", block, re.MULTILINE)[-1] == "100"

    def test_explain_shows_every_variable_and_row(self, solved: tuple[Any, Any]) -> None:
        _, solution = solved
        report = solution.explain()
        assert max(map(len, report.splitlines())) <= 100
        assert not re.search(r"\bnan\b|\binf\b", report)
        nlp = solution.optimisation_problem.nlp
        for name in [v.name for v in nlp.variables] + [row.name for row in nlp.rows]:
            assert re.search(rf"^{re.escape(name)} ", report, re.MULTILINE)
        assert "violated" not in report

    def test_infeasible_says_why_and_what_comes_nearest(self) -> None:
        data = {**PROBLEMS["planar"], "task": {**PROBLEMS["planar"]["task"], "position": ["2.5 m", "0 m", "0 m"]}}
        problem = po.problem_from_dict(data)
        with pytest.raises(NoSolutionError) as caught:
            po.select_posture(problem)
        report = caught.value.solution.report()
        check_text(report)
        assert said(caught.value.solution)["selection.no-posture"].about == "target"
        assert report.count("500 mm") == 1  # both links stretched reach 2 m
        assert "Nearest posture" in report
        files = contents(caught.value.solution)
        assert set(files) >= {"solution.json", "report.txt", "arm.png"}
        assert files["report.html"].count(b"data:image/png;base64,") == 1, "the arm beside its target"
        assert "violated" in caught.value.solution.explain()

    def test_bounds_say_of_what_and_in_which_unit(self) -> None:
        bounds = [{"kind": "spread", "at_most": "5 mm"}, {"kind": "spread", "within": "all", "at_most": "1 m"},
                  {"kind": "singularity_margin", "at_least": "10 mm"}]  # fmt: skip
        task = {"kind": "insert", "position": ["0.7 m", "0.2 m", "0.1 m"], "subject_to": bounds}
        problem = po.problem_from_dict({"robot": {"kind": "preset", "name": "ur5e"}, "task": task,
                                        "solver": {"kind": "ipopt", "starts": 2}})  # fmt: skip
        report = " ".join(po.select_posture(problem).report().split())
        assert "Requirements spread along the task direction at most 5 mm, spread in space at most 1000 mm, " in report
        assert "singularity margin at least 10 mm per rad" in report

    def test_another_criterion_than_the_scatter_and_the_lean_are_told(self) -> None:
        task = {"kind": "drill", "direction": [0, 0, -1], "position": ["0.5 m", "0.2 m", "0.2 m"], "tilt": "5 deg",
                "clearance": "0.05 mm", "criterion": "miss"}  # fmt: skip
        problem = po.problem_from_dict({"robot": {"kind": "preset", "name": "ur5e"}, "task": task,
                                        "solver": {"kind": "ipopt", "starts": 2}})  # fmt: skip
        solution = po.select_posture(problem)
        report = " ".join(solution.report().split())
        assert "criterion miss" in said(solution)["selection.ranked-by"].text
        found = re.search(r"tilted ([\d.]+) deg, 5 deg allowed", report)
        assert found
        axis = factors.pose(problem.robot, solution.q)[:3, 2]
        assert float(found[1]) == pytest.approx(math.degrees(math.acos(-axis[2])), abs=0.006)  # two decimals

    def test_one_unit_in_a_block(self) -> None:
        # 7 um in one direction, 30 um in the other: each by itself would have a unit of its own.
        problem = po.problem_from_dict({
            "robot": {"kind": "preset", "name": "planar_2r"},
            "uncertainty": {"sigma": {"joint1.theta": "10 urad", "joint2.theta": "6 urad"}},
            "task": {"kind": "insert", "direction": [0, -1, 0], "position": ["1.4 m", "0.1 m", "0 m"]},
            "solver": {"kind": "ipopt", "starts": 2},
        })  # fmt: skip
        spread = po.propagate(problem, [0.8, -1.5])
        solution = po.select_posture(problem)
        assert solution.critical.sigma_max < 1e-5 < solution.spread.ellipse.semi_axes[-1]
        for report in (solution.report(), spread.report()):
            block = report.split("\nSpread of the tool point\n")[1]
            block = block.split("\nCovariance")[0].split("\nError budget")[0]
            assert " mm" in block
            assert "µm" not in block.replace("within 0.1 µm", "")

    def test_spread_and_cloud(self, solved: tuple[Any, Any]) -> None:
        problem, solution = solved
        spread = po.propagate(problem, solution.q).report()
        cloud = po.simulate(problem, solution.q, n=2000, seed=1).report()
        check_text(spread)
        check_text(cloud)
        assert "Error budget" in spread
        assert "2,000, seed 1" in cloud
        assert "sampling interval" in cloud

    def test_a_free_frame_is_told_to_stand_at_its_start(self) -> None:
        robot = {"kind": "preset", "name": "planar_2r", "base": "free"}
        problem = po.problem_from_dict({**PROBLEMS["planar"], "robot": robot})
        spread = " ".join(po.propagate(problem, [0.5, 0.5]).report().split())
        assert "The base frame is free (to be calibrated); its start value is used here." in spread
        assert "The tool frame is free" not in spread

    def test_many_long_names_still_fit(self) -> None:
        joints = [
            {"name": f"left_arm_of_the_machine_joint_{k}", "type": "revolute", "a": "0.3 m",
             "alpha": f"{90 * (k % 2)} deg", "d": "0.1 m", "theta": "0 deg", "limits": ["-180 deg", "180 deg"]}
            for k in range(7)
        ]  # fmt: skip
        data = {
            "name": "A name that is by far too long for one line of a mail " * 3,
            "robot": {"kind": "dh", "joints": joints},
            "uncertainty": {"sigma": {f"{j['name']}.{p}": "1 mrad" for j in joints for p in ("theta", "alpha")}},
            "task": {"kind": "insert", "direction": [0, 0, -1]},
            "solver": {"kind": "ipopt", "starts": 4},
        }
        problem = po.problem_from_dict(data)
        check_text(po.select_posture(problem).report())


class TestUnits:
    @pytest.mark.parametrize(
        ("metres", "shown"),
        [(0.0123, "12.3 mm"), (1.0, "1000 mm"), (9.996e-3, "10.0 mm"), (5.32e-6, "5.32 µm"), (4e-8, "0.0400 µm"),
         (0, "0 mm")],
    )  # fmt: skip
    def test_lengths(self, metres: float, shown: str) -> None:
        assert notation.length(metres) == shown

    @pytest.mark.parametrize(
        ("p", "shown"),
        [(0.5, "50 %"), (0.9932, "99.3 %"), (1 - 1e-11, "> 99.9 %"), (0.0, "0 %"), (1e-9, "< 0.1 %")],
    )
    def test_probability_ends_where_the_model_does(self, p: float, shown: str) -> None:
        assert notation.probability(p) == shown

    @pytest.mark.parametrize(("share", "shown"), [(0.974, "97 %"), (0.056, "5.6 %"), (0.002, "0.20 %"), (0, "0 %")])
    def test_shares(self, share: float, shown: str) -> None:
        assert notation.percent(share) == shown

    def test_what_is_stated_comes_back_as_stated(self) -> None:
        assert notation.stated_length(0.05e-3) == "0.05 mm"
        assert notation.stated_length(123.45e-3) == "123.45 mm"
        assert notation.stated_length(2.20863e-6) == "2.21 µm"
        assert notation.stated(0.05, "m/rad") == "50 mm per rad"
        assert notation.stated_angle(math.radians(0.02)) == "0.02 deg"
        assert notation.stated_angle(0.3e-3) == "0.0172 deg"
        assert notation.stated_sigma(math.radians(1.0), "rad") == "1 deg"
        assert notation.stated_sigma(math.radians(0.02), "rad") == "0.349 mrad"

    @pytest.mark.parametrize(
        ("value", "std", "shown"),
        [(-0.99402982901305, 1.1e-13, "-994.029829 ± 0.000001 mm"), (1.28e-16, math.nan, "0 mm"), (5e-84, 0.0, "0 mm"),
         (2.61e-4, 1.2e-5, "0.261 ± 0.012 mm"), (-3e-12, 4e-12, "0.000000 ± 0.000001 mm"), (2.5e-7, 0, "0.000250 mm")],
    )  # fmt: skip
    def test_rounding_has_no_digits(self, value: float, std: float, shown: str) -> None:
        assert plus_minus(value, std, 1e3, "mm") == shown

    @pytest.mark.parametrize("rpy", [(0.1, -0.4, 2.0), (-3.0, 1.2, -0.5), (math.pi, 0, 0.3), (0, math.pi / 2, 0.4)])
    def test_roll_pitch_yaw_is_that_of_the_problem_file(self, rpy: tuple[float, float, float]) -> None:
        robot = {"kind": "preset", "name": "planar_2r", "base": {"rpy": [f"{a} rad" for a in rpy]}}
        problem = po.problem_from_dict({"robot": robot, "uncertainty": {"sigma": {"joint1.theta": "1 deg"}}})
        found = roll_pitch_yaw(po.propagate(problem, [0, 0]).quaternion_wxyz)
        # At the gimbal lock only the matrix is determined; roll is zero in the case above, so that the angles agree.
        assert found == pytest.approx(rpy, abs=1e-7)

    def test_sources_in_words(self) -> None:
        arm = po.problem_from_dict(PROBLEMS["scara"]).arm
        words_of = {"joint1.theta": "joint1 angle", "joint3.d": "joint3 travel", "base.x": "base x"}
        assert {name: source_words(name, arm) for name in words_of} == words_of


def drawn_of(solution: Any, cloud: Any) -> dict[str, Any]:
    made = {
        "arm": plot_solution(solution),
        "spread": plot_spread(solution.spread),
        "section": plot_cross_section(solution.spread, solution.task_spread, n=300),
        "budget": plot_budget(solution.spread, solution.task_spread.budget_groups, solution.critical.worst_axis),
        "cloud": plot_cloud(cloud),
    }
    if solution.optimisation_problem.robot.n == 2:
        made["joint_map"] = plot_joint_map(solution)
    return made


def words(figure: Any) -> str:
    from matplotlib.text import Text

    return " | ".join(item.get_text() for item in figure.findobj(Text) if item.get_text())


class TestFigures:
    @pytest.mark.usefixtures("coarse")
    def test_each_is_drawn_labelled_and_valid(self, solved: tuple[Any, Any]) -> None:
        _, solution = solved
        for name, figure in drawn_of(solution, cloud_of(solution.spread, 300, 0)).items():
            svg = image(figure, "svg")
            assert ElementTree.fromstring(svg).tag.endswith("svg")
            for axes in figure.axes:
                labels = [axes.get_xlabel(), axes.get_ylabel()]
                unit = any(re.search(r"\[(mm|µm|deg|%)\]", label) for label in labels)
                assert unit or re.search(r"\d mm", words(figure)), f"{name}: no unit in {labels}, and no scale"
            if name in ("arm", "spread"):
                assert re.search(r"95 %\s(ellipse|ellipsoid|interval),\s(enlarged \d+×|true\sto\sscale)", words(figure))

    def test_png_at_150_dpi_and_the_same_every_time(self, planar: tuple[Any, Any]) -> None:
        _, solution = planar
        first, second = (image(plot_solution(solution), kind) for kind in ("png", "png"))
        assert first[:8] == b"\x89PNG\r\n\x1a\n"
        assert first == second
        assert image(plot_budget(solution.spread, solution.task_spread.budget_groups, "along x"), "svg") == image(
            plot_budget(solution.spread, solution.task_spread.budget_groups, "along x"), "svg"
        )
        assert b"pHYs" in first
        at = first.index(b"pHYs") + 4
        assert int.from_bytes(first[at : at + 4], "big") == pytest.approx(150 / 0.0254, rel=1e-3)

    @pytest.mark.parametrize("sigma", ["0.1 deg", "2 deg"])
    def test_drawn_ellipse_of_a_planar_arm_holds_95_percent(self, sigma: str) -> None:
        from matplotlib.path import Path as Curve

        data = {**PROBLEMS["planar"], "uncertainty": {"sigma": {"joint1.theta": sigma, "joint2.theta": sigma}}}
        problem = po.problem_from_dict(data)
        spread = po.propagate(problem, [math.pi / 2, -math.pi / 2])
        factor = 7.0
        polygon = 1e3 * ErrorRegion.of(spread, factor).surface(60)[-1] @ spread.basis.T
        n = 20_000
        points = 1e3 * cloud_of(spread, n, 3).points @ spread.basis.T
        centre = 1e3 * spread.ellipse.center
        inside = Curve(polygon).contains_points(centre + factor * (points - centre))
        # Binomial: 4 sqrt(p q / n) = 0.6 %; the 120-cornered polygon loses 5e-5; the bend of 2 deg less than 0.3 %.
        assert inside.mean() == pytest.approx(0.95, abs=4 * math.sqrt(0.95 * 0.05 / n) + 0.003)

    def test_drawn_ellipsoid_in_space_holds_95_percent(self) -> None:
        problem = po.problem_from_dict(PROBLEMS["ur10"])
        spread = po.propagate(problem, [0.3, -1.0, 1.2, 0.4, 0.7, 0.0])
        surface = 1e3 * ErrorRegion.of(spread, 1.0).surface(60).reshape(-1, 3).T
        n = 20_000
        points = 1e3 * (cloud_of(spread, n, 5).points - spread.position - spread.bias)
        # Without the drawing's own factor: the directions in which a point lies farther out than the surface does.
        whitening = np.linalg.inv(np.linalg.cholesky(1e6 * spread.covariance))
        reach = np.linalg.norm(whitening @ (surface - 1e3 * (spread.position + spread.bias)[:, None]), axis=0)
        assert np.ptp(reach) < 1e-6
        inside = np.linalg.norm(points @ whitening.T, axis=1) <= reach.mean()
        assert inside.mean() == pytest.approx(0.95, abs=4 * math.sqrt(0.95 * 0.05 / n))

    def test_cross_section_ellipse_is_that_of_the_projection(self) -> None:
        from matplotlib.path import Path as Curve

        problem = po.problem_from_dict(PROBLEMS["ur10"])
        solution = po.select_posture(problem)
        n = 5000
        axes = plot_cross_section(solution.spread, solution.task_spread, n=n).axes[0]
        curves = {line.get_label(): np.asarray(line.get_xydata()) for line in axes.lines}
        points = curves[f"{n} simulated tool points"]
        ellipse = curves["95 % ellipse (2.448 std. dev.)"]
        inside = Curve(ellipse).contains_points(points)
        assert inside.mean() == pytest.approx(0.95, abs=4 * math.sqrt(0.95 * 0.05 / n))
        circle = curves["clearance 0.5 mm"]
        assert np.linalg.norm(circle, axis=1) == pytest.approx(0.5)
        hit = (np.linalg.norm(points, axis=1) <= 0.5).mean()
        p = solution.success_probability
        assert hit == pytest.approx(p, abs=4 * math.sqrt(p * (1 - p) / n))

    @pytest.mark.parametrize("size", [0.013, 0.4, 3.0, 77.0, 500.0])
    def test_enlargement_is_round_and_shows_the_region(self, size: float) -> None:
        factor = enlargement(size, 1000.0)
        assert f"{factor:g}".strip("0") in {"1", "2", "5"}
        assert 60 <= factor * size <= 161 or factor == 1  # between a sixteenth and a sixth of the arm

    def test_stated_factor_is_the_drawn_one(self, planar: tuple[Any, Any]) -> None:
        _, solution = planar
        one, ten = (ErrorRegion.of(solution.spread, factor) for factor in (1, 10))
        sizes = [np.ptp(region.surface()[-1], axis=0) for region in (one, ten)]
        assert sizes[1] == pytest.approx(10 * sizes[0])
        assert ten.label == "95 % ellipse, enlarged 10×"

    def test_joint_map_marks_the_answer_where_the_map_says_so(self, planar: tuple[Any, Any]) -> None:
        _, solution = planar
        axes = plot_joint_map(solution).axes[0]
        marks = {line.get_label(): np.asarray(line.get_xydata()) for line in axes.lines}
        assert marks["answer"][0] == pytest.approx(np.degrees(solution.q))

    def test_joint_map_of_a_joint_with_more_than_a_turn_shows_one(self, planar: tuple[Any, Any]) -> None:
        robot = {"kind": "dh", "joints": [{"name": f"joint{k}", "a": "1 m"} for k in (1, 2)]}  # limits: ±360 deg
        problem = planar[0].with_robot(robot)
        axes = plot_joint_map(po.select_posture(problem)).axes[0]
        assert (*axes.get_xlim(), *axes.get_ylim()) == pytest.approx((-180, 180, -180, 180))


class Page(HTMLParser):
    """Open tags, links and text of a page."""

    VOID = frozenset({"meta", "img", "br", "link", "hr", "input"})

    def __init__(self) -> None:
        super().__init__()
        self.stack: list[str] = []
        self.links: list[str] = []
        self.text = ""

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.links += [value or "" for name, value in attrs if name in ("src", "href")]
        if tag not in self.VOID:
            self.stack.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.stack.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text += data


class TestFiles:
    def test_a_solution_is_complete_and_needs_no_other_file(self, planar: tuple[Any, Any], tmp_path: Path) -> None:
        paths = planar[1].save(tmp_path)
        assert all(path.is_file() for path in paths)
        drawn = {f"{name}.{kind}" for name in ("arm", "cloud", "budget", "joint_map") for kind in ("png", "svg")}
        assert set(names_in(tmp_path)) == {"solution.json", "report.txt", "report.html", *drawn}
        assert set(names_in(tmp_path)) <= OWN_FILES
        document = json.loads((tmp_path / "solution.json").read_text())
        assert next(iter(document)) == "posture_opt"
        assert document["posture_opt"] == po.__version__
        page = Page()
        page.feed((tmp_path / "report.html").read_text(encoding="utf-8"))
        assert not page.stack
        drawn_inside = [link for link in page.links if link.startswith("data:image/png;base64,")]
        assert len(drawn_inside) == 4
        assert all(link.startswith(("#", "data:,")) for link in page.links if link not in drawn_inside)
        for block in ("Posture", "Error budget", "Checks"):
            assert block in page.text

    def test_names_are_escaped(self) -> None:
        data = {**PROBLEMS["planar"], "name": "<script>alert('&')</script>"}
        problem = po.problem_from_dict(data)
        page = contents(po.propagate(problem, [0.3, 0.5]), figures=False)["report.html"].decode()
        assert "<script>alert" not in page
        assert "&lt;script&gt;alert" in page

    def test_without_plots_no_figure_is_drawn(self, planar: tuple[Any, Any]) -> None:
        assert set(contents(planar[1], figures=False)) == {"solution.json", "report.txt", "report.html"}

    def test_cloud_points_are_those_of_the_cloud(self, planar: tuple[Any, Any]) -> None:
        problem, solution = planar
        cloud = po.simulate(problem, solution.q, n=50)
        files = contents(cloud, figures=False)
        lines = files["cloud.csv"].decode().splitlines()
        assert lines[0] == "x [mm], y [mm], z [mm]"
        assert np.loadtxt(lines[1:], delimiter=",") == pytest.approx(1e3 * cloud.points, abs=1e-6)
        assert json.loads(files["spread.json"])["n"] == 50

    def test_text_path_imports_neither_matplotlib_nor_scipy(self) -> None:
        code = (
            "import posture_opt as po\n"
            "p = po.load_problem('problems/insert_planar_2r.yaml')\n"
            "po.select_posture(p).report()"
        )
        assert loaded_by(code, "matplotlib", "scipy", "jinja2") == []
