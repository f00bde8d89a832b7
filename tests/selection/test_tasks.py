"""Every listed task on three arms; what each of them makes small; tasks that installed packages register."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from importlib.metadata import EntryPoint
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import posture_opt as po
from posture_opt.selection.registered_tasks import kind_of, read_tasks
from posture_opt.selection.tasks import TASKS
from posture_opt.selection.tasks.insert import Insert
from tests.helpers.sampled import poses
from tests.helpers.variants import conformance

POINTS: dict[str, list[str]] = {
    "panda": ["0.5 m", "0.1 m", "0.2 m"],
    "scara": ["0.25 m", "0.1 m", "-0.05 m"],
}
KINDS = [kind_of(task) for task in TASKS]
SINGLE = [kind for kind in KINDS if kind not in ("weld", "dispense")]
"""Those that are done at one posture."""
every_robot = pytest.mark.parametrize("robot", conformance(POINTS, ["scara"]))

OWN_TASK = (Path(__file__).parents[2] / "docs" / "how-to" / "tasks" / "own-task.md").read_text(encoding="utf-8")


def problem(robot: str, kind: str, **task: Any) -> Any:
    return po.problem_from_dict(
        {
            "robot": {"kind": "preset", "name": robot},
            "uncertainty": {"repeatability": "0.05 mm"},
            "task": {"kind": kind, "position": POINTS[robot], **task},
        }
    )


def sampled(given: Any, q: np.ndarray, n: int = 100_000) -> tuple[np.ndarray, np.ndarray]:
    """Shifts (N, 3) of the tool point and columns (3, 3, N) of the rotation, by plain NumPy."""
    rng, robot = np.random.default_rng(2), given.robot
    place = {f.parameter: i for i, f in enumerate(robot.factors) if f.parameter}
    p = rng.multivariate_normal(np.zeros(len(given.sources.names)), given.sources.covariance, n)
    x, columns = poses(robot.factors, q, {place[name]: p[:, k] for k, name in enumerate(given.sources.names)}, n)
    return (x - poses(robot.factors, q, {}, 1)[0]).T, columns


# --- every task ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("kind", "robot"),
    conformance(product(SINGLE, POINTS), [*((kind, "scara") for kind in SINGLE), ("insert", "panda")]),
)
def test_every_task_is_solved_told_and_written(kind: str, robot: str) -> None:
    solution = po.select_posture(problem(robot, kind))
    document = solution.to_json()
    assert document["status"] == "optimal"
    assert document["task"] == kind
    assert json.loads(json.dumps(document, allow_nan=False))["critical"]["sigma_max"] > 0
    assert kind in str(solution.report())
    worst = max(solution.statistics.worst, solution.critical.sigma_max)
    assert solution.critical.sigma_max <= worst * (1 + 1e-9)


# --- place, measure, hold, custom ---------------------------------------------------------------------------------


@every_robot
def test_corners_of_a_part_err_as_sampled_ones(robot: str) -> None:
    lever = 0.3
    solution = po.select_posture(problem(robot, "place", lever=f"{lever} m"))
    shift, columns = sampled(solution.problem, solution.q)
    nominal = poses(solution.problem.robot.factors, solution.q, {}, 1)[1][:, :, 0]
    squares = []
    for angle in np.arange(8) * np.pi / 4:
        corner = lever * np.array([np.cos(angle), np.sin(angle), 0.0])
        moved = shift + np.einsum("k,kin->ni", corner, columns) - corner @ nominal
        squares.append(np.mean(moved[:, 0] ** 2 + moved[:, 1] ** 2))  # direction -z
    assert solution.to_json()["yaw"]["corner_rms"] == pytest.approx(np.sqrt(np.mean(squares)), rel=5e-3)


def test_a_long_lever_trades_place_for_yaw() -> None:
    """The arm with a weak last wrist joint: a lever of half a metre wants the yaw small, and pays for it in place."""
    sigma = {f"panda_joint{k}.theta": "0.1 mrad" for k in range(1, 8)} | {"panda_joint3.theta": "1 mrad"}
    robot = {"kind": "preset", "name": "panda"}
    found = {}
    for lever in (None, "1 m"):
        task = {"kind": "place", "position": POINTS["panda"], "lever": lever}
        given = po.problem_from_dict({"robot": robot, "uncertainty": {"sigma": sigma}, "task": task})
        found[lever] = po.select_posture(given).task_spread
    near, far = found[None], found["1 m"]
    assert far.yaw.sigma < near.yaw.sigma
    assert np.trace(far.critical.covariance) >= np.trace(near.critical.covariance)


def heading(solution: Any) -> float:
    """Angle of the tool's x axis about the vertical [deg], by plain NumPy."""
    columns = poses(solution.problem.robot.factors, solution.q, {}, 1)[1][:, :, 0]
    return float(np.degrees(np.arctan2(columns[0, 1], columns[0, 0])))


