"""The house in numbers: how much code there is, how it is cut, and what hangs on what.

    python -m benchmarks.house [ROOT] [--python PYTHON] [--against ROOT]

``ROOT`` is a checkout (this one by default); ``--against`` another, shown in a column before it. Every state is read
by the same rules. The two rows "modules loaded" run the package with ``PYTHON``; where that fails they stay empty.
"""

from __future__ import annotations

import argparse
import ast
import os
import re
import statistics
import subprocess
import sys
import tomllib
from collections import Counter, defaultdict
from collections.abc import Iterator
from pathlib import Path

from tests.helpers.source import (
    Module,
    Where,
    body_lines,
    circles,
    defined_twice,
    imports_of,
    kinds_in,
    modules_of,
    stems_twice,
    upward,
)

HERE = Path(__file__).parents[1]
EFFECTS = "posture_opt.model.effects"
SOURCE = re.compile(
    r"\b(1[89]|20)\d\d\b|\b(ISO|GUM|JCGM|NIST|IEC|DIN|doi|eq\.|data sheet|chapter|section)\b", re.IGNORECASE
)
HOME_MADE = {
    "mend": ("mend", "mends", "mended"),
    "tell": ("tell", "tells", "told"),
    "stands": ("stands",),
    "odds": ("odds",),
    "beside": ("beside",),
    "hang": ("hang", "hangs"),
    "fate, crew, mother and the like": (
        *("fate", "crew", "mother", "restless", "strewn", "landing", "mind", "minds", "heads", "senses"),
        *("weightiest", "surest"),
    ),
}
"""Words of this program's own, and such as a textbook has another word for, by what they are counted under."""
WORD = re.compile(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])")
SHARED_NAMES = 3  # files
SMALL_FILE = 60  # lines
RUN: tuple[Where, ...] = ("top", "function", "string")
LOADED = "import sys; {}; print(sum(m.split('.')[0] == 'posture_opt' for m in sys.modules))"
DIAGNOSE = (
    "import posture_opt as po; problem = po.load_problem('problems/insert_planar_2r_measured.yaml');"
    "po.diagnose(problem, po.read_measurements('problems/planar_2r_measured.csv', problem)).to_json()"
)


def numeric(node: ast.expr) -> bool:
    """Whether an expression is made of number literals alone, singly or in tuples, lists, dicts and sets."""
    if isinstance(node, ast.Constant):
        return isinstance(node.value, int | float | complex) and not isinstance(node.value, bool)
    if isinstance(node, ast.UnaryOp):
        return numeric(node.operand)
    if isinstance(node, ast.BinOp):
        return numeric(node.left) and numeric(node.right)
    if isinstance(node, ast.Tuple | ast.List | ast.Set):
        return bool(node.elts) and all(numeric(e) for e in node.elts)
    if isinstance(node, ast.Dict):
        return bool(node.values) and all(numeric(v) for v in node.values)
    return False


def constants(module: Module) -> Iterator[tuple[str, str]]:
    """Numeric constants of a module, each with the words beside it: a comment on or above it, a string below it."""
    for place, node in enumerate(module.tree.body):
        target = (
            node.targets[0]
            if isinstance(node, ast.Assign)
            else node.target
            if isinstance(node, ast.AnnAssign)
            else None
        )
        value = getattr(node, "value", None)
        if not isinstance(target, ast.Name) or value is None or not numeric(value):
            continue
        yield target.id, words_beside(module, place)


def words_beside(module: Module, place: int) -> str:
    """What stands beside the statement at a place of the module: comments on it and above it, the string below it."""
    body = module.tree.body
    node = body[place]
    last = node.end_lineno or node.lineno
    words = [line.partition("#")[2] for line in module.lines[node.lineno - 1 : last]]
    above = node.lineno - 2
    while above >= 0 and module.lines[above].lstrip().startswith("#"):
        words.append(module.lines[above].lstrip("# "))
        above -= 1
    below = body[place + 1] if place + 1 < len(body) else None
    if isinstance(below, ast.Expr) and isinstance(below.value, ast.Constant) and isinstance(below.value.value, str):
        words.append(below.value.value)
    return " ".join(w.strip() for w in words if w.strip())


