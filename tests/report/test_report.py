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
from posture_opt.report.figures.cloud import plot_cross_section
from posture_opt.report.page.save import OWN_FILES
from posture_opt.report.page.style import image
from posture_opt.report.scene.arm_geometry import ErrorRegion
from posture_opt.report.text.words import roll_pitch_yaw
from posture_opt.statements import Quantity
from posture_opt.uncertainty.cloud import cloud_of
from posture_opt.units import plus_minus
from tests.helpers.folders import names as names_in
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
    "scara": {
        "name": "SCARA",
        "robot": {"kind": "preset", "name": "scara"},
        "uncertainty": {"sigma": {"joint1.theta": "0.01 deg", "joint2.theta": "0.01 deg", "joint3.d": "0.01 mm"}},
        "task": {**DOWN, "position": ["0.2 m", "0.2 m", "-0.1 m"], "clearance": "0.2 mm"},
        "solver": {"kind": "ipopt", "starts": 8},
    },
    "measure": {
        "name": "Measure with a UR10",
        "robot": {"kind": "preset", "name": "ur10"},
        "uncertainty": {"sigma": {"shoulder_pan.theta": "0.02 deg", "elbow.theta": "0.02 deg", "elbow.a": "0.1 mm"}},
        "task": {"kind": "measure", "position": ["0.7 m", "0.2 m", "0.3 m"]},
        "solver": {"kind": "ipopt", "starts": 4},
    },
}


@pytest.fixture(scope="module", params=conformance(PROBLEMS, ["planar"]))
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
        with pytest.raises(po.errors.NoSolutionError) as caught:
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

    def test_many_long_names_still_fit(self) -> None:
        joints = [
            {"name": f"left_arm_of_the_machine_joint_{k}", "type": "revolute", "a": "0.3 m",
             "alpha": f"{90 * (k % 2)} deg", "d": "0.1 m", "theta": "0 deg", "limits": ["-180 deg", "180 deg"]}
            for k in range(3)
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


def words(figure: Any) -> str:
    from matplotlib.text import Text

    return " | ".join(item.get_text() for item in figure.findobj(Text) if item.get_text())


class TestFigures:
    @pytest.mark.usefixtures("coarse")
    def test_each_is_drawn_labelled_and_valid(self, solved: tuple[Any, Any]) -> None:
        _, solution = solved
        for name, figure in solution.figures().items():
            svg = image(figure, "svg")
            assert ElementTree.fromstring(svg).tag.endswith("svg")
            for axes in figure.axes:
                labels = [axes.get_xlabel(), axes.get_ylabel()]
                unit = any(re.search(r"\[(mm|µm|deg|%)\]", label) for label in labels)
                assert unit or re.search(r"\d mm", words(figure)), f"{name}: no unit in {labels}, and no scale"
            if name == "arm":
                assert re.search(r"95 %\s(ellipse|ellipsoid|interval),\s(enlarged \d+×|true\sto\sscale)", words(figure))

    def test_drawn_ellipse_of_a_planar_arm_holds_95_percent(self) -> None:
        from matplotlib.path import Path as Curve

        data = {**PROBLEMS["planar"], "uncertainty": {"sigma": {"joint1.theta": "2 deg", "joint2.theta": "2 deg"}}}
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
    @pytest.mark.usefixtures("coarse")
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

    def test_cloud_points_are_those_of_the_cloud(self, planar: tuple[Any, Any]) -> None:
        problem, solution = planar
        cloud = po.simulate(problem, solution.q, n=50)
        files = contents(cloud, figures=False)
        lines = files["cloud.csv"].decode().splitlines()
        assert lines[0] == "x [mm], y [mm], z [mm]"
        assert np.loadtxt(lines[1:], delimiter=",") == pytest.approx(1e3 * cloud.points, abs=1e-6)
        assert json.loads(files["spread.json"])["n"] == 50
