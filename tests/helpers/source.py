"""The source of a package read as text: its modules, what they import and where, and what they define.

Standard library only, so that any state of the repository can be measured, also one that does not run.
"""

from __future__ import annotations

import ast
import re
from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from typing import Literal

ROOMS = [
    "errors",
    "limits",
    "texts",
    "units",
    "spec",
    "numerics",
    "encoding",
    "interrupts",
    "files",
    "statements",
    "output",
    "result",
    "workers",
]
ROOMS += ["robot", "model", "collision", "uncertainty", "measurements", "selection"]
ROOMS += ["calibration", "validation", "experiments", "diagnosis", "changes", "batch", "compensation"]
ROOMS += ["problem", "export", "report", "explore", "cli"]
"""The rooms of the package in the order in which they may import each other: each only those before it."""

SUBROOMS: dict[str, list[str]] = {
    "selection": [
        *("terms", "tasks", "registered_tasks", "program", "solvers"),
        *("problem_data", "search", "answer", "stations", "maps", "paths"),
        *("select_posture", "posture_batch", "comparison"),
    ],
    "calibration": ["estimation", "assumptions"],
    "diagnosis": ["scores", "search", "noise", "causes"],
    "report": ["text", "page", "parts", "scene", "figures", "results"],
}
"""The folders of a room, and such of its files as another folder needs, in the order in which they may import each
other; files that are not listed come behind all folders.
"""

STATEMENTS = "_statements"
"""End of the names of files that make the statements of a result."""
Where = Literal["top", "typing", "function", "string"]
Function = ast.FunctionDef | ast.AsyncFunctionDef


@dataclass(frozen=True)
class Import:
    """One imported module: its full name, the line, and whether it is imported for good, for types, when called, or by
    the string that ``import_module`` gets.
    """

    module: str
    line: int
    where: Where


@dataclass(frozen=True)
class Module:
    """One file of a package."""

    name: str
    path: Path
    text: str

    @cached_property
    def tree(self) -> ast.Module:
        return ast.parse(self.text)

    @cached_property
    def nodes(self) -> tuple[ast.AST, ...]:
        """All of the tree, walked through once for all questions."""
        return tuple(ast.walk(self.tree))

    @property
    def room(self) -> str:
        """The folder or file right below the package; empty for the package's own ``__init__``."""
        return room_of(self.name)

    @cached_property
    def lines(self) -> list[str]:
        return self.text.splitlines()

    @cached_property
    def statements(self) -> list[tuple[ast.stmt, Where]]:
        """Every import statement of the file with where it stands."""
        return list(_statements(self.tree.body, "top"))

    @cached_property
    def docstrings(self) -> list[ast.Constant]:
        """Docstrings of the module, its classes and functions, and the strings right behind an assignment."""
        found = []
        for node in self.nodes:
            for body in (getattr(node, field, None) for field in ("body", "orelse", "finalbody")):
                if isinstance(body, list):
                    found += [s.value for s in body if isinstance(s, ast.Expr) and _is_text(s.value)]
        return found  # type: ignore[return-value]

    @cached_property
    def named_imports(self) -> list[tuple[int, str]]:
        """The line of every ``import_module`` and what it gets, as a pattern: ``x.*`` where only ``x`` is constant."""
        constants = dict(_string_constants(self.tree)) | dict(_string_tables(self.tree))
        calls = [node for node in self.nodes if isinstance(node, ast.Call) and node.args and _imports(node)]
        return sorted((node.lineno, _pattern(node.args[0], constants)) for node in calls)

    def functions(self) -> Iterator[Function]:
        yield from (node for node in self.nodes if isinstance(node, Function))

    def classes(self) -> Iterator[ast.ClassDef]:
        yield from (node for node in self.nodes if isinstance(node, ast.ClassDef))

    def strings(self) -> Iterator[ast.Constant]:
        """String constants that are no docstrings and no keys of f-strings."""
        texts = {id(node) for node in self.docstrings}
        yield from (node for node in self.nodes if _is_text(node) and id(node) not in texts)


def room_of(module: str) -> str:
    """The folder or file right below a package in which a module stands; empty for the package itself."""
    return [*module.split("."), ""][1]