def text_lines(module: Module) -> tuple[int, int]:
    """Lines of docstrings and lines of code (neither blank nor comment nor docstring)."""
    written: set[int] = set()
    for node in module.docstrings:
        written |= set(range(node.lineno, (node.end_lineno or node.lineno) + 1))
    code = [
        i
        for i, line in enumerate(module.lines, 1)
        if line.strip() and not line.lstrip().startswith("#") and i not in written
    ]
    return len(written), len(code)


def loaded(root: Path, python: str, code: str) -> str:
    """How many modules of the package a fresh process has loaded after some code."""
    known = os.environ | {"PYTHONPATH": str(root)}
    done = subprocess.run(
        [python, "-W", "ignore", "-c", LOADED.format(code)], capture_output=True, text=True, env=known, cwd=root
    )
    return done.stdout.strip() if done.returncode == 0 else ""


def measured(root: Path, python: str) -> dict[str, str]:
    """All figures of a checkout."""
    modules = modules_of(root / "posture_opt")
    return shape(modules) | ties(modules) | names(modules) | rooms(modules) | weight(root, python)


def shape(modules: dict[str, Module]) -> dict[str, str]:
    """Files, lines, bodies, constants and docstrings."""
    lengths = sorted(len(m.lines) for m in modules.values())
    bodies = sorted(n for m in modules.values() for n in map(body_lines, m.functions()) if n)
    found = {name: list(constants(m)) for name, m in modules.items()}
    beside = [words for each in found.values() for _, words in each]
    written, code = (sum(n) for n in zip(*map(text_lines, modules.values()), strict=True))
    return {
        "files": str(len(modules)),
        "lines": f"{sum(lengths)}",
        "lines of code": f"{code}",
        "lines a file, median / p90": spread(lengths),
        "lines of a function's body, median / p90": spread(bodies),
        "files with numeric constants of the module": str(sum(bool(each) for each in found.values())),
        "numeric constants of modules": str(len(beside)),
        "… with a reason beside them": str(sum(bool(words) for words in beside)),
        "… that name a source": str(sum(bool(SOURCE.search(words)) for words in beside)),
        "docstring lines for 100 of code": f"{100 * written / code:.1f}",
    }


def ties(modules: dict[str, Module]) -> dict[str, str]:
    """What hangs on what."""
    imports = [i for m in modules.values() for i in imports_of(m, modules) if i.module.startswith("posture_opt")]
    kinds = kinds_in(modules, EFFECTS)
    outside = {n: m for n, m in modules.items() if not n.startswith(EFFECTS)}
    named = {n: sum(node.value in kinds for node in m.strings()) for n, m in outside.items()}
    array = [n for n, m in modules.items() if re.search(r"^Array\b.* = ", m.text, re.MULTILINE)]
    files = sum(map(bool, named.values()))
    return {
        "imports of the package inside functions": str(sum(i.where == "function" for i in imports)),
        "… for types alone": str(sum(i.where == "typing" for i in imports)),
        "imports against the order of rooms": str(len(upward(modules))),
        "circles of imports (modules in them)": circle_text(circles(modules)),
        "… that run, strings of import_module followed": circle_text(circles(modules, RUN)),
        "names of classes defined twice": str(len(defined_twice(modules))),
        "names of files in two rooms": str(len(stems_twice(modules))),
        "files that define Array": str(len(array)),
        "kinds of effects as strings outside model/effects": f"{sum(named.values())} in {files} files",
    }


