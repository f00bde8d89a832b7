"""What travels with the package, by its public names."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any

import posture_opt as po
from posture_opt.files import builtin_names, problems_folder
from tests.helpers.command_line import invoke

__all__ = ["PROBLEMS", "builtin_names", "json_schema", "preset_robot", "shipped_tasks"]
PROBLEMS = problems_folder()


@cache
def shipped_tasks() -> dict[Path, Any]:
    """The task of each file."""
    return {path: po.load_problem(path).task for path in sorted(PROBLEMS.glob("*.yaml"))}


def preset_robot(name: str) -> po.Robot:
    """The arm of a preset."""
    return po.problem_from_dict({"robot": {"kind": "preset", "name": name}}).robot


def json_schema() -> dict[str, Any]:
    """The schema of problem files."""
    schema: dict[str, Any] = json.loads(invoke("schema").stdout)
    return schema
