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
CLOSING = np.diag([DEG**2, 9 * DEG**2, 1e-4, 1e-4])


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


@pytest.mark.parametrize("file", EXAMPLES)
def test_clouds_scatter_about_the_exact_values_as_their_intervals_say(document, file):
    degrees, variances = EXAMPLES[file]
    C, table = exact(np.radians(degrees), np.diag(variances)), rows(document, file)
    for name, number in {"Cxx": C[0, 0], "Cxy": C[0, 1], "Cyy": C[1, 1]}.items():
        for cell in table[name][-2:]:
            shown, low, high = (value(x) for x in NUMBER.findall(cell)[:3])
            # Five standard errors; the interval is 2 x 1.96 of them, and all are rounded to the digits shown.
            rounding = 10.0 ** -len(NUMBER.findall(cell)[0].partition(".")[2])
            assert abs(shown - number * 1e4) <= 5 * (high - low) / 3.92 + rounding, (name, cell)


@pytest.mark.parametrize("file", PRINTED)
def test_printed_numbers_are_the_lectures(document, file):
    entries, eigenvalues, vectors = PRINTED[file]
    table = rows(document, file)
    names = ("Cxx", "Cxy", "Cyy", "smaller eigenvalue", "larger eigenvalue")
    for name, printed in zip(names, (*entries, *eigenvalues), strict=True):
        assert value(table[name][1]) == pytest.approx(printed * 1e4, abs=1e-9)
    for name, v in zip(("its vector (minor axis)", "its vector (major axis)"), vectors, strict=True):
        assert [value(x) for x in NUMBER.findall(table[name][1])] == pytest.approx(v, abs=0.0051)


def test_contradictions_of_the_print(document):
    after = document[document.index("## Printed numbers that contradict each other") :]
    lines = [line for line in after.splitlines() if line.startswith("| ") and "1°:" not in line][2:5]
    for line, (entries, eigenvalues, vectors) in zip(lines, PRINTED.values(), strict=True):
        xx, xy, yy = entries
        mean, half = (xx + yy) / 2, math.hypot((xx - yy) / 2, xy)
        rebuilt = sum(w * v[0] * v[1] / (v[0] ** 2 + v[1] ** 2) for w, v in zip(eigenvalues, vectors, strict=True))
        wanted = [mean - half, mean + half, *eigenvalues, xy, rebuilt]
        shown = [value(x) for x in NUMBER.findall(line.split("|", 2)[2])][:6]
        # two decimals in 1e-4 m²
        assert shown == pytest.approx(np.array(wanted) * 1e4, abs=0.006)


def test_chance_of_printed_entries_against_simulated_clouds(lecture):
    C = exact(np.radians((90, -135)), np.diag(EXAMPLES["lecture_bent_equal_angles"][1]))
    rng = np.random.default_rng(0)
    clouds = rng.multivariate_normal([0, 0], C, size=(20_000, 50))
    centred = clouds - clouds.mean(axis=1, keepdims=True)
    samples = np.einsum("cni,cnj->cij", centred, centred) / 49
    for entry, printed in (((0, 0), 2.3e-4), ((0, 1), -3e-5), ((1, 1), 4.2e-4)):
        chance, drawn = lecture.Chance(C, entry, 50), samples[:, *entry]
        for p in (0.025, 0.5, 0.975):
            # four binomial standard errors of 20 000 clouds: sqrt(p (1 - p) / 20000)
            assert np.mean(drawn <= chance.quantile(p)) == pytest.approx(p, abs=4 * math.sqrt(p * (1 - p) / 20_000))
        if printed < C[entry] - 0.5e-5:
            shown = 2 * np.mean(drawn <= printed + 0.5e-5)
            assert chance.as_far_as(printed) == pytest.approx(shown, abs=8 * math.sqrt(0.25 / 20_000))


def test_sigmas_that_hold_95_percent(document):
    assert f"k = 2 holds {100 * (1 - math.exp(-2)):.1f} %" in document
    assert f"95 % need k = √(−2 ln 0.05) = {math.sqrt(-2 * math.log(0.05)):.3f}" in document
    assert f"±2σ hold {100 * math.erf(math.sqrt(2)):.2f} %" in document


def test_closing_question_against_a_fine_grid(document):
    t1, t2 = np.meshgrid(np.radians(np.arange(-180, 180, 1.0)), np.radians(np.arange(-180, 180, 1.0)))
    sigma = np.sqrt(exact(np.stack([t1, t2], axis=-1), CLOSING)[..., 0, 0])
    best = {shape: math.sqrt(exact(np.radians(q), CLOSING)[0, 0]) for shape, q in
            {"folded": (0, 180), "stretched": (0, 0)}.items()}  # fmt: skip
    # The grid holds the answer, and nothing on it is better.
    assert sigma.min() == pytest.approx(best["folded"], rel=1e-9)
    assert best["folded"] < best["stretched"]
    for shape, number in best.items():
        assert f"| {shape}, horizontal |" in document
        line = next(line for line in document.splitlines() if line.startswith(f"| {shape}, horizontal"))
        assert f"| {1e3 * math.sqrt(2e-4):.3f} | {1e3 * number:.3f} |" in line
    assert f"the median of σx is {1e3 * np.median(sigma):.1f} mm, the worst {1e3 * sigma.max():.1f} mm" in document


def test_horizontal_links_are_best_up_to_the_stated_length_error(document):
    limit = value(re.search(r"as long as σa is below ([\d.]+) mm", document)[1]) * 1e-3
    t1, t2 = np.meshgrid(np.radians(np.arange(-180, 180, 2.0)), np.radians(np.arange(-180, 180, 2.0)))
    for sigma_a, best in ((limit - 1e-4, True), (limit + 1e-4, False)):
        Sigma = np.diag([DEG**2, 9 * DEG**2, sigma_a**2, sigma_a**2])
        least = first_order(np.stack([t1, t2], axis=-1), Sigma)[..., 0, 0].min()
        assert bool(least > 2 * sigma_a**2 * (1 - 1e-9)) == best


def test_the_flat_ellipse_is_false(document):
    after = document[document.index("**Beware of the flat ellipse.**") :]
    for shape, q in (("folded", (0, 180)), ("stretched", (0, 0))):
        Sigma = np.diag([DEG**2, 9 * DEG**2, 0, 0])
        line = next(line for line in after.splitlines() if line.startswith(f"| {shape}"))
        assert first_order(np.radians(q), Sigma)[0, 0] < 1e-30
        assert f"| 0.000 | {1e3 * math.sqrt(exact(np.radians(q), Sigma)[0, 0]):.3f} |" in line


def test_correlated_lengths(document):
    Sigma = np.array([[0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 1e-4, 0.8e-4], [0, 0, 0.8e-4, 1e-4]])
    for name, q in (("folded (90°, −180°)", (90, -180)), ("stretched (90°, 0°)", (90, 0))):
        Cyy = first_order(np.radians(q), Sigma)[1, 1]
        assert f"| {name} | {Cyy * 1e4:.4f} | {math.sqrt(Cyy) * 1e3:.3f} |" in document
