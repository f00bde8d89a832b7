"""Planning with the calibrated arm: what a simulator of its own hides, the calibrated plan hits."""

from __future__ import annotations

import json
import math
import re
import shutil
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import Result

import posture_opt as po
from posture_opt.calibration.calibration import Calibration
from posture_opt.problem.fitting import quantity
from posture_opt.problem.problem import Problem
from posture_opt.report.figures.comparison import plot_comparison
from posture_opt.robot.robot import Factor
from posture_opt.selection.answer.selector import PostureSelector
from posture_opt.selection.comparison.comparison import Comparison
from posture_opt.validation.calibrated_arm import calibrated_models, compare_models, nominal_arm
from posture_opt.validation.prediction import stated_scatter
from posture_opt.validation.residual_scatter import residual_scatter
from tests.helpers.command_line import invoke
from tests.helpers.pin import PinArm
from tests.helpers.same_problem import assert_same_numbers, written
from tests.helpers.simulated_arm import SimulatedArm, shift, turn

HALF = math.pi / 2
SIZE = 5e-4  # rad and m: of every hidden error
SCATTER = 1e-4  # rad: of each turning joint from repeat to repeat, 0.0057 deg
SLIDE = 2e-5  # m: of a slide
NOISE = 2e-5  # m: of a measured coordinate
TURNING = "revolute"


@dataclass(frozen=True)
class Case:
    """An arm that is not as drawn, and what it has to do."""

    table: tuple[tuple[Any, ...], ...]
    target: tuple[float, float, float]
    direction: tuple[int, int, int] = (0, 0, -1)
    kind: str = "dh"
    beta: tuple[str, ...] = ()
    tool: tuple[float, float, float] = (0.0, 0.0, 0.0)
    axes: str = "xyz"
    more: dict[str, Any] = field(default_factory=dict)

    def true_arm(self, rng: np.random.Generator) -> SimulatedArm:
        errors = {f"{n}.{k}": rng.normal(0, SIZE) for n, *_ in self.table for k in ("theta", "d", "a", "alpha")}
        errors |= {f"{n}.beta": rng.normal(0, SIZE) for n in self.beta}
        return SimulatedArm(self.table, errors, self.kind, tool=shift(*self.tool))

    @property
    def scatter(self) -> np.ndarray:
        return np.array([SCATTER if row[1] == TURNING else SLIDE for row in self.table])

    def problem(self, arm: SimulatedArm, **keys: Any) -> Problem:
        """The problem of the drawing."""
        robot = arm.section(tool={"xyz": [f"{v} m" for v in self.tool]}, **keys.pop("robot", {}))
        task = {"kind": "insert", "direction": list(self.direction), "position": [f"{v} m" for v in self.target]}
        uncertainty = {"measurement": {"position": f"{NOISE} m"}, "repeatability": "0.05 mm"}
        return po.problem_from_dict({"robot": robot, "uncertainty": uncertainty, "task": task | self.more, **keys})

    def columns(self, arm: SimulatedArm, rng: np.random.Generator, n: int, times: int = 1) -> dict[str, np.ndarray]:
        """Of n postures, each measured so many times."""
        q = arm.drawn(n, rng)
        q = rng.permutation(np.tile(q, (times, 1))) if times > 1 else q
        points = arm.points(q + rng.normal(0, 1, q.shape) * self.scatter) + rng.normal(0, NOISE, (len(q), 3))
        heads = [f"{row[0]} [{'rad' if row[1] == TURNING else 'm'}]" for row in self.table]
        measured = {f"{axis} [m]": points[:, "xyz".index(axis)] for axis in self.axes}
        return {**dict(zip(heads, q.T, strict=True)), **measured}


