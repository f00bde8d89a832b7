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

LONG = {
    *("solve-insert_panda_block", "solve-dispense_panda", "solve-insert_panda_cell", "solve-insert_iiwa14_tilt"),
    *("solve-weld_ur10", "solve-insert_ur10_plate", "solve-insert_ur10_cell", "diagnose-ur10", "calibrate-ur10"),
    *("solve-insert_ur10_peg", "solve-insert_ur10_extended", "solve-kuka_iiwa14_sockets", "diagnose-batch"),
    *("hidden-two-0", "hidden-kr16-0", "hidden-narrow-0"),
}
"""Searches of some seconds: they run by ``pytest -m conformance``."""


@pytest.mark.parametrize(
    ("name", "case"),
    [
        pytest.param(name, case, id=name, marks=pytest.mark.conformance if name in LONG else ())
        for name, case in quick()
    ],
)
def test_the_document_is_as_it_was(name: str, case: Case) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = document(name, case)
    old = json.loads((FOLDER / f"{name}.json").read_text(encoding="utf-8"))
    assert list(differences(old, found)) == []
