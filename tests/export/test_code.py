"""Exported code runs without the package and gives its numbers."""

from __future__ import annotations

import ctypes
import json
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import posture_opt as po
from tests.helpers.pin import PinArm, robots_folder
from tests.helpers.variants import conformance

NAMES = ("insert_ur10_extended", "insert_panda", "insert_planar_2r_correlated_lengths", "measure_planar_2r")
STANDARDS = ("-std=c99", "-std=c11", "-std=c99", "-std=c11")
SCRIPT = """
import json, sys
sys.modules["posture_opt"] = sys.modules["casadi"] = sys.modules["scipy"] = None
import numpy as np
import tool_covariance as code
q = np.array(json.load(open("q.json")))
found = {"position": code.position(q), "covariance": code.covariance(q), "first_order": code.first_order(q)}
found |= {"objective": code.objective(q), "gradient": code.gradient(q), "one": code.covariance(q[0])}
json.dump({key: np.asarray(value).tolist() for key, value in found.items()}, sys.stdout)
"""


def postures(problem: Any, count: int = 5) -> np.ndarray:
    robot = problem.robot
    low, high = np.maximum(robot.lower, -2), np.minimum(robot.upper, 2)
    return np.random.default_rng(2).uniform(low, high, (count, robot.n))


def worst_variance(problem: Any, q: np.ndarray) -> float:
    """The criterion of the task in the directions that it minds, by NumPy [m²]."""
    C, d = po.propagate(problem, q).covariance, np.array(problem.task.direction, dtype=float)
    d = d / np.linalg.norm(d)
    P = {"along": np.outer(d, d), "across": np.eye(3) - np.outer(d, d), "all": np.eye(3)}[problem.task.within]
    seen = np.linalg.eigvalsh(P @ C @ P)
    return float({"worst": seen[-1], "trace": seen.sum()}[problem.task.criterion])


