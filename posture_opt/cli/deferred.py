"""Modules that commands need once they run, each imported when it is first used.

A shell that completes a word must not wait for NumPy, CasADi or pydantic, so the files of commands import none of them.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from posture_opt.cli import problem_texts as problem_texts
    from posture_opt.cli import quantities as quantities
    from posture_opt.cli import request as request
    from posture_opt.export import export_files as export_files
    from posture_opt.export import robot_program as robot_program
    from posture_opt.measurements import board_detection as board_detection
    from posture_opt.problem import yaml_source as yaml_source

_HOMES = {
    "board_detection": "measurements.board_detection",
    "export_files": "export.export_files",
    "problem_texts": "cli.problem_texts",
    "quantities": "cli.quantities",
    "request": "cli.request",
    "robot_program": "export.robot_program",
    "yaml_source": "problem.yaml_source",
}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return import_module(f"posture_opt.{_HOMES[name]}")
