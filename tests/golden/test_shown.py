"""What the check of the outputs that README and pages show lets pass, and what it does not."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import pytest

FILE = Path(__file__).parents[2] / ".ci" / "readme.py"


@pytest.fixture(scope="module")
def readme() -> ModuleType:
    spec = importlib.util.spec_from_file_location("shown_outputs", FILE)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize(
    ("shown", "printed"),
    [
        ("radius 0.461 mm", "radius  0.462\nmm"),
        ("7.99 ± 0.12 µrad", "8.00 ± 0.13 µrad"),
        ("agrees with the data (factor 0.420 to 2.50)", "agrees with the data (factor 0.425 to 2.54)"),
        ("p = 9e-06", "p = 1e-05"),
        ('"sigma_max": 0.00024784528640522946', '"sigma_max": 0.00024784528648'),
        ("----- --", "------- ---"),
    ],
)
def test_rounding_and_resampling_pass(readme: ModuleType, shown: str, printed: str) -> None:
    assert readme.alike(shown, printed)
    assert readme.alike(printed, shown)


@pytest.mark.parametrize(
    ("shown", "printed"),
    [
        ("radius 0.461 mm", "radius 0.463 mm"), ("7.99 ± 0.12 µrad", "7.99 ± 0.14 µrad"),
        ("agrees with the data (factor 0.420 to 2.50)", "agrees with the data (factor 0.420 to 2.58)"),
        ("found by 31 of 32 searches", "found by 30 of 32 searches"),
        ("elbow is compliant 1.0", "wrist is compliant 1.0"), ("p = 9e-06", "p = 9e-05"),
        ('"sigma_max": 0.00024784528640522946', '"sigma_max": 0.00024787'),
        ("-166.2 deg to 166.2 deg", "-166.2 deg to 168.2 deg"), ("0.0900", "-0.0900"),
    ],
)  # fmt: skip
def test_another_word_count_or_value_does_not(readme: ModuleType, shown: str, printed: str) -> None:
    assert not readme.alike(shown, printed)
    assert not readme.alike(printed, shown)
