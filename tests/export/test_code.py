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

NAMES = ("insert_ur10_extended", "insert_panda", "insert_planar_2r_correlated_lengths", "measure_planar_2r")
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


@pytest.mark.parametrize("name", NAMES)
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


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")
def test_c_gives_the_same_objective_and_gradient(tmp_path: Path) -> None:
    problem = po.load_problem("insert_panda")
    for file, text in po.export_files(problem, "c").files.items():
        (tmp_path / file).write_text(text)
    library = tmp_path / "objective.so"
    flags = ["-shared", "-fPIC", "-O1", "-std=c99", "-pedantic-errors"]
    subprocess.run(["cc", *flags, str(tmp_path / "tool_covariance_objective.c"), "-o", str(library), "-lm"], check=True)
    function = ctypes.CDLL(str(library)).tool_covariance_objective
    double = ctypes.POINTER(ctypes.c_double)
    namespace: dict[str, Any] = {}
    exec(po.export_files(problem, "python").files["tool_covariance.py"], namespace)
    for q in postures(problem):
        value, gradient = np.zeros(1), np.zeros(7)
        assert function(*(np.ascontiguousarray(a).ctypes.data_as(double) for a in (q, value, gradient))) == 0
        assert value[0] == pytest.approx(namespace["objective"](q), rel=1e-12)
        assert gradient == pytest.approx(namespace["gradient"](q), rel=1e-9, abs=1e-15)


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