@pytest.mark.parametrize(("robot", "yaw"), conformance([("scara", 75.0), ("panda", -170.0)], [("scara", 75.0)]))
def test_the_yaw_is_held_where_it_is_asked_for(robot: str, yaw: float) -> None:
    solution = po.select_posture(problem(robot, "place", yaw=f"{yaw} deg"))
    assert solution.status == "optimal"
    assert heading(solution) == pytest.approx(yaw, abs=1e-4)
    assert solution.critical.sigma_max >= po.select_posture(problem(robot, "place")).critical.sigma_max * (1 - 1e-4)
    assert "spin" in str(solution.explain())


def test_the_yaw_turns_with_the_workpiece() -> None:
    part = {"x": "0.5 m", "y": "0.1 m", "z": "0.2 m", "yaw": "30 deg"}
    features = [{"name": "a", "position": ["0 m", "0 m", "0 m"]}, {"name": "b", "position": ["40 mm", "0 m", "0 m"]}]
    task = {"kind": "place", "yaw": "20 deg", "workpiece": part, "features": features}
    robot = {"kind": "preset", "name": "panda"}
    given = po.problem_from_dict({"robot": robot, "uncertainty": {"repeatability": "0.05 mm"}, "task": task})
    for station in po.select_posture(given).stations:
        assert heading(station) == pytest.approx(50.0, abs=1e-3)


@every_robot
def test_expanded_uncertainty_covers_what_it_says(robot: str) -> None:
    solution = po.select_posture(problem(robot, "measure", coverage_factor=2))
    expanded = solution.to_json()["expanded_uncertainty"]
    shift, _ = sampled(solution.problem, solution.q)
    assert np.mean(np.abs(shift[:, 2]) <= expanded["along"]) == pytest.approx(0.9545, abs=0.003)
    assert expanded["worst"] == pytest.approx(2 * solution.critical.sigma_max)
    assert "U = " in str(solution.report())


@every_robot
def test_hold_makes_the_worst_of_all_directions_small(robot: str) -> None:
    solution = po.select_posture(problem(robot, "hold"))
    others = [po.propagate(solution.problem, q).covariance for q in solution.feasible[::10]]
    least = min(np.linalg.eigvalsh(C)[-1] for C in others)
    assert solution.critical.sigma_max**2 <= least * (1 + 1e-3)


DESCRIBED: dict[str, dict[str, Any]] = {
    "insert": {"within": "across", "axis": "aligned", "criterion": "worst"},
    "probe": {"within": "along", "axis": "aligned", "criterion": "worst"},
    "measure": {"within": "all", "axis": "free", "criterion": "trace"},
    "drill": {"within": "across", "axis": "required", "criterion": "worst"},
}


@pytest.mark.parametrize(
    ("kind", "robot"), conformance([*((kind, "scara") for kind in DESCRIBED), ("drill", "panda")], [("probe", "scara")])
)
def test_custom_is_the_task_that_its_keys_describe(kind: str, robot: str) -> None:
    named = po.select_posture(problem(robot, kind))
    custom = po.select_posture(problem(robot, "custom", **DESCRIBED[kind]))
    assert custom.critical.sigma_max == pytest.approx(named.critical.sigma_max, rel=1e-4)


@pytest.mark.parametrize(
    ("task", "message"),
    [
        ({"kind": "custom", "within": "beside"}, "across"),
        ({"kind": "insert", "within": "along"}, "unknown key"),
        ({"kind": "place", "lever": "50 mm", "criterion": "miss", "clearance": "1 mm"}, "leave out the lever"),
        ({"kind": "measure", "coverage_factor": 0}, "greater than 0"),
        ({"kind": "place", "yaw": "10 deg", "direction": [0, 1, -1]}, "about the vertical"),
        ({"kind": "place", "yaw": "10 deg", "tilt": "5 deg"}, "yaw and tilt"),
    ],
)
def test_keys_of_tasks_are_checked(task: dict[str, Any], message: str) -> None:
    with pytest.raises(po.errors.InputError, match=message):
        po.problem_from_dict({"robot": {"kind": "preset", "name": "ur10"}, "task": task})