@pytest.mark.parametrize("name", conformance(NAMES, NAMES[2:]))
def test_python_runs_where_the_package_is_not(name: str, tmp_path: Path) -> None:
    problem = po.load_problem(name)
    (tmp_path / "tool_covariance.py").write_text(po.export_files(problem, "python").files["tool_covariance.py"])
    q = postures(problem)
    (tmp_path / "q.json").write_text(json.dumps(q.tolist()))
    done = subprocess.run(
        [sys.executable, "-I", "-c", f"import sys; sys.path.insert(0, {str(tmp_path)!r})\n{SCRIPT}"],
        capture_output=True, text=True, check=False, cwd=tmp_path,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    found = {key: np.array(value) for key, value in json.loads(done.stdout).items()}
    at = po.SpreadFunction(problem, compiled=False)
    assert np.allclose(found["covariance"], at(q), rtol=1e-9, atol=1e-18)
    assert np.allclose(found["first_order"], at.first_order(q), rtol=1e-9, atol=1e-18)
    assert np.allclose(found["position"], at.position(q), rtol=0, atol=1e-12)
    assert found["one"].shape == (3, 3)
    # Eigenvalues are rounded off where two meet, which costs 1e-4 at most; correlations have few nodes there.
    assert found["objective"] == pytest.approx([worst_variance(problem, row) for row in q], rel=1e-2)
    check_gradient(found["gradient"], q, lambda rows: run_objective(tmp_path, rows))


def check_gradient(gradient: np.ndarray, q: np.ndarray, objective: Any, step: float = 1e-5) -> None:
    """Central differences: right to the square of the step, and to rounding."""
    for j in range(q.shape[1]):
        shift = step * (np.arange(q.shape[1]) == j)
        by_differences = (objective(q + shift) - objective(q - shift)) / (2 * step)
        assert np.allclose(gradient[:, j], by_differences, rtol=1e-5, atol=1e-7 * np.abs(gradient).max())


def run_objective(folder: Path, q: np.ndarray) -> np.ndarray:
    namespace: dict[str, Any] = {}
    exec(compile((folder / "tool_covariance.py").read_text(), "tool_covariance", "exec"), namespace)
    return namespace["objective"](q)


COMPILERS = [compiler for compiler in ("gcc", "clang") if shutil.which(compiler)]
needs_compiler = pytest.mark.skipif(not COMPILERS, reason="no C compiler")
STRICT = ("-Wall", "-Wextra", "-Wpedantic", "-Werror")


def written(problem: Any, folder: Path) -> list[str]:
    """The names of the C files of a problem, written into a folder."""
    files = po.export_files(problem, "c").files
    for file, text in files.items():
        (folder / file).write_text(text)
    return [file for file in files if file.endswith(".c")]


@needs_compiler
@pytest.mark.parametrize(
    ("name", "standard"),
    conformance(zip(NAMES, STANDARDS, strict=True), [(NAMES[2], "-std=c99")]),
)
def test_c_compiles_without_a_warning_and_its_main_says_right(name: str, standard: str, tmp_path: Path) -> None:
    sources = written(po.load_problem(name), tmp_path)
    assert sources == ["tool_covariance.c", "tool_covariance_objective.c", "tool_covariance_check.c"]
    for compiler in COMPILERS:
        subprocess.run([compiler, standard, *STRICT, "-O1", *sources, "-o", "check", "-lm"], cwd=tmp_path, check=True)
        done = subprocess.run([tmp_path / "check"], capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout
        assert len(done.stdout.splitlines()) == 10
        assert done.stdout.endswith("right\n")


@needs_compiler
def test_c_is_right_where_the_compiler_may_reorder_sums(tmp_path: Path) -> None:
    # Run in another process: a library compiled so would flush small numbers to zero in this one.
    sources = written(po.load_problem("insert_planar_2r_correlated_lengths"), tmp_path)
    subprocess.run([COMPILERS[0], "-O3", "-ffast-math", *sources, "-o", "check", "-lm"], cwd=tmp_path, check=True)
    subprocess.run([tmp_path / "check"], check=True, capture_output=True)


@needs_compiler
def test_c_gives_the_numbers_of_python_at_random_postures(tmp_path: Path) -> None:
    problem = po.load_problem("insert_scara")
    sources = written(problem, tmp_path)
    command = [COMPILERS[0], "-shared", "-fPIC", "-O3", "-std=c99", *sources[:2], "-o", "both.so", "-lm"]
    subprocess.run(command, cwd=tmp_path, check=True)
    library = ctypes.CDLL(str(tmp_path / "both.so"))
    namespace: dict[str, Any] = {}
    exec(po.export_files(problem, "python").files["tool_covariance.py"], namespace)
    q = postures(problem, 21)  # not a whole number of blocks
    for row in (*q, q):
        many = np.ndim(row) == 2
        found = {"position": np.zeros((*row.shape[:-1], 3))}
        found |= {key: np.zeros((*row.shape[:-1], 3, 3)) for key in ("covariance", "first_order")}
        called = library.tool_covariance_rows if many else library.tool_covariance
        first = [ctypes.c_longlong(len(row))] if many else []
        assert called(*first, *map(address, (row, *found.values()))) == 0
        for key, values in found.items():
            expected = namespace[key](row)
            assert np.abs(values - expected).max() <= 1e-12 * np.abs(expected).max(), key
    for row in q:
        found = {"objective": np.zeros(1), "gradient": np.zeros(4), "hessian": np.zeros((4, 4))}
        assert library.tool_covariance_objective(*map(address, (row, *found.values()))) == 0
        for key, values in found.items():
            expected = namespace[key](row)
            assert np.abs(values - expected).max() <= 1e-12 * np.abs(expected).max(), key
        alone = np.zeros(1)
        assert library.tool_covariance_objective(address(row), address(alone), None, None) == 0
        assert alone[0] == found["objective"][0]


def address(array: np.ndarray) -> Any:
    assert array.flags.c_contiguous
    return ctypes.c_void_p(array.ctypes.data)


def test_the_hessian_is_that_of_differences() -> None:
    problem = po.load_problem("insert_panda")
    namespace: dict[str, Any] = {}
    exec(po.export_files(problem, "python").files["tool_covariance.py"], namespace)
    q, step = postures(problem), 1e-5
    hessian = namespace["hessian"](q)
    assert np.array_equal(hessian, hessian.swapaxes(1, 2))
    for j in range(7):
        shift = step * (np.arange(7) == j)
        column = (namespace["gradient"](q + shift) - namespace["gradient"](q - shift)) / (2 * step)
        assert np.allclose(hessian[:, :, j], column, rtol=1e-5, atol=1e-7 * np.abs(hessian).max())


@needs_compiler
def test_c_puts_the_tool_point_where_pinocchio_does(tmp_path: Path) -> None:
    urdf = robots_folder() / "panda_description" / "urdf" / "panda.urdf"
    base, tip = "panda_link0", "panda_hand_tcp"
    problem = po.problem_from_dict({
        "robot": {"kind": "urdf", "file": str(urdf), "base_link": base, "tip_link": tip, "shape": {"replace": []}},
        "cell": "none",
        "uncertainty": {"sigma": {"panda_joint1.theta": "1 mrad"}},
    })  # fmt: skip
    sources = written(problem, tmp_path)
    assert "tool_covariance_objective.c" not in sources  # no task
    command = [COMPILERS[0], "-shared", "-fPIC", "-O2", "-std=c99", sources[0], "-o", "arm.so", "-lm"]
    subprocess.run(command, cwd=tmp_path, check=True)
    q = postures(problem, 12)
    found = np.zeros((12, 3))
    library = ctypes.CDLL(str(tmp_path / "arm.so"))
    assert library.tool_covariance_rows(ctypes.c_longlong(12), address(q), address(found), None, None) == 0
    arm, names = PinArm(urdf), problem.robot.joint_names
    expected = [arm.pose(dict(zip(names, row, strict=True)), base, tip)[:3, 3] for row in q]
    assert np.allclose(found, expected, rtol=0, atol=1e-14)


def test_without_a_single_target_there_is_no_objective() -> None:
    for name in ("insert_ur10_plate", "simulate"):
        problem = po.load_problem("insert_ur10_plate")
        if name == "simulate":
            problem = po.problem_from_dict(
                {key: v for key, v in problem.to_dict().items() if key not in ("task", "cell")}
            )
        found = po.export_files(problem, "python")
        assert "def covariance" in found.files["tool_covariance.py"]
        assert "def objective" not in found.files["tool_covariance.py"]
        assert "objective" in found.notes[0]