TWO = (("j1", TURNING, 0.0, 0.0, 1.0, 0.0), ("j2", TURNING, 0.0, 0.0, 0.8, 0.0))
CASES = {
    "planar 2R": Case(TWO, (0.9, 0.4, 0.0), (0, -1, 0), axes="xy", more={"clearance": "0.3 mm"}),
    "SCARA": Case(
        (
            ("j1", TURNING, 0.0, 0.4, 0.35, 0.0),
            ("j2", TURNING, 0.0, 0.0, 0.3, math.pi),
            ("j3", "prismatic", 0.0, 0.0, 0.0, 0.0),
            ("j4", TURNING, 0.0, 0.0, 0.0, 0.0),
        ),
        (0.4, 0.2, 0.25),
        beta=("j1", "j2"),
    ),
    "6R": Case(
        (
            ("j1", TURNING, 0.0, 0.40, 0.10, HALF),
            ("j2", TURNING, 0.0, 0.0, 0.50, 0.0),
            ("j3", TURNING, 0.0, 0.0, 0.05, HALF),
            ("j4", TURNING, 0.0, 0.45, 0.0, -HALF),
            ("j5", TURNING, 0.0, 0.0, 0.0, HALF),
            ("j6", TURNING, 0.0, 0.10, 0.0, 0.0),
        ),
        (0.5, 0.2, 0.3),
        beta=("j2",),
        tool=(0.03, -0.02, 0.12),
    ),
    "7R, MDH": Case(
        (
            ("j1", TURNING, 0.0, 0.36, 0.0, 0.0),
            ("j2", TURNING, 0.0, 0.0, 0.0, -HALF),
            ("j3", TURNING, 0.0, 0.42, 0.0, HALF),
            ("j4", TURNING, 0.0, 0.0, 0.0, HALF),
            ("j5", TURNING, 0.0, 0.4, 0.0, -HALF),
            ("j6", TURNING, 0.0, 0.0, 0.0, -HALF),
            ("j7", TURNING, 0.0, 0.126, 0.0, HALF),
        ),
        (0.5, 0.2, 0.3),
        kind="mdh",
        tool=(0.03, -0.02, 0.12),
    ),
}


@dataclass(frozen=True)
class Known:
    """A case that was measured and calibrated."""

    case: Case
    arm: SimulatedArm
    problem: Problem
    calibration: Calibration
    calibrated: Problem


@pytest.fixture(scope="module", params=CASES)
def known(request: pytest.FixtureRequest) -> Known:
    return learnt(CASES[request.param])


def learnt(case: Case, seed: int = 0, n: int = 80, times: int = 1, **keys: Any) -> Known:
    rng = np.random.default_rng(seed)
    arm = case.true_arm(rng)
    problem = case.problem(arm, **keys)
    found = po.calibrate(problem, po.read_measurements(case.columns(arm, rng, n, times), problem))
    return Known(case, arm, problem, found, po.calibrated_problem(problem, found))


def compared(problem: Problem, calibration: Calibration) -> Comparison | None:
    return compare_models(problem.robot, calibrated_models(problem, calibration))


def quick(problem: Problem) -> Any:
    return PostureSelector(problem, compiled=False).solve(starts=12)


def test_the_true_arm_comes_to_lie_where_the_calibrated_plan_says(known: Known) -> None:
    case, target = known.case, np.array(known.case.target)
    solution = quick(known.calibrated)
    axes = ["xyz".index(axis) for axis in case.axes]
    landed = known.arm.points(solution.q)[0]
    off = (landed - target)[axes]
    C = solution.covariance[np.ix_(axes, axes)]
    # The mean of all visits; the spread holds the visits too. Beyond 3.5 σ: less than one in a hundred for three axes.
    assert off @ np.linalg.solve(C, off) < 3.5**2
    old = quick(known.problem)
    missed = (known.arm.points(old.q)[0] - target)[axes]
    assert np.linalg.norm(missed) > 5 * np.linalg.norm(off)
    assert missed @ np.linalg.solve(C, missed) > 4**2


