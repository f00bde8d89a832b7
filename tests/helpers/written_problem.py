"""A problem written to its files, and read again from them."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

from posture_opt.problem.problem import Problem, build_problem
from posture_opt.problem.yaml_source import read_yaml


def reloaded(problem: Problem) -> Problem:
    """The problem that its own files hold."""
    with TemporaryDirectory() as folder:
        for name, data in problem.files("problem").items():
            (Path(folder) / name).write_bytes(data)
        return build_problem(read_yaml(Path(folder) / "problem.yaml"), Path(folder), problem.name)