# --- tasks of other packages --------------------------------------------------------------------------------------


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", OWN_TASK, re.DOTALL)


def installed(folder: Path, code: str, points: str) -> dict[str, str]:
    """The environment of a process in which a package ``polishing`` with these entry points is installed."""
    package = folder / "polishing"
    package.mkdir()
    (package / "__init__.py").write_text("")
    (package / "task.py").write_text(code)
    info = folder / "posture_opt_polishing-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: posture-opt-polishing\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(points)
    former = [entry for entry in os.environ.get("PYTHONPATH", "").split(os.pathsep) if entry]  # an empty one is here
    return {**os.environ, "PYTHONPATH": os.pathsep.join([str(folder), str(Path(po.__file__).parents[1]), *former])}


def entry_points_text() -> str:
    (toml,) = blocks("toml")
    return re.sub(r'\[project\.entry-points\."(.+?)"\]', r"[\1]", toml).replace('"', "")


def command(*arguments: str, env: dict[str, str]) -> Any:
    return subprocess.run([sys.executable, "-m", "posture_opt", *arguments], env=env, capture_output=True, text=True)


@pytest.mark.long
def test_the_documented_task_of_an_installed_package_is_solved(tmp_path: Path) -> None:
    (code,) = blocks("python")
    env = installed(tmp_path, code, entry_points_text())
    assert re.search(r"polish +press a wheel on a surface", command("list", env=env).stdout)
    target = ("--task", "polish", "--robot", "ur10", "--position", "0.6 m, 0.2 m, 0.2 m", "--json")
    done = command(*target, env=env)
    assert done.returncode == 0, done.stderr
    document = json.loads(done.stdout)
    assert document["task"] == "polish"
    assert document["critical"]["within"] == "along"
    assert document["expanded_uncertainty"]["coverage_factor"] == 3
    assert '"polish"' in command("schema", env=env).stdout


def test_the_documented_task_of_a_file_is_solved(tmp_path: Path) -> None:
    (section,) = blocks("yaml")
    file = tmp_path / "own.yaml"
    file.write_text("robot: {kind: preset, name: ur10}\nuncertainty: {repeatability: 0.1 mm}\n" + section)
    solution = po.select_posture(po.load_problem(file))
    assert solution.critical.sigma_max <= 0.03e-3 * (1 + 1e-6)


@pytest.mark.long
def test_a_broken_package_is_named_and_disturbs_no_other_task(tmp_path: Path) -> None:
    reason = "ModuleNotFoundError: No module named 'there_is_no_such_module'"
    env = installed(tmp_path, "import there_is_no_such_module", entry_points_text())
    listed = " ".join(command("list", env=env).stdout.split())
    assert reason in listed
    assert command("--task", "insert", "--quiet", env=env).returncode == 0
    done = command("--task", "polish", "--robot", "ur10", env=env)
    assert done.returncode == 2
    said = " ".join(done.stderr.split())
    assert "the task 'polish' of the package posture-opt-polishing cannot be used" in said
    assert reason in said
    assert "Traceback" not in said


def test_no_task_is_loaded_from_the_working_directory(tmp_path: Path) -> None:
    """Data of others may lie there, with a folder that calls itself an installed package, or a module of a library."""
    env = installed(tmp_path, "raise SystemExit(7)", entry_points_text())
    (tmp_path / "yaml.py").write_text("raise SystemExit(8)\n")
    env["PYTHONPATH"] = env["PYTHONPATH"].partition(os.pathsep)[2]
    words = [sys.executable, "-m", "posture_opt", "list", "--json"]
    done = subprocess.run(words, env=env, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "polish" not in done.stdout


def test_a_kind_that_is_taken_is_refused() -> None:
    point = EntryPoint("insert", "posture_opt.selection.tasks.insert:Insert", "posture_opt.tasks")
    found = read_tasks([point])
    assert found.tasks == ()
    assert "a task of that kind is there already" in str(found.broken[0])
    other = read_tasks([EntryPoint("peg", "posture_opt.selection.tasks.insert:Insert", "posture_opt.tasks")])
    assert 'does not say kind: Literal["peg"]' in other.broken[0].reason
    none = read_tasks([EntryPoint("polish", "posture_opt.selection.tasks:TASKS", "posture_opt.tasks")])
    assert "is no subclass of posture_opt.Task" in none.broken[0].reason
    assert kind_of(Insert) == "insert"
