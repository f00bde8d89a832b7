"""The order of the house: imports run one way, lists are complete, public names exist."""

from __future__ import annotations

import ast
import importlib
import subprocess
import sys
from pathlib import Path

import pytest

import posture_opt
from posture_opt.robot import FORMATS
from posture_opt.selection.solvers import SOLVERS
from posture_opt.selection.tasks import TASKS
from posture_opt.selection.terms import TERMS

PACKAGE = Path(posture_opt.__file__).parent
ORDER = ["errors", "units", "spec", "numerics", "nearest", "robot", "model", "uncertainty", "selection"]
ORDER += ["measurements", "calibration", "validation", "experiments", "diagnosis", "batch", "problem", "report", "cli"]
FITTED = {"calibration", "validation", "experiments", "diagnosis"}
HOME = {
    "casadi": {"model", "uncertainty", "selection", *FITTED},
    "matplotlib": {"report"},
    "yaml": {"problem", "robot"},
}
# To be emptied: imports that still run upward.
UPWARD = {
    ("uncertainty", "report"),
    ("diagnosis", "report"),
    ("diagnosis", "problem"),
    ("selection", "report"),
    ("selection", "problem"),
    ("validation", "report"),
    ("validation", "problem"),
    ("experiments", "problem"),
}
FILES = sorted(PACKAGE.rglob("*.py"))


def room(module: str) -> str:
    return module.split(".")[1] if module.startswith("posture_opt.") else ""


def imports(path: Path) -> list[tuple[str, bool]]:
    """Imported modules and whether the import stands at the top of the file."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    found = []
    for node in ast.walk(tree):
        names = [node.module] if isinstance(node, ast.ImportFrom) and node.module else []
        names += [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
        found += [(name, node in tree.body) for name in names]
    return found


@pytest.mark.parametrize("path", FILES, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_imports_run_one_way(path: Path) -> None:
    here = path.relative_to(PACKAGE).parts[0].removesuffix(".py")
    if here not in ORDER:
        pytest.skip("the package's own front door")
    for module, _ in imports(path):
        there = room(module)
        if there in ORDER and ORDER.index(there) > ORDER.index(here):
            assert (here, there) in UPWARD, f"{path.name} imports {module}, which stands above it"
        library = module.split(".")[0]
        if library in HOME:
            assert here in HOME[library], f"{library} does not belong in {here}"


@pytest.mark.parametrize("path", FILES, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_print_and_exit_belong_to_the_command_line(path: Path) -> None:
    if path.relative_to(PACKAGE).parts[0] in ("cli", "__main__.py"):
        pytest.skip("here they belong")
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Call):
            called = ast.unparse(node.func)
            assert called not in ("print", "sys.exit", "exit"), f"{path.name}:{node.lineno}"


@pytest.mark.parametrize("listed", [FORMATS, TASKS, TERMS, SOLVERS], ids=["formats", "tasks", "terms", "solvers"])
def test_every_kind_is_closed_frozen_and_named_once(listed: tuple[type, ...]) -> None:
    kinds = []
    for kind in listed:
        config = kind.model_config  # type: ignore[attr-defined]
        assert config["frozen"]
        assert config["extra"] == "forbid"
        assert kind.__doc__
        annotation = kind.model_fields["kind"].annotation  # type: ignore[attr-defined]
        kinds.append(annotation.__args__[0])
    assert len(set(kinds)) == len(kinds)


@pytest.mark.parametrize(("folder", "listed"), [("tasks", TASKS), ("terms", TERMS), ("solvers", SOLVERS)])
def test_every_file_of_an_open_list_is_listed(folder: str, listed: tuple[type, ...]) -> None:
    files = {path.stem for path in (PACKAGE / "selection" / folder).glob("*.py")}
    bases = {"__init__", folder.removesuffix("s")}
    assert {kind.__module__.rsplit(".", 1)[1] for kind in listed} == files - bases


def test_public_names_exist_are_sorted_and_documented() -> None:
    assert list(posture_opt.__all__) == sorted(posture_opt.__all__)
    for name in posture_opt.__all__:
        member = getattr(posture_opt, name)
        assert getattr(member, "__doc__", None), name


def test_importing_the_package_loads_nothing_heavy() -> None:
    heavy = "casadi", "scipy", "matplotlib", "pint", "yourdfpy", "pydantic"
    code = f"import sys, posture_opt; print([m for m in {heavy} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_a_solve_loads_neither_scipy_nor_matplotlib() -> None:
    code = (
        "import sys, posture_opt as po; from posture_opt.problem.load import builtin_problem;"
        "po.select_posture(builtin_problem('insert')).to_json();"
        "print([m for m in ('scipy', 'matplotlib', 'yourdfpy', 'pint') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_every_module_imports_alone() -> None:
    for path in FILES:
        module = ".".join(path.relative_to(PACKAGE.parent).with_suffix("").parts)
        if not module.endswith("__main__"):
            importlib.import_module(module)


def test_the_common_units_are_pints() -> None:
    units = importlib.import_module("posture_opt.units")
    for (unit, dimension), factor in units._COMMON.items():
        si, _ = units.DIMENSIONS[dimension]
        pint = units.registry().Quantity(1.0, unit).to(si).magnitude
        assert factor == pytest.approx(pint, rel=1e-15), unit
