"""Measurements of real arms, which lie beside the repository where there are any."""

from __future__ import annotations

from pathlib import Path

import pytest

DATA = Path(__file__).parents[3] / "shared" / "data"
needs_real_arms = pytest.mark.skipif(not DATA.is_dir(), reason=f"the measurements of real arms are not there: {DATA}")