@pytest.mark.parametrize("name", CASES)
def test_the_scatter_from_repeat_to_repeat_is_found(name: str) -> None:
    found = learnt(CASES[name], n=40, times=3)
    scatter = found.calibrated.to_dict()["uncertainty"]["scatter"]
    assert list(scatter) == [f"{row[0]}.{'theta' if row[1] == TURNING else 'd'}" for row in found.case.table]
    turning = [float(text.split()[0]) for name, text in scatter.items() if name.endswith(".theta")]
    # 80 differences between repeats: 160 to 240 coordinates tell one σ to 6 to 8 %; 3 σ of that.
    assert math.radians(turning[0]) == pytest.approx(SCATTER, rel=0.25)


def test_without_repeats_no_more_is_delivered_as_scatter_than_the_file_states(known: Known) -> None:
    sources = known.calibrated.sources
    found, stated = residual_scatter(known.problem, known.calibration), stated_scatter(known.problem).sigma
    # The residuals of 80 poses hold scatter of so much, which nothing in them tells from errors of the model.
    assert found.sigma["j1.theta"] == pytest.approx(SCATTER, rel=0.25)
    assert stated["j1.theta"] < SCATTER / 2
    at = sources.names.index("j1.theta")
    assert np.sqrt(sources.scatter[at, at]) == pytest.approx(stated["j1.theta"], rel=1e-3)
    assert sources.constant[at, at] > found.sigma["j1.theta"] ** 2 - stated["j1.theta"] ** 2
    assert "the same at every repeat" in " ".join(known.calibrated.header)


def test_the_files_are_the_problem_in_any_folder(known: Known, tmp_path: Path) -> None:
    again = written(known.calibrated, tmp_path, "calibrated")
    assert {path.name for path in tmp_path.iterdir()} == {"calibrated.yaml", "calibrated_covariance.csv"}
    assert_same_numbers(again, known.calibrated)
    assert again.notes == known.calibrated.notes


def test_the_arm_is_the_one_that_fits_the_measurements(known: Known) -> None:
    """Every deviation counts, those too that are determined together only; units and digits lose nothing."""
    residuals = known.calibration.residuals
    again = po.read_measurements(
        {f"{name} [rad]" if not name.startswith("j3") or known.case.table[2][1] == TURNING else f"{name} [m]": column
         for name, column in zip(residuals.data.joint_names, residuals.data.q.T, strict=True)}
        | {f"{axis} [m]": residuals.data.position[:, "xyz".index(axis)] for axis in known.case.axes},
        known.calibrated,
    )  # fmt: skip
    from posture_opt.measurements.measurements import nominal_poses

    points, _ = nominal_poses(known.calibrated.robot, again.q)
    fitted = residuals.error(known.calibration.x) + residuals.data.position
    np.testing.assert_allclose(points[:, residuals.axes], fitted[:, residuals.axes], atol=2e-9)


def test_an_arm_with_parallel_axes_still_holds_its_axis_and_plane() -> None:
    scara = learnt(CASES["SCARA"])
    assert scara.calibrated.robot.skew > 1e-4
    notes = quick(scara.calibrated).notes
    assert any("holds its tool axis along the direction in every posture" in note for note in notes)
    planar = learnt(Case(TWO, (0.9, 0.4, 0.0), (0, -1, 0)))  # measured in z too: alpha of the first link is found
    solution = quick(planar.calibrated)
    off = planar.arm.points(solution.q)[0] - planar.case.target
    assert np.abs(off[:2]).max() < 5e-4
    assert abs(off[2]) > 2e-5
    (note,) = [note for note in solution.notes if "out-of-plane error" in note]
    assert float(re.search(r"is ([\d.]+) mm", note)[1]) == pytest.approx(1e3 * abs(off[2]), rel=0.1)  # type: ignore[index]


def test_a_box_in_the_plane_of_a_skew_arm_is_reached() -> None:
    box = {"region": {"min": ["0.8 m", "0.3 m", "0 m"], "max": ["1.0 m", "0.5 m", "0 m"]}, "position": None}
    planar = learnt(Case(TWO, (0.9, 0.4, 0.0), (0, -1, 0), more=box))
    solution = quick(planar.calibrated)
    assert solution.status == "optimal"
    assert 0.8 - 1e-6 <= solution.spread.position[0] <= 1.0 + 1e-6


