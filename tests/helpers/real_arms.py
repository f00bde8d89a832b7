"""Measurements of real arms, which lie beside the repository where there are any, or where the environment says."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import pytest

DATA = Path(os.environ.get("POSTURE_OPT_REAL_ARMS") or Path(__file__).parents[3] / "shared" / "data")
needs_real_arms = pytest.mark.skipif(not DATA.is_dir(), reason=f"the measurements of real arms are not there: {DATA}")
Test = TypeVar("Test", bound=Callable[..., None])


def long_on_real_arms(test: Test) -> Test:
    """A test that needs seconds of processor time with these measurements: not in every run."""
    marked: Test = pytest.mark.real_arms(needs_real_arms(test))
    return marked
