"""Planning with the calibrated arm: what a simulator of its own hides, the calibrated plan hits."""

from __future__ import annotations

import math
import re
import shutil
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import posture_opt as po
from tests.helpers.pin import PinArm
from tests.helpers.same_problem import assert_same_numbers, written
from tests.helpers.simulated_arm import SimulatedArm, shift
from tests.helpers.variants import conformance

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

    def problem(self, arm: SimulatedArm, **keys: Any) -> po.Problem:
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
}


@dataclass(frozen=True)
class Known:
    """A case that was measured and calibrated."""

    case: Case
    arm: SimulatedArm
    problem: po.Problem
    calibration: po.Calibration
    calibrated: po.Problem


@pytest.fixture(scope="module", params=conformance(CASES, ["SCARA"]))
def known(request: pytest.FixtureRequest) -> Known:
    return learnt(CASES[request.param])


def learnt(case: Case, seed: int = 0, n: int = 80, times: int = 1, **keys: Any) -> Known:
    rng = np.random.default_rng(seed)
    arm = case.true_arm(rng)
    problem = case.problem(arm, **keys)
    found = po.calibrate(problem, po.read_measurements(case.columns(arm, rng, n, times), problem))
    return Known(case, arm, problem, found, po.calibrated_problem(problem, found))


def quick(problem: po.Problem) -> Any:
    return po.PostureSelector(problem, compiled=False).solve(starts=12)


def test_the_true_arm_comes_to_lie_where_the_calibrated_plan_says_and_its_files(known: Known, tmp_path: Path) -> None:
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
    again = written(known.calibrated, tmp_path, "calibrated")
    assert {path.name for path in tmp_path.iterdir()} == {"calibrated.yaml", "calibrated_covariance.csv"}
    assert_same_numbers(again, known.calibrated)
    assert again.notes == known.calibrated.notes


def test_the_scatter_from_repeat_to_repeat_is_found() -> None:
    found = learnt(CASES["SCARA"], n=40, times=3)
    scatter = found.calibrated.to_dict()["uncertainty"]["scatter"]
    assert list(scatter) == [f"{row[0]}.{'theta' if row[1] == TURNING else 'd'}" for row in found.case.table]
    turning = [float(text.split()[0]) for name, text in scatter.items() if name.endswith(".theta")]
    # 80 differences between repeats: 160 to 240 coordinates tell one σ to 6 to 8 %; 3 σ of that.
    assert math.radians(turning[0]) == pytest.approx(SCATTER, rel=0.25)


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


@pytest.mark.long
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


def test_corrections_add_to_those_of_the_file() -> None:
    case = CASES["planar 2R"]
    plain = learnt(case)
    given = {"corrections": {"j2.a": "0.4 mm", "j1.theta": "-0.01 deg"}}
    again = learnt(case, robot=given)
    for name, factor in plain.calibrated.robot.parameters.items():
        # The same arm from another start; the fit ends within a thousandth of a standard error of 10 µm.
        assert again.calibrated.robot.parameters[name].nominal == pytest.approx(factor.nominal, abs=1e-7), name


def test_a_calibrated_problem_is_changed_without_its_files(known: Known) -> None:
    other = known.calibrated.with_task("probe")
    assert other.task.kind == "probe"
    robot = {key: value for key, value in known.calibrated.to_dict()["robot"].items() if key != "corrections"}
    np.testing.assert_allclose(
        known.calibrated.with_robot(robot).sources.covariance, known.calibrated.sources.covariance, rtol=1e-12
    )
    assert known.calibrated.with_robot(robot).robot.factors == known.problem.robot.factors


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


def test_what_was_stated_of_other_parameters_stays() -> None:
    case = CASES["planar 2R"]
    uncertainty = {"measurement": {"position": "0.02 mm"}, "sigma": {"tool.z": "2 mm", "j1.theta": "1 deg"}}
    found = learnt(case, uncertainty=uncertainty)
    sigma = dict(zip(found.calibrated.sources.names, found.calibrated.sources.sigma, strict=True))
    assert sigma["tool.z"] == pytest.approx(2e-3, rel=1e-3)
    assert sigma["j1.theta"] < 1e-3