def _imports(node: ast.Call) -> bool:
    name = getattr(node.func, "attr", getattr(node.func, "id", ""))
    return name in ("import_module", "__import__")


def _string_constants(tree: ast.Module) -> Iterator[tuple[str, str]]:
    """Names that the module gives to strings, also ``A, B = "a", "b"``."""
    for node in tree.body:
        if isinstance(node, ast.Assign) and len(node.targets) == 1:
            target, value = node.targets[0], node.value
            tuples = isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple)
            pairs = zip(target.elts, value.elts, strict=True) if tuples else [(target, value)]  # type: ignore[attr-defined]
            yield from (
                (name.id, text.value)
                for name, text in pairs
                if isinstance(name, ast.Name) and isinstance(text, ast.Constant) and isinstance(text.value, str)
            )


def _string_tables(tree: ast.Module) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Names that the module gives to dictionaries of strings, with the strings."""
    for node in tree.body:
        if isinstance(node, ast.Assign) and isinstance(node.value, ast.Dict) and isinstance(node.targets[0], ast.Name):
            values = [str(text.value) for text in node.value.values if _is_text(text)]  # type: ignore[attr-defined]
            if len(values) == len(node.value.values):
                yield node.targets[0].id, tuple(values)


def _pattern(node: ast.expr, constants: Mapping[str, str | tuple[str, ...]]) -> str:
    """A regular expression for the strings that an expression can have."""
    if isinstance(node, ast.Constant):
        return re.escape(str(node.value))
    known = constants.get(node.id) if isinstance(node, ast.Name) else None
    if isinstance(known, str):
        return re.escape(known)
    entries = constants.get(ast.unparse(node.value)) if isinstance(node, ast.Subscript) else None
    if isinstance(entries, tuple):
        return f"({'|'.join(map(re.escape, entries))})"
    if isinstance(node, ast.IfExp):
        return f"({_pattern(node.body, constants)}|{_pattern(node.orelse, constants)})"
    if isinstance(node, ast.JoinedStr):
        return "".join(_pattern(part, constants) for part in node.values)
    if isinstance(node, ast.FormattedValue):
        return _pattern(node.value, constants)
    return ".*"


def upward(modules: dict[str, Module]) -> list[str]:
    """Imports against the order of the rooms, or of the folders in a room; the package's own file may import all."""
    return [
        f"{module.name}:{found.line} imports {found.module}, which stands above it"
        for module in modules.values()
        for found in imports_of(module, modules)
        if found.module in modules and _stands_above(found.module, module.name)
    ]


def _stands_above(other: str, name: str) -> bool:
    here, there = room_of(name), room_of(other)
    if not {here, there} <= set(ROOMS):
        return False
    if here != there:
        return ROOMS.index(there) > ROOMS.index(here)
    return _place(other) > _place(name)


def _place(name: str) -> int:
    """Where a module comes in the order of its room."""
    order = SUBROOMS.get(room_of(name), [])
    part = [*name.split("."), ""][2]
    return order.index(part) if part in order else len(order)


def _is_text(node: ast.AST) -> bool:
    return isinstance(node, ast.Constant) and isinstance(node.value, str)


def _statements(body: list[ast.stmt], where: Where) -> Iterator[tuple[ast.stmt, Where]]:
    for node in body:
        if isinstance(node, ast.Import | ast.ImportFrom):
            yield node, where
            continue
        inside = where
        if isinstance(node, Function):
            inside = "function"
        elif isinstance(node, ast.If) and getattr(node.test, "id", "") == "TYPE_CHECKING":
            inside = "typing"
        for field in ("body", "orelse", "finalbody", "handlers", "cases"):
            below = getattr(node, field, [])
            inner = where if field == "orelse" and inside == "typing" else inside
            for part in below:
                yield from _statements([part] if isinstance(part, ast.stmt) else part.body, inner)


@cache
def modules_of(package: Path) -> dict[str, Module]:
    """Every file of a package by its full name; read once for all tests."""
    found = {}
    for path in sorted(package.rglob("*.py")):
        parts = path.relative_to(package.parent).with_suffix("").parts
        name = ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
        found[name] = Module(name, path, path.read_text(encoding="utf-8"))
    return found


