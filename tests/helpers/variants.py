"""Variants of one behaviour: a few run always, all of them by ``pytest -m conformance``."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from typing import Any

import pytest

from posture_opt.model.toolchain import find_compiler

__all__ = ["STRUCTURES", "conformance", "find_compiler", "needs_compiler"]

needs_compiler = pytest.mark.skipif(not find_compiler(), reason="no C compiler on this machine")

STRUCTURES = (
    "planar_2r", "scara", "ur5", "ur10", "irb120", "puma560", "kr6_r900", "crb15000", "panda", "iiwa14", "gen3",
)  # fmt: skip
"""Presets of every kinematic structure: in a plane, with a slide, three parallel axes, spherical wrist with its
offsets, turned first frame, offset wrist, redundant. Another preset of the same structure differs in numbers, which
tests of their own hold."""


def conformance(variants: Iterable[Any], always: Collection[Any]) -> list[Any]:
    """Values for ``pytest.mark.parametrize``: those that are not among ``always`` get the marker ``conformance``.

    A variant that is a tuple stands for several arguments.
    """
    listed = list(variants)
    unknown = [value for value in always if value not in listed]
    assert not unknown, f"{unknown} are no variants"
    return [value if value in always else _marked(value) for value in listed]


def _marked(value: Any) -> Any:
    values = value if isinstance(value, tuple) else (value,)
    return pytest.param(*values, marks=pytest.mark.conformance)
