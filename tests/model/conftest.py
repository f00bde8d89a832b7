"""Simulated arms for the tests of effects."""

from __future__ import annotations

from typing import Any

import pytest

from tests.helpers.effect_cases import robots


@pytest.fixture(scope="session")
def sites(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    return robots(tmp_path_factory.mktemp("arms"))
