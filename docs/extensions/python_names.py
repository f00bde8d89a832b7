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

"""
METHODS = """
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
            table("Results", results, "Every result has the methods of :class:`~posture_opt.result.Result`, below.\n"),
            table("Other classes", classes, ""),
            "\nMethods of every result\n-----------------------\n",
            METHODS,
            ERRORS,
            *(
                f".. autoclass:: posture_opt.errors.{name}\n   :members:\n   :show-inheritance:\n\n"
                for name in error_names()
            ),
        ]
    )


def error_names() -> list[str]:
    """The errors of the package and what they carry; not the functions that word them."""
    found = [name for name, value in vars(posture_opt.errors).items() if inspect.isclass(value)]
    return [name for name in found if name == "Issue" or issubclass(getattr(posture_opt.errors, name), Exception)]


def examples_of_results() -> dict[str, dict[str, str]]:
    """Class -> the function that returns it and that function's example, for classes without one of their own."""
    found: dict[str, dict[str, str]] = {}
    for name in posture_opt.__all__:
        value = getattr(posture_opt, name)
        if inspect.isfunction(value):
            returned = str(inspect.signature(value).return_annotation).removesuffix(" | None")
            shown = ">>> " in str(getattr(getattr(posture_opt, returned, None), "__doc__", ">>> "))
            if not shown and returned not in found:
                found[returned] = {"function": name, "example": example_of(value)}
    return found


def example_of(function: object) -> str:
    """The lines of the example in a docstring, each with the indentation of a page."""
    text = inspect.cleandoc(function.__doc__ or "").partition("Example:")[2]
    lines = [line.strip() for line in text.strip().splitlines()]
    return "\n".join(f"   {line}" for line in lines)


def table(title: str, names: list[str], text: str) -> str:
    listed = "\n".join(f"   {name}" for name in names)
    under = "-" * len(title)
    return f"{title}\n{under}\n\n{text}\n.. autosummary::\n   :toctree: api\n   :nosignatures:\n\n{listed}\n\n"
