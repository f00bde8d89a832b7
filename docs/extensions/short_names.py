"""Names in docstrings: ``InputError`` and ``selection.solution.Solution`` both lead to the public name's page."""

from __future__ import annotations

import pkgutil
import re
from functools import cache
from importlib import import_module
from typing import Any

from docutils import nodes
from sphinx.util.nodes import make_refnode

import posture_opt


def resolve(app: Any, env: Any, node: Any, contnode: nodes.Element) -> nodes.Element | None:
    """The documented object whose last name is the one that is asked for, where there is only one.

    What the package has and this site does not document is left as plain code; what it does not have is a warning.
    """
    if node.get("refdomain") != "py":
        return None
    target = node["reftarget"]
    last = target.rpartition(".")[2]
    objects = env.domains["py"].objects
    found = {(o.docname, o.node_id) for name, o in objects.items() if name.rpartition(".")[2] == last}
    if len(found) == 1:
        docname, place = found.pop()
        return make_refnode(app.builder, node["refdoc"], docname, place, contnode)
    # `q` in a docstring is code that may or may not be a name of the package; a type or an exception is one.
    return contnode if node.get("reftype") == "obj" or exists(target) else None


@cache
def exists(target: str) -> bool:
    """Whether some module of the package knows this name, or this attribute of a name."""
    first, *rest = target.split(".")
    found = [vars(module)[first] for module in modules() if first in vars(module)]
    return bool(found) and (not rest or any(hasattr(value, rest[0]) for value in found))


@cache
def modules() -> tuple[Any, ...]:
    names = [m.name for m in pkgutil.walk_packages(posture_opt.__path__, "posture_opt.") if "__main__" not in m.name]
    return tuple(import_module(name) for name in names)


def keep_colons(app: Any, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """Napoleon takes what is before a colon in an attribute's first line for its type: give it an empty comment."""
    if what in ("attribute", "property", "data"):
        lines[:0] = ["..", ""]


def plain_types(app: Any, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """Arrays without the type of their entries; no types of a section of the problem file, which a reader makes."""
    types = app.env.current_document.autodoc_annotations.get(name, {})
    if what == "class" and hasattr(obj, "model_fields"):
        types.clear()
    for parameter, text in types.items():
        types[parameter] = re.sub(r"numpy\.ndarray\[tuple\[.*?\], ~?numpy\.dtype\[.*?\]\]", "numpy.ndarray", text)


def setup(app: Any) -> dict[str, bool]:
    app.connect("missing-reference", resolve)
    app.connect("autodoc-process-docstring", keep_colons, priority=100)
    app.connect("autodoc-process-docstring", plain_types)
    return {"parallel_read_safe": True}