def imports_of(module: Module, known: dict[str, Module]) -> list[Import]:
    """What a module imports; ``from package import module`` counts as the module."""
    found = []
    for node, where in module.statements:
        if isinstance(node, ast.Import):
            found += [Import(alias.name, node.lineno, where) for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            source = node.module or ""
            if node.level:
                parts = module.name.split(".")
                keep = len(parts) - node.level + (module.path.name == "__init__.py")
                source = ".".join([*parts[:keep], *([source] if source else [])])
            targets = {f"{source}.{alias.name}" for alias in node.names}
            inner = targets & known.keys()
            found += [Import(target, node.lineno, where) for target in sorted(inner)]
            found += [Import(source, node.lineno, where)] if targets - inner else []
    return found + list(_imports_by_name(module, known))


def _imports_by_name(module: Module, known: dict[str, Module]) -> Iterator[Import]:
    """What the strings of ``import_module`` name: every known module that fits, or the one library."""
    for line, pattern in module.named_imports:
        followed = not pattern.startswith(".*")
        fitting = [name for name in known if followed and name != module.name and re.fullmatch(pattern, name)]
        single = [re.sub(r"\\(.)", r"\1", pattern)] if ".*" not in pattern else []
        yield from (Import(name, line, "string") for name in fitting or single)


def circles(
    modules: dict[str, Module], kinds: tuple[Where, ...] = ("top", "typing", "function", "string")
) -> list[list[str]]:
    """Groups of modules that import each other in a circle (strongly connected components, Tarjan 1972).

    The package's own ``__init__`` is left out: for types it imports whoever has a public name, and runs none of it.
    So does a file of statements, for the type of the result that they are of.
    """
    inner = {name: module for name, module in modules.items() if "." in name}
    graph = {
        name: {
            i.module
            for i in imports_of(module, inner)
            if i.where in kinds and i.module in inner and not (i.where == "typing" and name.endswith(STATEMENTS))
        }
        - {name}
        for name, module in inner.items()
    }
    index: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    found: list[list[str]] = []

    def visit(name: str) -> None:
        index[name] = low[name] = len(index)
        stack.append(name)
        for other in sorted(graph[name]):
            if other not in index:
                visit(other)
            if other in stack:
                low[name] = min(low[name], low[other])
        if low[name] == index[name]:
            group = stack[stack.index(name) :]
            del stack[stack.index(name) :]
            if len(group) > 1:
                found.append(sorted(group))

    for name in graph:
        if name not in index:
            visit(name)
    return sorted(found)


def defined_twice(modules: dict[str, Module]) -> dict[str, list[str]]:
    """Names of classes that more than one module defines, with those modules."""
    homes = defaultdict(list)
    for module in modules.values():
        for node in module.classes():
            homes[node.name].append(module.name)
    return {name: where for name, where in sorted(homes.items()) if len(where) > 1}


def stems_twice(modules: dict[str, Module]) -> dict[str, list[str]]:
    """Names of files that stand in more than one room, with those rooms."""
    rooms = defaultdict(set)
    for module in modules.values():
        if not module.path.stem.startswith("__"):
            rooms[module.path.stem].add(module.room)
    return {stem: sorted(found) for stem, found in sorted(rooms.items()) if len(found) > 1}


def kinds_in(modules: dict[str, Module], folder: str) -> set[str]:
    """What ``kind: Literal[...]`` says in the classes below a package."""
    found = set()
    for module in modules.values():
        if not module.name.startswith(folder):
            continue
        for cls in module.classes():
            for node in cls.body:
                if isinstance(node, ast.AnnAssign) and ast.unparse(node.target) == "kind":
                    found |= {c.value for c in ast.walk(node.annotation) if _is_text(c)}  # type: ignore[attr-defined]
    return found


def body_lines(function: Function) -> int:
    """Lines of a function's body, its docstring left out; 0 where nothing else is in it."""
    body = function.body
    if isinstance(body[0], ast.Expr) and _is_text(body[0].value):
        body = body[1:]
    return (body[-1].end_lineno or 0) - body[0].lineno + 1 if body else 0
