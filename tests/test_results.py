"""Every result shows the same face: short text, small page, report, document, table, figures, files."""

from __future__ import annotations

import copy
import json
import pickle
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import posture_opt as po
from posture_opt.report.page.save import OWN_FILES
from posture_opt.result import Result
from tests.helpers.every_result import MADE
from tests.helpers.figure_style import assert_style
from tests.helpers.folders import names as names_in
from tests.helpers.report_words import assert_report


def test_every_result_is_public_and_tried_here() -> None:
    public = {name for name in po.__all__ if isinstance(kind := getattr(po, name), type) and issubclass(kind, Result)}
    kinds = Result.__subclasses__()
    final = {
        kind.__name__
        for kind in [*kinds, *(own for kind in kinds for own in kind.__subclasses__())]
        if not kind.__subclasses__()
    }
    assert public == final == {name.split()[0] for name in MADE}


@pytest.mark.parametrize(
    ("name", "today"),
    [("FeaturesSolution", "Solution"), ("PathSolution", "Solution"), ("ArmComparison", "Comparison")],
)
def test_former_names_are_those_of_today(name: str, today: str) -> None:
    with pytest.warns(DeprecationWarning, match=f"posture_opt.{name} is posture_opt.{today} now"):
        assert getattr(po, name) is getattr(po, today)
    assert name not in po.__all__


@pytest.mark.usefixtures("coarse")
@pytest.mark.parametrize("name", MADE)
def test_it_has_a_report_a_document_a_table_figures_and_files(name: str, tmp_path: Path) -> None:
    result = MADE[name]()
    assert type(result).__name__ == name.split()[0]
    document = result.to_json()
    assert json.loads(json.dumps(document, allow_nan=False)) == document
    for again in (pickle.loads(pickle.dumps(result)), copy.deepcopy(result)):
        assert again.to_json() == document
        assert again.summary() == result.summary()
    figures = result.figures()
    assert figures
    for title, figure in figures.items():
        assert figure.axes
        assert_style(title, figure)
    picture, _ = result.plot()._repr_png_()  # type: ignore[attr-defined] # what a notebook looks for
    assert picture.startswith(b"\x89PNG")
    paths = result.save(tmp_path / "out", figures=False)
    assert sorted(path.name for path in paths) == names_in(tmp_path / "out")
    assert all(path.stat().st_size for path in paths)
    assert {path.name for path in paths} <= OWN_FILES | {"plan.csv", "split_measurements.csv"}
    assert (tmp_path / "out" / "report.txt").read_text(encoding="utf-8") == result.report()
    assert_report(result)
    pytest.importorskip("pandas")
    assert len(result.to_dataframe().columns) >= 2
    assert len(result.to_dataframe()) > 0


def test_what_solves_again_and_again_pickles_too() -> None:
    problem = po.load_problem("insert_planar_2r_fixed_hole")
    selector, spread = po.PostureSelector(problem), po.SpreadFunction(problem)
    wanted, Q = selector.solve((1.2, 0.4, 0.0)), np.array([[0.1, 0.2], [0.3, -0.4]])
    with pytest.raises(po.errors.NoSolutionError) as refused:
        selector.solve((3.0, 0.0, 0.0))
    for copied in (lambda x: pickle.loads(pickle.dumps(x)), copy.deepcopy):
        again, refusal = copied(selector).solve((1.2, 0.4, 0.0)), copied(refused.value)
        assert again.posture == wanted.posture
        np.testing.assert_array_equal(copied(spread)(Q), spread(Q))
        assert str(refusal) == str(refused.value)
        assert refusal.solution.to_json()["posture"] == refused.value.solution.to_json()["posture"]


def test_threads_share_what_solves_and_get_what_one_gets() -> None:
    selector = po.PostureSelector(po.load_problem("insert_planar_2r_fixed_hole"))
    targets = [(x, 0.3, 0.0) for x in (0.4, 0.9, 1.4, 1.9, 2.4, 2.9)]  # the last are out of reach

    def answer(target: tuple[float, float, float]) -> str:
        try:
            return repr(selector.solve(target).posture)
        except po.errors.NoSolutionError as error:
            return str(error)

    with ThreadPoolExecutor(4) as pool:
        answers = list(pool.map(answer, [target for target in targets for _ in range(4)]))
    assert answers == [alone for target in targets for alone in [answer(target)] * 4]


@pytest.mark.parametrize(
    ("posture", "message"),
    [
        ("30 deg", "1 value given for 2 joints"),
        ("30 deg, 3 mm", "joint2: 'mm' is not a unit of angle"),
        ({"joint1": "30", "joint2": 0.0}, "joint1: the angle has no unit"),
    ],
)
def test_postures_with_units_are_read_or_refused(posture: Any, message: str) -> None:
    problem = po.load_problem("insert_planar_2r")
    by_name = po.propagate(problem, {"joint1": "30 deg", "joint2": -1.0})
    assert by_name.q == pytest.approx(po.propagate(problem, "30 deg, -1 rad").q, abs=0)
    with pytest.raises(po.errors.InputError, match=message):
        po.propagate(problem, posture)


def test_without_pandas_it_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(po.errors.InputError, match="needs the library pandas"):
        MADE["Spread"]().to_dataframe()


def test_a_folder_that_cannot_be_written_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("precious", encoding="utf-8")
    with pytest.raises(po.errors.InputError, match="cannot write to"):
        MADE["Spread"]().save(tmp_path / "file", figures=False)
    assert [path.name for path in tmp_path.iterdir()] == ["file"]