def names(modules: dict[str, Module]) -> dict[str, str]:
    """What things are called."""
    words = Counter(word.lower() for m in modules.values() for word in WORD.findall(m.text))
    home_made = {name: sum(words[word] for word in listed) for name, listed in HOME_MADE.items()}
    homes = defaultdict(set)
    for name, module in modules.items():
        for node in module.tree.body:
            for constant in constant_names(node):
                homes[constant].add(name)
    shared = {constant: len(files) for constant, files in homes.items() if len(files) >= SHARED_NAMES}
    functions = [f.name.strip("_") for m in modules.values() for f in m.functions() if not f.name.startswith("__")]
    single = sum("_" not in name for name in functions)
    return {
        "home-made words": str(sum(home_made.values())),
        **{f"… {name}": str(count) for name, count in home_made.items()},
        f"names of constants in {SHARED_NAMES} files or more": f"{len(shared)}",
        "… most files with one name": str(max(shared.values(), default=0)),
        "functions with a name of one word": f"{100 * single / len(functions):.0f} %",
    }


def constant_names(node: ast.stmt) -> Iterator[str]:
    """Names in capitals that a statement of a module assigns."""
    targets = node.targets if isinstance(node, ast.Assign) else [node.target] if isinstance(node, ast.AnnAssign) else []
    for target in targets:
        for part in target.elts if isinstance(target, ast.Tuple) else [target]:
            if isinstance(part, ast.Name) and part.id.isupper():
                yield part.id


def rooms(modules: dict[str, Module]) -> dict[str, str]:
    """How files are put together, and what types know."""
    folders = Counter(module.path.parent for module in modules.values())
    largest, size = folders.most_common(1)[0]
    importers = defaultdict(set)
    for name, module in modules.items():
        for found in imports_of(module, modules):
            if found.where != "string":
                importers[found.module].add(name)
    lonely = [
        len(modules[name].lines)
        for name, (one, *others) in importers.items()
        if name in modules and not others and modules[one].room == modules[name].room
        if "__init__.py" not in (modules[one].path.name, modules[name].path.name)
    ]
    nodes = [node for module in modules.values() for node in ast.walk(module.tree)]
    protocols = [node for node in nodes if isinstance(node, ast.ClassDef) and "Protocol" in map(base_name, node.bases)]
    return {
        "files of the largest folder": f"{size} ({largest.name})",
        "files with one importer, in their own room": str(len(lonely)),
        f"… of fewer than {SMALL_FILE} lines": str(sum(n < SMALL_FILE for n in lonely)),
        "Protocols": str(len(protocols)),
        "uses of Any": str(sum(isinstance(node, ast.Name) and node.id == "Any" for node in nodes)),
    }


def base_name(node: ast.expr) -> str:
    """``Protocol`` of ``Protocol[T]``."""
    return ast.unparse(node.value if isinstance(node, ast.Subscript) else node).split(".")[-1]


def weight(root: Path, python: str) -> dict[str, str]:
    """What a user loads and installs."""
    project = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    return {
        "modules loaded by the diagnosis": loaded(root, python, "import posture_opt.diagnosis.diagnose"),
        "modules loaded by a diagnosis that ran": loaded(root, python, DIAGNOSE),
        "direct dependencies": str(len(project["dependencies"])),
    }


def spread(values: list[int]) -> str:
    """Median and 90th percentile."""
    return f"{statistics.median(values):.0f} / {statistics.quantiles(values, n=10)[-1]:.0f}"


def circle_text(found: list[list[str]]) -> str:
    return f"{len(found)} ({sum(map(len, found))})"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("root", nargs="?", type=Path, default=HERE)
    parser.add_argument("--python", default=sys.executable)
    parser.add_argument("--against", type=Path)
    options = parser.parse_args()
    roots = [root.resolve() for root in (options.against, options.root) if root is not None]
    columns = [measured(root, options.python) for root in roots]
    widths = [max(map(len, column.values())) for column in columns]
    for name in columns[-1]:
        cells = [column[name].rjust(width) for column, width in zip(columns, widths, strict=True)]
        print(f"{name:<52}", *cells, sep="  ")


if __name__ == "__main__":
    main()
