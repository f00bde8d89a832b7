"""docs/lecture/lecture.md: its numbers are those of the package now, and those of formulas written by hand here."""

from __future__ import annotations

import importlib
import math
import re
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.helpers.planar_2r import exact, first_order

DOCS = Path(__file__).resolve().parents[2] / "docs" / "lecture"
DEG = math.pi / 180
NUMBER = re.compile(r"−?\d+\.\d+|−?\d+")

# problem file -> posture [deg], variances of (joint1.theta, joint2.theta, joint1.a, joint2.a)
EXAMPLES = {
    "lecture_folded_angles": ((90, -180), (DEG**2, DEG**2, 0, 0)),
    "lecture_folded_lengths": ((90, -180), (0, 0, 1e-4, 1e-4)),
    "lecture_folded_all": ((90, -180), (DEG**2, DEG**2, 1e-4, 1e-4)),
    "lecture_bent_equal_angles": ((90, -135), (DEG**2, DEG**2, 1e-4, 1e-4)),
    "lecture_bent_weak_elbow": ((90, -135), (DEG**2, 9 * DEG**2, 1e-4, 1e-4)),
}
# The lecture's print [m²]: C, eigenvalues, eigenvectors in rows.
PRINTED = {
    "lecture_folded_all": ([0.0003, -0.00001, 0.00022], [0.00019, 0.00030], [[0.074, -0.99], [-0.99, -0.074]]),
    "lecture_bent_equal_angles": ([0.00023, -0.00003, 0.00042], [0.00023, 0.00042], [[-0.98, 0.14], [0.14, 0.98]]),
    "lecture_bent_weak_elbow": ([0.00148, 0.00126, 0.00173], [0.00033, 0.0029], [[-0.74, 0.67], [0.67, 0.74]]),
}


@pytest.fixture(scope="module")
def document():
    return (DOCS / "lecture.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def lecture():
    sys.path.insert(0, str(DOCS))
    try:
        return importlib.import_module("make_lecture")
    finally:
        sys.path.remove(str(DOCS))


def value(text):
    return float(text.replace("−", "-"))


def rows(document, file):
    """First cell -> all cells, of the table that follows the line ``File `file.yaml```."""
    after = document[document.index(f"File `{file}.yaml`") :]
    lines = after[after.index("\n|") :].strip().split("\n\n")[0].splitlines()
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    return {cell[0]: cell for cell in cells}


@pytest.mark.long
def test_the_committed_document_is_what_the_package_computes_now(document, lecture):
    now = lecture.text()
    assert NUMBER.sub("#", now) == NUMBER.sub("#", document), "run: python docs/lecture/make_lecture.py"
    for new, old in zip(NUMBER.findall(now), NUMBER.findall(document), strict=True):
        # Another machine's mathematical library may round the last printed digit the other way, no more.
        digits = len(old.partition(".")[2])
        assert abs(value(new) - value(old)) < 1.5 * 10.0**-digits * (digits > 0) + 1e-12, f"{old} is now {new}"


@pytest.mark.parametrize("file", EXAMPLES)
def test_closed_forms_are_those_by_hand(document, file):
    degrees, variances = EXAMPLES[file]
    q, Sigma, table = np.radians(degrees), np.diag(variances), rows(document, file)
    first = 2 if file in PRINTED else 1
    for column, C in ((first, first_order(q, Sigma)), (first + 1, exact(q, Sigma))):
        values, vectors = np.linalg.eigh(C)
        wanted = {"Cxx": C[0, 0], "Cxy": C[0, 1], "Cyy": C[1, 1]}
        wanted |= {"smaller eigenvalue": values[0], "larger eigenvalue": values[1]}
        for name, number in wanted.items():
            # four decimals in 1e-4 m²
            assert value(table[name][column]) == pytest.approx(number * 1e4, abs=0.6e-4), (name, column)
        for name, v in (("its vector (minor axis)", vectors[:, 0]), ("its vector (major axis)", vectors[:, 1])):
            shown = [value(x) for x in NUMBER.findall(table[name][column])]
            assert abs(np.dot(shown, v)) == pytest.approx(1, abs=1e-3)


@pytest.mark.parametrize("file", PRINTED)
def test_printed_numbers_are_the_lectures(document, file):
    entries, eigenvalues, vectors = PRINTED[file]
    table = rows(document, file)
    names = ("Cxx", "Cxy", "Cyy", "smaller eigenvalue", "larger eigenvalue")
    for name, printed in zip(names, (*entries, *eigenvalues), strict=True):
        assert value(table[name][1]) == pytest.approx(printed * 1e4, abs=1e-9)
    for name, v in zip(("its vector (minor axis)", "its vector (major axis)"), vectors, strict=True):
        assert [value(x) for x in NUMBER.findall(table[name][1])] == pytest.approx(v, abs=0.0051)
