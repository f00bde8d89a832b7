"""What ``list``, ``new`` and ``schema`` print: all kinds, a commented problem file, the schema of problem files."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from textwrap import indent
from typing import Any, get_args

from posture_opt.cli.request import RobotOptions
from posture_opt.collision.obstacles import OBSTACLES
from posture_opt.encoding import json_text
from posture_opt.errors import InputError, Issue
from posture_opt.export import EXPORTS
from posture_opt.files import builtin_names, content, is_file, preset_names
from posture_opt.model.effects import CATALOGUE
from posture_opt.problem.load import load_builtin
from posture_opt.problem.schema import TITLE, json_schema
from posture_opt.problem.starter import calibrated_starter_text, starter_text, urdf_starter_text
from posture_opt.report.text.text import terminal_width, text_table
from posture_opt.robot import load_preset
from posture_opt.selection.registered_tasks import every_task, registered_tasks
from posture_opt.selection.solvers import SOLVERS
from posture_opt.selection.terms import TERMS
from posture_opt.statements import every_entry

Row = dict[str, str]


def listing(as_json: bool) -> str:
    """All kinds and all names that travel with the package, as text or as a JSON document."""
    tables = {title: rows() for title, rows in TABLES.items()}
    if as_json:
        return json_text({key.replace(" ", "_"): rows for key, rows in tables.items()})
    return "\n\n".join(f"{title.capitalize()}\n{indent(_table(rows), '  ')}" for title, rows in tables.items())


def _table(rows: list[Row]) -> str:
    if not rows:
        return "none so far"
    cells, width = [tuple(row.values()) for row in rows], terminal_width() - 2
    return text_table(tuple(rows[0]), cells, len(rows[0]), width, rule=False)


def _kinds(specs: Iterable[Any]) -> list[Row]:
    return [{"kind": get_args(spec.model_fields["kind"].annotation)[0], "is": spec.summary} for spec in specs]


def _tasks() -> list[Row]:
    """The tasks, and those of other packages that cannot be used."""
    broken = registered_tasks().broken
    reasons = [{"kind": task.name, "is": f"cannot be used: {task.reason} ({task.package})"} for task in broken]
    return [*_kinds(every_task()), *reasons]


def _presets() -> list[Row]:
    rows = []
    for name in preset_names():
        robot = load_preset(name)
        sheet = f"{robot.repeatability.value * 1e3:g} mm" if robot.repeatability else "not stated"
        rows.append({"name": name, "robot": robot.name, "joints": str(robot.n), "repeatability": sheet})
    return rows


TABLES: dict[str, Callable[[], list[Row]]] = {
    "tasks": _tasks,
    "effects": lambda: _kinds(CATALOGUE),
    "presets": _presets,
    "solvers": lambda: _kinds(SOLVERS),
    "terms": lambda: _kinds(TERMS),
    "obstacles": lambda: _kinds(OBSTACLES),
    "exports": lambda: _kinds(EXPORTS),
    "built-in problems": lambda: [{"name": name, "is": load_builtin(name).name} for name in builtin_names()],
}


def starter(robot: str, base_link: str | None, tip_link: str | None, out: Path | None, force: bool) -> str:
    """A commented problem file for a preset or a URDF file, to be written to ``out``."""
    options = RobotOptions(robot, base_link, tip_link)
    options.check()
    if out is not None and out.exists() and not force:
        hint = "choose another name, or replace it with --force"
        raise InputError(Issue(f"{out} exists", ("--out",), str(out), hint))
    try:
        folder = Path() if out is None else out.parent
        if is_file(Path(robot)) and robot.lower().endswith((".conf", ".yaml", ".yml")):
            return calibrated_starter_text(Path(robot), folder)
        if options.is_robot_file:
            return urdf_starter_text(Path(robot), base_link, tip_link, folder)
        return starter_text(robot)
    except InputError as error:
        keys = {"base_link": "--base-link", "tip_link": "--tip-link"}
        what = "FILE" if options.is_robot_file or is_file(Path(robot)) else "PRESET"
        named = [replace(i, key=(keys.get(str(i.key[0]) if i.key else "", what),)) for i in error.issues]
        raise InputError(named) from None


def schema_text(out: Path | None) -> str:
    """The JSON Schema of problem files, to be written to ``out``."""
    if out is not None and is_file(out) and TITLE.encode() not in content(out, 10_000_000):
        hint = "choose another name"
        raise InputError(Issue(f"{out} exists and is no schema of problem files", ("--out",), str(out), hint))
    schema = {"$schema": "https://json-schema.org/draft/2020-12/schema", **json_schema()}
    return json.dumps(schema, indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def statement_listing(as_json: bool) -> str:
    """All statements that results can make: id, severity and sentence, as text or as a JSON document."""
    rows = [{"id": id, "severity": one.severity, "sentence": one.text} for id, one in every_entry().items()]
    return json_text({"statements": rows}) if as_json else _table(rows)