@pytest.mark.campaign
def test_predicted_regions_hold_the_true_landings() -> None:
    """95 % regions of the calibrated arm, visits included, over arms drawn anew."""
    case, inside, trials = CASES["planar 2R"], 0, 80
    q = np.array([1.25, -2.0])
    for seed in range(trials):
        found = learnt(case, seed, 60)
        spread = po.propagate(found.calibrated, q)
        visit = q + np.random.default_rng(10**6 + seed).normal(0, 1, 2) * case.scatter
        off = (found.arm.points(visit)[0] - spread.position)[:2]
        inside += off @ np.linalg.solve(spread.covariance[:2, :2], off) <= 5.991464547  # χ², two of freedom
    # Binomial: 76 ± 2 of 80.
    assert 0.90 <= inside / trials <= 0.99


def simulated_urdf(arm: PinArm, q: np.ndarray, names: list[str], base: str, tip: str) -> np.ndarray:
    return np.array([arm.pose(dict(zip(names, row, strict=True)), base, tip)[:3, 3] for row in q])


def hidden_urdf(text: str, rng: np.random.Generator) -> str:
    """The same arm with the origin of every moving joint moved and turned."""

    def moved(found: re.Match[str]) -> str:
        values = [float(v) + rng.normal(0, SIZE) for v in found[2].split()]
        return f'{found[1]}="{" ".join(map(repr, values))}"'

    def joint(found: re.Match[str]) -> str:
        return re.sub(r'(?<=[< ])(rpy|xyz)="([^"]*)"', moved, found[0], count=2)

    return re.sub(r'<joint name="\w+" type="revolute">\s*<origin [^>]*>', joint, text)


