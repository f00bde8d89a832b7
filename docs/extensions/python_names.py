"""The page of the Python API: all public names, in three tables, each name with a page made of its docstring."""

from __future__ import annotations

import inspect

import posture_opt
from posture_opt.result import Result

HEAD = """\
Python API
==========

.. currentmodule:: posture_opt

``import posture_opt as po`` has every name of this page. Inside everything is SI and radians.

"""
ERRORS = """
Errors
------

Every error is a :class:`~posture_opt.errors.PostureOptError`.

.. automodule:: posture_opt.errors
   :members:
   :show-inheritance:
"""
FACE = """
.. autoclass:: posture_opt.result.Result
   :members:
"""


def python_names_page() -> str:
    """Functions, results, other classes, errors; in reStructuredText, which autosummary reads."""
    found = {name: getattr(posture_opt, name) for name in posture_opt.__all__ if name != "__version__"}
    results = [name for name, value in found.items() if inspect.isclass(value) and issubclass(value, Result)]
    classes = [name for name, value in found.items() if inspect.isclass(value) and name not in results]
    functions = [name for name, value in found.items() if inspect.isfunction(value)]
    return "".join(
        [
            HEAD,
            table("Functions", functions, ""),
            table("Results", results, "Every result has the face of :class:`~posture_opt.result.Result`, below.\n"),
            table("Other classes", classes, ""),
            "\nThe face of every result\n------------------------\n",
            FACE,
            ERRORS,
        ]
    )


def table(title: str, names: list[str], text: str) -> str:
    listed = "\n".join(f"   {name}" for name in names)
    under = "-" * len(title)
    return f"{title}\n{under}\n\n{text}\n.. autosummary::\n   :toctree: api\n   :nosignatures:\n\n{listed}\n\n"
