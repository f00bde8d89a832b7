"""One look of the figures of arms in space; those of every kind of result: ``tests/test_results.py``."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import posture_opt as po
from tests.helpers.figure_style import assert_style
from tests.helpers.shipped import PROBLEMS
from tests.helpers.variants import conformance


def _diagnosed() -> Any:
    problem = po.load_problem("insert_ur10_measured")
    return po.diagnose(problem, po.read_measurements(PROBLEMS / "ur10_measured.csv", problem))


RESULTS: dict[str, Callable[[], Any]] = {
    "in space": lambda: po.select_posture(po.load_problem("insert_panda")),
    "oblique": lambda: po.select_posture(po.load_problem("drill_ur5e")),
    "cloud": lambda: po.simulate(po.load_problem("insert_ur10_peg"), np.radians([0, -90, 90, -90, -90, 0]), n=500),
    "diagnosis": _diagnosed,
}


@pytest.mark.usefixtures("coarse")
@pytest.mark.parametrize("name", conformance(RESULTS, ["cloud"]))
def test_figures_have_one_look(name: str) -> None:
    figures = RESULTS[name]().figures()
    assert figures
    for title, figure in figures.items():
        assert_style(title, figure)
