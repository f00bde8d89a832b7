"""What commands need once they run, each imported when it is first used.

A shell that completes a word asks for commands and options only. It must not wait for the libraries behind them, so the
files of the commands import nothing that loads NumPy, CasADi or pydantic.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from posture_opt.cli.asked.pictures import detected as detected
    from posture_opt.cli.asked.quantities import columns_of as columns_of
    from posture_opt.cli.asked.quantities import corner as corner
    from posture_opt.cli.asked.quantities import distance_of as distance_of
    from posture_opt.cli.asked.quantities import height_of as height_of
    from posture_opt.cli.asked.quantities import requested_posture as requested_posture
    from posture_opt.cli.asked.request import placed as placed
    from posture_opt.cli.asked.request import problem_of_data as problem_of_data
    from posture_opt.cli.asked.request import requested_problem as requested_problem
    from posture_opt.cli.asked.request import with_columns as with_columns
    from posture_opt.cli.asked.robot_options import names_problem_file as names_problem_file
    from posture_opt.cli.problem_texts import listing as listing
    from posture_opt.cli.problem_texts import schema_text as schema_text
    from posture_opt.cli.problem_texts import starter as starter
    from posture_opt.cli.problem_texts import statement_listing as statement_listing
    from posture_opt.export.export_files import export_kinds as export_kinds
    from posture_opt.export.export_files import program_files as program_files
    from posture_opt.export.known_programs import compensated_program as compensated_program
    from posture_opt.export.known_programs import measuring_program as measuring_program
    from posture_opt.problem.yaml_source import MAX_BYTES as MAX_BYTES

_HOMES = {
    "MAX_BYTES": "problem.yaml_source",
    "columns_of": "cli.asked.quantities",
    "compensated_program": "export.known_programs",
    "corner": "cli.asked.quantities",
    "distance_of": "cli.asked.quantities",
    "detected": "cli.asked.pictures",
    "export_kinds": "export.export_files",
    "height_of": "cli.asked.quantities",
    "listing": "cli.problem_texts",
    "measuring_program": "export.known_programs",
    "names_problem_file": "cli.asked.robot_options",
    "placed": "cli.asked.request",
    "problem_of_data": "cli.asked.request",
    "program_files": "export.export_files",
    "requested_posture": "cli.asked.quantities",
    "requested_problem": "cli.asked.request",
    "schema_text": "cli.problem_texts",
    "starter": "cli.problem_texts",
    "statement_listing": "cli.problem_texts",
    "with_columns": "cli.asked.request",
}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"posture_opt.{_HOMES[name]}"), name)
