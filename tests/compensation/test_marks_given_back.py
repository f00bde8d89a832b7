"""``compensated.csv`` has the separators, decimal marks and units of the targets; ``[Grad]`` is degrees."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

import posture_opt as po
from tests.helpers.command_line import invoke

ARM = "insert_planar_2r_calibrated"
ROWS = (("50.5", "-40.25", "1200.5", "300.25"), ("45.5", "-30.75", "1250.5", "350.75"))
HEADERS = ("joint1 [{}]", "joint2 [{}]", "x [mm]", "y [mm]")


def compensated(folder: Path, separator: str, decimal: str, degree: str, encoding: str = "utf-8") -> list[list[str]]:
    """The cells of ``compensated.csv`` for targets in these marks."""
    rows = [[header.format(degree) for header in HEADERS], *([v.replace(".", decimal) for v in row] for row in ROWS)]
    if separator == decimal:
        rows[1:] = [[f'"{cell}"' for cell in row] for row in rows[1:]]
    path = folder / "targets.csv"
    path.write_text("".join(separator.join(row) + "\n" for row in rows), encoding=encoding)
    answer = invoke("compensate", path, "--problem", ARM, "--out", folder / "out", "--no-plots")
    assert answer.exit_code == 0, answer.output
    text = (folder / "out" / "compensated.csv").read_text(encoding="utf-8")
    return list(csv.reader(text.splitlines(), delimiter=separator))


def numbers(rows: list[list[str]], decimal: str) -> np.ndarray:
    assert all("." not in cell for row in rows for cell in row) or decimal == "."
    return np.array([[float(cell.replace(decimal, ".")) for cell in row] for row in rows])


@pytest.mark.parametrize(("separator", "decimal"), [(";", ","), ("\t", ","), (";", "."), ("\t", "."), (",", ",")])
def test_separators_and_decimal_marks_come_back(tmp_path: Path, separator: str, decimal: str) -> None:
    plain, other = tmp_path / "plain", tmp_path / "other"
    plain.mkdir(), other.mkdir()
    expected = compensated(plain, ",", ".", "deg")
    found = compensated(other, separator, decimal, "deg")
    assert found[0] == expected[0]
    np.testing.assert_array_equal(numbers(found[1:], decimal), numbers(expected[1:], "."))


@pytest.mark.parametrize("degree", ["Grad", "Grd", "°", "º"])
def test_degrees_in_other_words_are_degrees_and_come_back(tmp_path: Path, degree: str) -> None:
    found = compensated(tmp_path, ";", ",", degree)
    assert found[0][:2] == [f"joint1 [{degree}]", f"joint2 [{degree}]"]
    inside = np.radians(numbers(found[1:], ",")[:, :2])
    problem = po.load_problem(ARM)
    wanted = [[float(x) / 1e3 for x in row[2:]] for row in ROWS]
    np.testing.assert_allclose([problem.arm.position(q)[:2] for q in inside], wanted, atol=2e-4)
    assert po.problem_from_dict({
        "robot": {"kind": "preset", "name": "planar_2r"}, "uncertainty": {"sigma": {"joint1.theta": f"2 {degree}"}}
    }).sources.sigma[0] == pytest.approx(np.radians(2))  # fmt: skip


def test_a_degree_sign_in_latin_1_is_read(tmp_path: Path) -> None:
    assert compensated(tmp_path, ";", ",", "°", "latin-1")[0][0] == "joint1 [°]"