def test_a_urdf_arm_hits_too_and_takes_its_file_along(tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    source, out = tmp_path / "source", tmp_path / "out"
    source.mkdir()
    shutil.copy(Path(__file__).parents[2] / "problems" / "bench_arm.urdf", source)
    text = (source / "bench_arm.urdf").read_text(encoding="utf-8")
    robot = {"kind": "urdf", "file": "bench_arm.urdf"}
    task = {"kind": "insert", "direction": [0, 0, -1], "position": ["0.5 m", "0.1 m", "0.3 m"]}
    data = {"robot": robot, "task": task, "uncertainty": {"measurement": {"position": "0.02 mm"}}}
    problem = po.problem_from_dict(data, source)
    names, links = list(problem.robot.joint_names), dict(problem.robot.sources)
    base, tip = links["base_link"], links["tip_link"]
    true = PinArm(hidden_urdf(text, rng))
    q = rng.uniform(np.maximum(problem.robot.lower, -2.5), np.minimum(problem.robot.upper, 2.5), (90, len(names)))
    turning = np.array([joint.type == TURNING for joint in problem.robot.joints])
    visited = q + rng.normal(0, 1, q.shape) * np.where(turning, SCATTER, SLIDE)
    points = simulated_urdf(true, visited, names, base, tip) + rng.normal(0, NOISE, (90, 3))
    columns = {
        f"{name} [{'rad' if t else 'm'}]": q[:, k] for k, (name, t) in enumerate(zip(names, turning, strict=True))
    }
    columns |= {f"{axis} [m]": points[:, k] for k, axis in enumerate("xyz")}
    calibrated = po.calibrated_problem(problem, po.calibrate(problem, po.read_measurements(columns, problem)))
    out.mkdir()
    again = written(calibrated, out, "calibrated")
    shutil.rmtree(source)
    assert_same_numbers(again, calibrated)
    assert again.to_dict()["robot"]["file"] == "calibrated.urdf"
    solution = quick(again)
    off = simulated_urdf(true, solution.q[None], names, base, tip)[0] - (0.5, 0.1, 0.3)
    assert off @ np.linalg.solve(solution.covariance, off) < 3.5**2
    nominal = PinArm(text).pose(dict(zip(names, solution.q, strict=True)), base, tip)[:3, 3]
    assert np.linalg.norm(nominal - (0.5, 0.1, 0.3)) > 5 * np.linalg.norm(off)


# ---------------------------------------------------------------------------------------------- the command line


@pytest.fixture(scope="module")
def commanded(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Known, Result]:
    folder = tmp_path_factory.mktemp("calibrated")
    found = learnt(CASES["planar 2R"], name="Planar arm")
    (folder / "problem.yaml").write_text(found.problem.to_yaml(), encoding="utf-8")
    rng = np.random.default_rng(0)
    found.case.true_arm(rng)
    columns = found.case.columns(found.arm, rng, 80)
    np.savetxt(folder / "data.csv", np.column_stack(list(columns.values())), fmt="%.12f", delimiter=",",
               header=", ".join(columns), comments="")  # fmt: skip
    words = ["calibrate", folder / "data.csv", "--problem", folder / "problem.yaml", "--out", folder / "out", "--full"]
    return folder, found, invoke(*words, "--no-plots")


def run(*words: object) -> Result:
    result = invoke(*words)
    assert result.exit_code == 0, result.stderr
    return result


def test_the_command_line_plans_with_the_calibrated_arm(commanded: tuple[Path, Known, Result]) -> None:
    folder, found, result = commanded
    assert result.exit_code == 0, result.stderr
    file = folder / "out" / "calibrated.yaml"
    solution = json.loads(run("--problem", file, "--task", "insert", "--json").stdout)
    q = np.array(list(solution["posture"].values()))
    off = found.arm.points(q)[0] - found.case.target
    assert abs(off[0]) < 3.5 * solution["critical"]["sigma_max"]
    drawn = SimulatedArm(found.case.table).points(q)[0] - found.case.target
    assert np.linalg.norm(drawn) > 5 * np.linalg.norm(off[:2])  # the joints are compensated


def test_every_command_takes_the_calibrated_problem(commanded: tuple[Path, Known, Result]) -> None:
    folder, _, _ = commanded
    file, posture = folder / "out" / "calibrated.yaml", ["--posture", "70 deg, -110 deg"]
    spread = json.loads(run("uncertainty", "--problem", file, *posture, "--json").stdout)
    cloud = json.loads(run("simulate", "--problem", file, *posture, "-n", 20000, "--json").stdout)
    # 20 000 draws tell a variance to 1 %; 4 σ.
    np.testing.assert_allclose(np.diag(cloud["covariance"])[:2], np.diag(spread["covariance"])[:2], rtol=0.04)
    assert "tool_covariance" in run("export", "--problem", file, "--to", "c").stdout
    again = json.loads(run("calibrate", folder / "data.csv", "--problem", file, "--json", "--no-plan").stdout)
    assert again["residual_rms"]["nominal"] < 2 * again["residual_rms"]["calibrated"]


def test_the_file_says_what_it_is(commanded: tuple[Path, Known, Result]) -> None:
    text = (commanded[0] / "out" / "calibrated.yaml").read_text(encoding="utf-8")
    assert text.startswith("# Calibrated with data.csv: 80 rows.\n# RMS position error on held-out rows: ")
    assert re.search(r"name: Planar arm, calibrated\n", text)
    assert re.search(r"\n  corrections:\n    j1.theta: -?\d\.\d{6,10} deg\n", text)
    assert "covariance: calibrated_covariance.csv" in text
    assert "repeatability" not in text


def test_the_report_tells_both_postures_and_their_errors(commanded: tuple[Path, Known, Result]) -> None:
    folder, found, result = commanded
    block = result.stdout.split("Comparison of plans\n")[1]
    document = json.loads((folder / "out" / "calibration.json").read_text(encoding="utf-8"))["posture"]
    old, new = document["nominal"], document["calibrated"]
    q = np.array(list(old["posture"].values()))
    true_miss = found.arm.points(q)[0] - found.case.target
    # The calibrated arm knows where the old posture lands, to within its own uncertainty.
    assert old["miss"][0] == pytest.approx(true_miss[0], abs=4 * new["sigma_max"])
    assert new["critical_error"] < 0.5 * old["critical_error"]
    assert old["success_probability"] < 0.5 < new["success_probability"]
    assert re.search(r"mean error across the direction is 0\.\d+ mm", block)
    assert [line.split()[0] for line in block.splitlines() if re.match(r"j\d ", line)] == ["j1", "j2"]
    quiet = run("calibrate", folder / "data.csv", "--problem", folder / "problem.yaml", "--no-plan", "--full")
    assert "Comparison of plans" not in quiet.stdout


def test_the_figure_shows_both_postures_about_the_target(commanded: tuple[Path, Known, Result]) -> None:
    found = commanded[1]
    again = compared(found.problem, found.calibration)
    assert again is not None
    landed = again.answered["nominal"].judged["calibrated"].worst
    (axes,) = plot_comparison(again).axes
    labels = [str(line.get_label()) for line in axes.lines]
    assert [label for label in labels if not label.startswith("_")] == [
        "before calibration: 95 % ellipse",
        "calibrated: 95 % ellipse",
        "target",
        "clearance 0.3 mm",
    ]
    old = np.asarray(axes.lines[0].get_xydata(), dtype=float)
    np.testing.assert_allclose((old.min(axis=0) + old.max(axis=0)) / 2, 1e3 * landed.miss[:2], atol=1e-3)  # mm


@pytest.mark.parametrize("task", [
    {"kind": "insert", "direction": [0, -1, 0]},  # anywhere
    {"kind": "place", "region": {"min": ["0.8 m", "0.3 m", "0 m"], "max": ["1 m", "0.5 m", "0 m"]}},
    {"kind": "probe", "direction": [0, -1, 0], "position": ["0.9 m", "0.4 m", "0 m"]},
])  # fmt: skip
def test_the_miss_is_that_of_the_arm_as_drawn(commanded: tuple[Path, Known, Result], task: dict[str, Any]) -> None:
    found = commanded[1]
    problem = po.problem_from_dict(found.problem.to_dict() | {"task": task})
    again = compared(problem, found.calibration)
    assert again is not None
    (before,) = again.answered["nominal"].stations
    landed, predicted_error = (column.judged["calibrated"].worst for column in again.answered.values())
    drawn = SimulatedArm(found.case.table).points(before.q)[0]  # where the workpiece stands, or is put
    true = found.arm.points(before.q)[0] - drawn
    np.testing.assert_allclose(landed.miss[:2], true[:2], atol=4 * 2e-5)  # 80 poses tell the arm to about 20 µm
    assert predicted_error.distance < 1e-7
    assert predicted_error.critical_error < landed.critical_error


def test_a_calibrated_problem_is_changed_without_its_files(known: Known) -> None:
    other = known.calibrated.with_task("probe")
    assert other.task is not None
    assert other.task.kind == "probe"
    robot = {key: value for key, value in known.calibrated.to_dict()["robot"].items() if key != "corrections"}
    np.testing.assert_allclose(
        known.calibrated.with_robot(robot).sources.covariance, known.calibrated.sources.covariance, rtol=1e-12
    )
    assert known.calibrated.with_robot(robot).robot.factors == known.problem.robot.factors


def test_corrections_add_to_those_of_the_file() -> None:
    case = CASES["planar 2R"]
    plain = learnt(case)
    given = {"corrections": {"j2.a": "0.4 mm", "j1.theta": "-0.01 deg"}}
    again = learnt(case, robot=given)
    for name, factor in plain.calibrated.robot.parameters.items():
        # The same arm from another start; the fit ends within a thousandth of a standard error of 10 µm.
        assert again.calibrated.robot.parameters[name].nominal == pytest.approx(factor.nominal, abs=1e-7), name


def test_found_frames_are_numbers_and_no_longer_free() -> None:
    case, rng = CASES["6R"], np.random.default_rng(2)
    base = shift(5.2, -0.4, 0.3) @ turn(2, 0.7) @ turn(1, -0.3) @ turn(0, 0.2)
    true = SimulatedArm(case.table, case.true_arm(rng).errors, base=base, tool=shift(*case.tool))
    problem = case.problem(true, robot={"base": "free"})
    problem = po.problem_from_dict(problem.to_dict() | {"robot": problem.to_dict()["robot"] | {"tool": "free"}})
    found = po.calibrate(problem, po.read_measurements(case.columns(true, rng, 80), problem))
    calibrated = po.calibrated_problem(problem, found)
    assert not calibrated.robot.base_free
    assert not calibrated.robot.tool_free
    frame = {name: calibrated.robot.parameters[name].nominal for name in ("base.x", "base.y", "base.z", "tool.z")}
    # Base and first link, wrist and tool are told apart by a prior of 10 mm only.
    assert frame == pytest.approx({"base.x": 5.2, "base.y": -0.4, "base.z": 0.3, "tool.z": 0.12}, abs=5e-3)
    q = true.drawn(5, rng)
    spreads = [po.propagate(calibrated, row) for row in q]
    off = np.array([s.position for s in spreads]) - true.points(q)
    assert max(float(o @ np.linalg.solve(s.covariance, o)) for o, s in zip(off, spreads, strict=True)) < 4**2
    nominal = problem.with_fit(nominal_arm(found))
    assert not nominal.robot.base_free
    assert "corrections" not in nominal.to_dict()["robot"]
    again = compared(problem, found)
    assert again is not None
    assert not again.answered
    assert "out of reach" in " ".join(again.reasons)
    assert "the world is the frame of the instrument" in again.reasons[-1]
    assert again.to_json()["calibrated"] is None


def test_of_several_targets_the_first_is_the_tool_point() -> None:
    case, rng = CASES["6R"], np.random.default_rng(3)
    true = case.true_arm(rng)
    tools = [shift(0.03, -0.02, 0.12), shift(-0.05, 0.04, 0.15)]
    q = true.drawn(90, rng)
    which = np.arange(90) % 2
    arms = [SimulatedArm(case.table, true.errors, tool=tool) for tool in tools]
    points = np.where(which[:, None] == 0, arms[0].points(q), arms[1].points(q)) + rng.normal(0, NOISE, (90, 3))
    problem = po.problem_from_dict(case.problem(true).to_dict() | {"robot": true.section(tool="free")})
    columns = {f"{row[0]} [rad]": q[:, k] for k, row in enumerate(case.table)}
    columns |= {f"{axis} [m]": points[:, k] for k, axis in enumerate("xyz")} | {
        "target": np.array(["ball", "cone"])[which]
    }
    found = po.calibrate(problem, po.read_measurements(columns, problem))
    calibrated = po.calibrated_problem(problem, found)
    assert not any("[" in name for name in calibrated.sources.names)
    assert "The tool point is the first of 2 targets, ball." in calibrated.header
    reached = np.array([po.propagate(calibrated, row).position for row in q[:5]])
    assert np.abs(reached - arms[0].points(q[:5])).max() < 1e-4


def test_exact_data_leave_the_stated_scatter(known: Known) -> None:
    case, arm = known.case, known.arm
    q = arm.drawn(60, np.random.default_rng(9))
    points = arm.points(q)
    columns = {f"{row[0]} [{'rad' if row[1] == TURNING else 'm'}]": q[:, k] for k, row in enumerate(case.table)}
    columns |= {f"{axis} [m]": points[:, "xyz".index(axis)] for axis in case.axes}
    found = po.calibrate(known.problem, po.read_measurements(columns, known.problem))
    calibrated = po.calibrated_problem(known.problem, found)
    stated = dict(zip(known.problem.sources.names, known.problem.sources.sigma, strict=True))
    visit = np.sqrt(np.diag(calibrated.sources.scatter))
    assert {n: s for n, s in zip(calibrated.sources.names, visit, strict=True) if s} == pytest.approx(stated, rel=1e-3)
    assert any("as stated: the data do not determine it" in line for line in calibrated.header)


@pytest.mark.parametrize(
    ("uncertainty", "sigma"),
    [
        # 60 rows of 20 µm at levers of 1 to 2 m leave each joint less than about 5 µrad.
        ({"scatter": {"j1.theta": "0.1 urad", "j2.theta": "0.1 urad"}}, {"j1.theta": 1e-7, "j2.theta": 1e-7}),
        ({"scatter": {"j1.theta": "1 mrad", "j2.theta": "1 mrad"}}, None),  # the data speak against it
        ({"sigma": {"j1.theta": "1 mrad", "j2.theta": "1 mrad"}}, None),  # what is known of the zeros is no scatter
    ],
)
def test_data_without_scatter_leave_what_was_stated_unless_they_speak_against_it(uncertainty: Any, sigma: Any) -> None:
    case, rng = CASES["planar 2R"], np.random.default_rng(5)
    arm = case.true_arm(rng)
    q = arm.drawn(60, rng)
    points = arm.points(q) + rng.normal(0, NOISE, (60, 3))
    problem = case.problem(arm, uncertainty={"measurement": {"position": f"{NOISE} m"}} | uncertainty)
    columns = {"j1 [rad]": q[:, 0], "j2 [rad]": q[:, 1], "x [m]": points[:, 0], "y [m]": points[:, 1]}
    calibrated = po.calibrated_problem(problem, po.calibrate(problem, po.read_measurements(columns, problem)))
    visit = np.sqrt(np.diag(calibrated.sources.scatter))
    found = {n: s for n, s in zip(calibrated.sources.names, visit, strict=True) if s}
    if sigma is None:
        assert all(s < 2e-5 for s in found.values())
    else:
        assert found == pytest.approx(sigma, rel=1e-3)


def test_without_a_task_nothing_is_planned() -> None:
    case = CASES["planar 2R"]
    found = learnt(case)
    problem = po.problem_from_dict({key: value for key, value in found.problem.to_dict().items() if key != "task"})
    assert compared(problem, found.calibration) is None


def test_what_was_stated_of_other_parameters_stays() -> None:
    case = CASES["planar 2R"]
    uncertainty = {"measurement": {"position": "0.02 mm"}, "sigma": {"tool.z": "2 mm", "j1.theta": "1 deg"}}
    found = learnt(case, uncertainty=uncertainty)
    sigma = dict(zip(found.calibrated.sources.names, found.calibrated.sources.sigma, strict=True))
    assert sigma["tool.z"] == pytest.approx(2e-3, rel=1e-3)
    assert sigma["j1.theta"] < 1e-3


@pytest.mark.parametrize(
    ("value", "kind", "text"),
    [(1.23456789e-4, "translate", "0.12345679 mm"), (-1e-3, "translate", "-1 mm"), (-1e-15, "translate", "0 mm"),
     (math.pi / 2, "rotate", "90 deg"), (1e-9, "rotate", "0.0000000573 deg")],
)  # fmt: skip
def test_numbers_are_written_as_people_read_them(value: float, kind: Any, text: str) -> None:
    assert quantity(value, Factor(kind, 0)) == text


def test_measurements_planned_for_the_task_close_what_the_data_leave_open(
    commanded: tuple[Path, Known, Result],
) -> None:
    folder = commanded[0]
    words = ["--problem", folder / "out" / "calibrated.yaml", "--for", "task", "--count", "20", "--json"]
    result = run("plan-measurements", *words)
    assert result.exit_code == 0, result.stderr
    std = json.loads(result.stdout)["task"]["std"]
    assert std["after"] < 0.9 * std["before"]
