"""The order of the house: imports run one way and in no circle, names are given once, lists grow by one file."""

from __future__ import annotations

import ast
import importlib
import re
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import Any, get_args

import pytest

import posture_opt
from posture_opt.collision.obstacles import OBSTACLES
from posture_opt.export import EXPORTS
from posture_opt.model.effects import EFFECTS, NOISES
from posture_opt.robot import FORMATS
from posture_opt.selection.solvers import SOLVERS
from posture_opt.selection.tasks import TASKS
from posture_opt.selection.terms import TERMS
from tests.helpers.fresh import loaded_by
from tests.helpers.source import (
    ROOMS,
    SUBROOMS,
    circles,
    defined_twice,
    imports_of,
    kinds_in,
    modules_of,
    stems_twice,
    upward,
)

PACKAGE = Path(posture_opt.__file__).parent
MODULES = modules_of(PACKAGE)
ARCHITECTURE = (PACKAGE.parent / "docs" / "concepts" / "architecture.md").read_text(encoding="utf-8")
HOME = {
    "casadi": {"model", "collision", "uncertainty", "selection", "calibration", "diagnosis"},
    "matplotlib": {"report", "result"},  # a result says of which type its figures are
    "cv2": {"measurements"},
    "yaml": {"problem", "robot"},  # the presets are YAML, and robots stand below problems
}
LAZY = {
    "posture_opt": "a public name, a presenter, an evaluation, when it is first used",
    "posture_opt.__main__": "all of the command line, so that an interrupt finds somebody who answers it",
    "posture_opt.cli.main": "a command, when it is called",
    "posture_opt.cli.deferred": "what a command needs, when it runs",
    "posture_opt.cli.request": "how measurements are read, when there are some",
    "posture_opt.cli.completion": "the entry points of tasks, when a word is completed",
    "posture_opt.cli.output": "the names of a report's files, when there are some to be written",
    "posture_opt.export": "a format, when its name is not enough",
    "posture_opt.measurements.board_detection": "OpenCV, when pictures are searched",
    "posture_opt.model.effects": "an effect, when its kind is asked for",
    "posture_opt.problem.fitting": "how a calibration becomes an arm, when one is taken over",
    "posture_opt.robot.urdf": "how a URDF becomes an arm, when one is given",
    "posture_opt.selection.tasks": "a task, when its kind is asked for",
    "posture_opt.selection.registered_tasks": "what other packages register",
    "posture_opt.selection.select_posture": "what several targets need, when there are several",
    "posture_opt.workers": "executors and processes, when they are asked for",
    "posture_opt.workers.dask_cluster": "Dask, when it is asked for",
    "posture_opt.cli.posture": "the live page, and a browser, when it is asked for",
    "posture_opt.explore.server": "viser, when a page is served",
    "posture_opt.report.page.page": "plotly, when a page is to have a view",
    "posture_opt.report.page.presenter": "pandas, when a table is asked for",
    "posture_opt.report.results": "figures and views of one posture, when they are drawn",
}
"""The files that import by name, and what for."""

MOST_FILES = 24
"""In one folder."""

NAMED_ALIKE = ("posture_opt.cli", "posture_opt.report")
"""A file of commands is called as what they are about, a report's and a figure's as what they show."""

OWN_FILES_READ = {"posture_opt.model.toolchain", "posture_opt.workers.checkpoint"}
"""Modules that read what this program wrote itself: compiled code, and what a map has done already."""

LISTS: dict[str, tuple[type[Any], ...]] = {
    "robot": FORMATS,
    "collision.obstacles": OBSTACLES,
    "model.effects": EFFECTS,
    "model.effects.noise": NOISES,
    "selection.tasks": TASKS,
    "selection.terms": TERMS,
    "selection.solvers": SOLVERS,
    "export": EXPORTS,
}
"""The open lists by their folders."""

DOCUMENTED = {"outliers", "joint_noise"}
"""Kinds of effects that are keys of the documents too (``outliers`` of a calibration: the rows left out)."""


def check(offences: Iterable[str], what: str) -> None:
    """No offence at all; a message that lists those there are."""
    found = sorted(offences)
    assert not found, "\n".join([f"{len(found)} {what}:", *found])


def test_rooms_are_those_of_the_package() -> None:
    there = {m.room for m in MODULES.values()} - {"", "__main__"}
    assert there == set(ROOMS)


def test_the_picture_of_the_architecture_is_the_house() -> None:
    """Its rooms in the order in which they may import each other, and folders where there are folders."""
    section = re.search(r"^```text\n(posture_opt/\n.*?)```", ARCHITECTURE, re.MULTILINE | re.DOTALL)
    entries = re.findall(r"^  (\w+)(\.py|/) ", section[1], re.MULTILINE)
    assert [name for name, _ in entries] == ["__init__", *ROOMS]
    for name, kind in entries:
        assert (PACKAGE / name).is_dir() == (kind == "/"), name


def test_the_architecture_shows_the_order_of_folders() -> None:
    text = re.sub(r" <\n +", " < ", ARCHITECTURE)
    rows = re.findall(r"^(\w+) +(\w+(?: < \w+)+)$", text, re.MULTILINE)
    assert {room: order.split(" < ") for room, order in rows} == SUBROOMS


