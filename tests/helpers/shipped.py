"""The problem files that travel with the package, loaded once for all tests."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import posture_opt as po
from posture_opt.files import problems_folder


@cache
def shipped_tasks() -> dict[Path, Any]:
    """The task of each file."""
    return {path: po.load_problem(path).task for path in sorted(problems_folder().glob("*.yaml"))}
