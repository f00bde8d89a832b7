"""Names in docstrings: ``InputError`` and ``selection.solution.Solution`` both lead to the public name's page."""

from __future__ import annotations

from typing import Any

from docutils import nodes
from sphinx.util.nodes import make_refnode


def resolve(app: Any, env: Any, node: Any, contnode: nodes.Element) -> nodes.Element | None:
    """The documented object whose last name is the one that is asked for, where there is only one."""
    if node.get("refdomain") != "py":
        return None
    objects = env.domains["py"].objects
    last = node["reftarget"].rpartition(".")[2]
    found = {(o.docname, o.node_id) for name, o in objects.items() if name.rpartition(".")[2] == last}
    if len(found) == 1:
        docname, target = found.pop()
        return make_refnode(app.builder, node["refdoc"], docname, target, contnode)
    # `q` in a docstring is code that may or may not be a name of the package; a type or an exception is one.
    return contnode if node.get("reftype") == "obj" else None


def setup(app: Any) -> dict[str, bool]:
    app.connect("missing-reference", resolve)
    return {"parallel_read_safe": True}