def test_tests_follow_the_rooms_and_take_nothing_from_each_other() -> None:
    """What several of them need stands in ``tests/helpers``."""
    tests = Path(__file__).parent
    folders = {path.parent.relative_to(tests).as_posix() for path in tests.glob("*/test_*.py")}
    assert folders <= {*ROOMS, "corpus", "floor", "fuzz", "golden", "hidden"}
    known = modules_of(tests)
    assert [
        f"{module.name}:{found.line} imports {found.module}"
        for module in known.values()
        for found in imports_of(module, known)
        if ".test_" in found.module
    ] == []


def test_imports_run_one_way() -> None:
    """Between rooms, and between the folders of a room; for types and by the strings of ``import_module`` too."""
    check(upward(MODULES), "imports upward")


def test_folders_of_rooms_have_their_place() -> None:
    for room, order in SUBROOMS.items():
        folders = {path.parent.name for path in (PACKAGE / room).glob("*/__init__.py")}
        assert folders <= set(order)
        assert all((PACKAGE / room / name).is_dir() or (PACKAGE / room / f"{name}.py").is_file() for name in order)


def test_strings_of_imports_can_be_followed() -> None:
    """``import_module`` gets a string that begins with constant text, so that the order above holds for it."""
    hidden = [
        f"{module.name}:{line} {pattern}"
        for module in MODULES.values()
        for line, pattern in module.named_imports
        if not re.match(r"(posture_opt\\\.)?[a-z]", pattern)
    ]
    check(hidden, "imports by a string that nobody can follow")


def test_no_folder_has_too_many_files() -> None:
    sizes = Counter(module.path.parent for module in MODULES.values())
    large = [f"{path.relative_to(PACKAGE.parent)} has {n}" for path, n in sizes.items() if n > MOST_FILES]
    check(large, f"folders with more than {MOST_FILES} files")


def test_no_modules_import_each_other_in_a_circle() -> None:
    check([", ".join(group) for group in circles(MODULES)], "circles")


def test_the_package_is_imported_at_the_top_of_a_file() -> None:
    inside = [
        f"{module.name}:{found.line} imports {found.module}"
        for module in MODULES.values()
        for found in imports_of(module, MODULES)
        if found.where == "function" and found.module.startswith("posture_opt")
    ]
    check(inside, "imports inside functions")


def test_modules_are_imported_by_name_only_where_it_is_documented() -> None:
    assert {module.name for module in MODULES.values() if module.named_imports} == set(LAZY)


def test_libraries_stay_where_they_belong() -> None:
    astray = [
        f"{module.name}:{found.line} imports {found.module}"
        for module in MODULES.values()
        for found in imports_of(module, MODULES)
        if module.room not in HOME.get(found.module.split(".")[0], {module.room})
    ]
    check(astray, "libraries astray")


def test_print_and_exit_belong_to_the_command_line() -> None:
    calls = [
        f"{module.name}:{node.lineno}"
        for module in MODULES.values()
        if module.room not in ("cli", "__main__")
        for node in module.nodes
        if isinstance(node, ast.Call) and ast.unparse(node.func) in ("print", "sys.exit", "exit")
    ]
    check(calls, "prints")


READING = {"open", "read_text", "read_bytes", "loadtxt", "genfromtxt", "fromfile", "memmap"}


def test_files_are_opened_in_one_place() -> None:
    """``posture_opt.files`` refuses devices, pipes, endless files and names that none can have; ``os.open`` writes,
    ``Image.open`` has bytes."""
    calls = (
        f"{module.name}:{node.lineno} {ast.unparse(node.func)}"
        for module in MODULES.values()
        if module.name not in {"posture_opt.files", *OWN_FILES_READ}
        for node in module.nodes
        if isinstance(node, ast.Call)
        and ast.unparse(node.func).split(".")[-1] in READING
        and ast.unparse(node.func) not in {"os.open", "Image.open"}
    )
    check(calls, "calls that open files")


def test_no_class_is_named_as_another() -> None:
    check([f"{name} in {', '.join(where)}" for name, where in defined_twice(MODULES).items()], "classes named twice")


def test_no_file_is_named_as_one_of_another_room() -> None:
    listed = tuple(f"posture_opt.{folder}." for folder in LISTS if folder != "robot")
    named_freely = {
        name: module
        for name, module in MODULES.items()
        if not name.startswith(NAMED_ALIKE) and not name.startswith(listed)
    }
    check([f"{stem} in {', '.join(rooms)}" for stem, rooms in stems_twice(named_freely).items()], "files named twice")


def test_kinds_of_effects_stand_in_their_files_alone() -> None:
    kinds = kinds_in(MODULES, "posture_opt.model.effects") - DOCUMENTED
    assert len(kinds) > 20
    named = [
        f"{module.name}:{node.lineno} {node.value!r}"
        for module in MODULES.values()
        if not module.name.startswith("posture_opt.model.effects")
        for node in module.strings()
        if node.value in kinds
    ]
    check(named, "kinds of effects as strings")


