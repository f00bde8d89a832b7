"""The frozen documents: nothing that the program answers changes unnoticed.

Decisions, names and counts are compared exactly, and every number at the precision that it has on any processor: see
`tests.golden.compare`.
"""

from __future__ import annotations

import json
import warnings

import pytest

from tests.golden.__main__ import FOLDER
from tests.golden.cases import Case, document, quick
from tests.golden.compare import differences

ALWAYS = {
    *("solve-insert_planar_2r", "solve-insert_scara_cell", "solve-weld_planar_2r", "calibrate-planar", "plan-planar"),
    *("map-panda", "hidden-clean-0"),
}
"""One document of a kind runs always; the others run by ``pytest -m conformance``."""


@pytest.mark.parametrize(
    ("name", "case"),
    [
        pytest.param(name, case, id=name, marks=() if name in ALWAYS else pytest.mark.conformance)
        for name, case in quick()
    ],
)
def test_the_document_is_as_it_was(name: str, case: Case) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = document(name, case)
    old = json.loads((FOLDER / f"{name}.json").read_text(encoding="utf-8"))
    assert list(differences(old, found)) == []
