"""Examples in docstrings: each prints what it shows, and public names of the model, data and spread have one."""

from __future__ import annotations

import doctest
import importlib
import inspect
import re
from pathlib import Path

import pytest

import posture_opt
from tests.helpers.source import modules_of

PACKAGE = Path(posture_opt.__file__).parent
WITH_EXAMPLES = sorted(name for name, module in modules_of(PACKAGE).items() if "    >>> " in module.text)
SHOWN = ("posture_opt.measurements", "posture_opt.model", "posture_opt.uncertainty")
"""Rooms whose public names all have an example."""


LONG = ("batch.batch_calibration", "batch.batch_diagnosis", "diagnosis.diagnose", "problem.fitted_problem")
EXAMPLES = [
    pytest.param(name, marks=pytest.mark.long) if name.removeprefix("posture_opt.") in LONG else name
    for name in WITH_EXAMPLES
]


@pytest.mark.parametrize("name", EXAMPLES)
def test_examples_of_docstrings_print_what_they_show(name: str) -> None:
    module = importlib.import_module(name)
    found = doctest.testmod(module, optionflags=doctest.NORMALIZE_WHITESPACE | doctest.ELLIPSIS)
    assert found.attempted
    assert not found.failed


def test_public_names_have_an_example() -> None:
    public = [getattr(posture_opt, name) for name in posture_opt.__all__]
    shown = [member for member in public if getattr(member, "__module__", "").startswith(SHOWN)]
    assert len(shown) >= 8
    assert [member.__name__ for member in shown if ">>> " not in member.__doc__] == []


def test_public_functions_have_an_example() -> None:
    functions = [getattr(posture_opt, name) for name in posture_opt.__all__]
    functions = [member for member in functions if inspect.isfunction(member)]
    assert len(functions) >= 20
    assert [member.__name__ for member in functions if ">>> " not in member.__doc__] == []


def test_public_classes_have_an_example_or_come_back_from_a_function_that_has() -> None:
    members = [getattr(posture_opt, name) for name in posture_opt.__all__]
    functions = [member for member in members if inspect.isfunction(member)]
    returned = {str(inspect.signature(function).return_annotation).removesuffix(" | None") for function in functions}
    classes = [member for member in members if inspect.isclass(member)]
    assert len(classes) >= 20
    bare = [member.__name__ for member in classes if ">>> " not in (member.__doc__ or "")]
    assert [name for name in bare if name not in returned] == []


def test_public_functions_state_what_comes_back() -> None:
    functions = [getattr(posture_opt, name) for name in posture_opt.__all__]
    functions = [member for member in functions if inspect.isfunction(member)]
    assert len(functions) >= 20
    for member in functions:
        returned = str(inspect.signature(member).return_annotation).removesuffix(" | None")
        stated = re.split("Raises:|Example:", member.__doc__.partition("Returns:")[2])[0]
        assert f"``{returned}``" in stated, f"{member.__name__} comes back with {returned}"
        kind = getattr(posture_opt, returned)
        known = {*dir(kind), *getattr(kind, "__dataclass_fields__", {}), *posture_opt.__all__}
        named = {*re.findall(r"``(\w+)(?:\(\w*\))?``", stated)} - {"None"}
        assert named <= known, f"{member.__name__}: {returned} has no {named - known}"
