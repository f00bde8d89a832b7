"""One look of all figures, measured as they are rendered: one width, one type size, nothing cut off, told in grey."""

from __future__ import annotations

from collections.abc import Callable
from itertools import combinations
from typing import Any

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.text import Text

import posture_opt as po
from posture_opt.report.page.style import FONT, WIDTH
from posture_opt.report.scene import shaded_picture
from tests.helpers.shipped import PROBLEMS
from tests.helpers.variants import conformance

_TELLS = 0.15  # of the way from black to white: what grey print tells apart
_SLACK = 0.03  # inch: half a line or mark beyond its axes


def _rows(problem: Any, file: str) -> Any:
    return po.read_measurements(PROBLEMS / file, problem)


def _calibrated() -> Any:
    problem = po.load_problem("insert_planar_2r_measured")
    return po.calibrate(problem, _rows(problem, "planar_2r_measured.csv"))


def _diagnosed() -> Any:
    problem = po.load_problem("insert_ur10_measured")
    return po.diagnose(problem, _rows(problem, "ur10_measured.csv"))


def _batch() -> Any:
    problem = po.load_problem("insert_planar_2r_measured")
    return po.calibrate_batch(problem, _rows(problem, "planar_2r_batch.csv"))


RESULTS: dict[str, Callable[[], Any]] = {
    "planar": lambda: po.select_posture(po.load_problem("insert_planar_2r")),
    "in space": lambda: po.select_posture(po.load_problem("insert_panda")),
    "oblique": lambda: po.select_posture(po.load_problem("drill_ur5e")),
    "path": lambda: po.select_posture(po.load_problem("trace_scara")),
    "features": lambda: po.select_posture(po.load_problem("insert_scara_tray")),
    "spread": lambda: po.propagate(po.load_problem("insert_planar_2r"), np.radians([90, -180])),
    "cloud": lambda: po.simulate(po.load_problem("insert_ur10_peg"), np.radians([0, -90, 90, -90, -90, 0]), n=500),
    "map": lambda: po.map_targets(po.load_problem("insert_planar_2r"), counts=(5, 5)),
    "accuracy": lambda: po.map_accuracy(po.load_problem("insert_planar_2r_calibrated"), counts=(4, 4)),
    "calibration": _calibrated,
    "diagnosis": _diagnosed,
    "batch": _batch,
    "plan": lambda: po.plan_measurements(po.load_problem("insert_planar_2r_measured"), 8),
}


ALWAYS = ["planar", "in space", "map", "features", "accuracy", "calibration"]


@pytest.fixture(scope="module", params=conformance(RESULTS, ALWAYS))
def figures(request: pytest.FixtureRequest) -> dict[str, Figure]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(shaded_picture, "DPI", 40)  # the grain of the shaded arm changes no text
        drawn = RESULTS[request.param]().figures()
    assert drawn
    return drawn


def test_nothing_is_set_as_a_formula(figures: dict[str, Figure]) -> None:
    """Not even the numbers of a logarithmic axis: texts are drawn as they are written, and so would be their marks."""
    told = {text.get_text() for figure in figures.values() for text in figure.findobj(Text)}
    assert not [text for text in told if "$" in text]


def _texts(figure: Figure) -> list[Text]:
    return [t for t in figure.findobj(Text) if isinstance(t, Text) and t.get_visible() and t.get_text().strip()]


def test_every_text_has_one_size_and_every_figure_one_width(figures: dict[str, Figure]) -> None:
    for name, figure in figures.items():
        assert figure.get_size_inches()[0] == WIDTH, name
        assert {t.get_fontsize() for t in _texts(figure)} == {FONT}, name


def test_nothing_is_cut_off(figures: dict[str, Figure]) -> None:
    for name, figure in figures.items():
        box, (width, height) = figure.get_tightbbox(), figure.get_size_inches()
        assert min(box.x0, box.y0, width - box.x1, height - box.y1) > -_SLACK, (name, box)


def test_lines_of_one_legend_are_told_apart_in_grey(figures: dict[str, Figure]) -> None:
    for name, figure in figures.items():
        handles = [h for legend in figure.legends for h in legend.legend_handles if isinstance(h, Line2D)]
        for a, b in combinations(handles, 2):
            same = _shape(a) == _shape(b) and abs(_grey(a) - _grey(b)) < _TELLS
            assert not same, (name, a.get_color(), b.get_color(), _shape(a))


def _shape(line: Line2D) -> tuple[Any, ...]:
    dashes = getattr(line, "_dash_pattern", None)
    return str(line.get_linestyle()), str(dashes), str(line.get_marker()), str(line.get_markerfacecolor()) == "none"


def _grey(line: Line2D) -> float:
    return float(np.dot(to_rgb(line.get_color()), (0.299, 0.587, 0.114)))
