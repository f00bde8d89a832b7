"""Examples in docstrings: each shows what it states, and each public name has one."""

from __future__ import annotations

import doctest
import importlib
from pathlib import Path

import pytest

import posture_opt
from tests.helpers.source import modules_of

PACKAGE = Path(posture_opt.__file__).parent
WITH_EXAMPLES = sorted(name for name, module in modules_of(PACKAGE).items() if "    >>> " in module.text)


@pytest.mark.parametrize("name", WITH_EXAMPLES)
def test_examples_of_docstrings_print_what_they_show(name: str) -> None:
    module = importlib.import_module(name)
    found = doctest.testmod(module, optionflags=doctest.NORMALIZE_WHITESPACE | doctest.ELLIPSIS)
    assert found.attempted
    assert not found.failed