def test_nobody_asks_of_which_kind_a_thing_is() -> None:
    """No ``x.kind == "insert"``, no ``match x.kind``: what differs between kinds is a method of theirs."""
    kinds = {kind_of(listed) for each in LISTS.values() for listed in each}
    asked = [
        f"{module.name}:{node.lineno} {ast.unparse(node)}"
        for module in MODULES.values()
        if not module.name.startswith(tuple(f"posture_opt.{folder}." for folder in LISTS))
        for node in module.nodes
        if isinstance(node, ast.Compare) and asks_for(node, kinds)
    ]
    check(asked, "questions for a kind")


def asks_for(node: ast.Compare, kinds: set[str]) -> bool:
    """Whether a comparison holds something called kind against one of the kinds."""
    sides = [node.left, *node.comparators]
    return any(ast.unparse(side).split(".")[-1] == "kind" for side in sides) and any(
        isinstance(part, ast.Constant) and part.value in kinds for side in sides for part in ast.walk(side)
    )


def kind_of(listed: type[Any]) -> str:
    (kind,) = get_args(listed.model_fields["kind"].annotation)
    return str(kind)


@pytest.mark.parametrize("folder", LISTS)
def test_every_kind_is_closed_frozen_documented_and_named_once(folder: str) -> None:
    for listed in LISTS[folder]:
        assert listed.model_config["frozen"]
        assert listed.model_config["extra"] == "forbid"
        assert listed.__doc__
    kinds = [kind_of(listed) for listed in LISTS[folder]]
    assert len(set(kinds)) == len(kinds)


@pytest.mark.parametrize("folder", LISTS)
def test_every_file_of_an_open_list_is_listed(folder: str) -> None:
    """What a file of the folder defines is in the list."""
    package = f"posture_opt.{folder}"
    homes = Counter(listed.__module__ for listed in LISTS[folder])
    files = [name for name in MODULES if name.rpartition(".")[0] == package]
    found = {name: len(kinds_in({name: MODULES[name]}, package)) for name in files}
    assert {name: n for name, n in found.items() if n == 1 or name in homes} == homes


@pytest.mark.parametrize("folder", LISTS)
def test_an_open_list_grows_by_one_file_and_one_line(folder: str) -> None:
    """In all of the package a kind is named in its own file and where it is listed: imported once, listed once."""
    more = []
    for listed in LISTS[folder]:
        uses = [
            node.id
            for module in MODULES.values()
            if module.path.name == "__init__.py" and module.name.startswith(f"posture_opt.{folder.split('.')[0]}")
            for node in module.nodes
            if isinstance(node, ast.Name) and node.id == listed.__name__
        ]
        more += [f"{listed.__name__} is listed {len(uses)} times"] if len(uses) > 1 else []
    check(more, f"kinds listed twice in {folder}")


def test_public_names_exist_are_sorted_and_documented() -> None:
    assert list(posture_opt.__all__) == sorted(posture_opt.__all__)
    for name in posture_opt.__all__:
        member = getattr(posture_opt, name)
        assert getattr(member, "__doc__", None), name


def test_importing_the_package_loads_nothing_heavy() -> None:
    heavy = "casadi", "scipy", "matplotlib", "pint", "pydantic"
    assert loaded_by("import posture_opt", *heavy) == []


def test_a_solve_loads_neither_scipy_nor_matplotlib() -> None:
    code = (
        "import posture_opt as po; from posture_opt.problem.load import builtin_problem;"
        "po.select_posture(builtin_problem('insert')).to_json()"
    )
    assert loaded_by(code, "scipy", "matplotlib", "pint") == []


def test_a_report_as_text_loads_nothing_that_draws() -> None:
    code = (
        "import posture_opt as po; from posture_opt.problem.load import builtin_problem;"
        "found = po.select_posture(builtin_problem('insert')); found.report(), found.summary()"
    )
    drawing = tuple(f"posture_opt.report.{folder}" for folder in ("scene", "figures"))
    assert loaded_by(code, "matplotlib", "plotly", "pandas", "jinja2", *drawing) == []


@pytest.mark.parametrize("folder", ["benchmarks", "docs"])
def test_what_stands_beside_the_package_names_what_is_in_it(folder: str) -> None:
    for path in sorted((PACKAGE.parent / folder).rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("posture_opt"):
                module = importlib.import_module(str(node.module))
                of = {a.name: f"{node.module}.{a.name}" for a in node.names}
                # A module of a package is a name in it only once somebody has imported it.
                missing = [name for name, full in of.items() if not hasattr(module, name) and full not in MODULES]
                assert not missing, f"{path.name}:{node.lineno}"


def test_every_module_can_be_imported() -> None:
    for module in sorted(set(MODULES) - {"posture_opt.__main__"}):
        importlib.import_module(module)


def test_the_common_units_are_pints() -> None:
    units = importlib.import_module("posture_opt.units")
    for (unit, dimension), factor in units._COMMON_FACTORS.items():
        si, _ = units.DIMENSIONS[dimension]
        pint = units.registry().Quantity(1.0, unit).to(si).magnitude
        assert factor == pytest.approx(pint, rel=1e-15), unit
