"""Files as instruments write them: separators, decimal commas, comments, encodings, foreign heads, orientations.

Layouts: Motive's CSV (docs.optitrack.com, "Data Export: CSV"), ur_rtde's recordings (a header and rows between
blanks), NumPy's ``savetxt``, and what a spreadsheet of a German or Swiss desktop saves.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import posture_opt as po
from tests.helpers.simulated_arm import SIX, SimulatedArm

NAMES = ("j1", "j2", "j3", "j4", "j5", "j6")
ROBOT = SimulatedArm(SIX).section(("-360 deg", "360 deg"), base="free", tool="free")
ROWS = 16
Q = np.random.default_rng(1).uniform(-2, 2, (ROWS, 6)).round(4)  # rad


def problem_with(**data: Any) -> po.Problem:
    return po.problem_from_dict({"robot": ROBOT, **({"data": data} if data else {})})


POSES = SimulatedArm(SIX).poses(Q)
POINTS, ROTATIONS = POSES[:, :3, 3].round(6), POSES[:, :3, :3]
PLAIN = ", ".join([*(f"{name} [rad]" for name in NAMES), "x [mm]", "y [mm]", "z [mm]"])
NUMBERS = np.column_stack([Q, POINTS * 1e3])


def rows(separator: str, write: Callable[[float], str] = repr, numbers: np.ndarray = NUMBERS) -> str:
    return "".join(separator.join(write(float(value)) for value in row) + "\n" for row in numbers)


def german(value: float) -> str:
    return f"{value:.7f}".replace(".", ",")


def read(tmp_path: Path, text: str | bytes, **data: Any) -> po.Measurements:
    file = tmp_path / "data.txt"
    file.write_bytes(text if isinstance(text, bytes) else text.encode())
    return po.read_measurements(file, problem_with(**data))


def as_plain(found: po.Measurements) -> None:
    np.testing.assert_allclose(found.q, Q, atol=1e-9)
    np.testing.assert_allclose(found.position, POINTS, atol=1e-9)


HEAD = PLAIN.split(", ")
TEXTS: dict[str, str | bytes] = {
    "commas": PLAIN + "\n" + rows(","),
    "semicolons": ";".join(HEAD) + "\n" + rows(";"),
    "semicolons at the ends of lines": ";".join(HEAD) + ";\n" + rows(";").replace("\n", ";\n"),
    "tabs": "\t".join(HEAD) + "\n" + rows("\t"),
    "blanks": "  ".join(HEAD) + "\n" + rows("  "),
    "decimal commas": ";".join(HEAD) + "\n" + rows(";", german),
    "decimal commas and tabs": "\t".join(HEAD) + "\n" + rows("\t", german),
    "decimal commas in quotes": PLAIN + "\n" + rows(",", lambda v: f'"{german(v)}"'),
    "thousands of a spreadsheet": PLAIN + "\n" + rows(",", lambda v: f'"{v:,.7f}"'),
    "thousands, German": ";".join(HEAD) + "\n" + rows(";", lambda v: f"{v:,.7f}".translate(str.maketrans(",.", ".,"))),
    "thousands, Swiss": ";".join(HEAD) + "\n" + rows(";", lambda v: f"{v:,.7f}".replace(",", "'")),
    "comments and blank lines": "# laser tracker 12\n%\n\n// J. Doe\n"
    + PLAIN
    + "\n\n# warm-up\n"
    + rows(",")
    + "# end\n",
    "lines before the header": "Job;Cell 4\nInstrument;AT960\n\n" + ";".join(HEAD) + "\n" + rows(";"),
    "a header as a comment": "# " + PLAIN + "\n" + rows(","),
    "a row of units": ";".join((*NAMES, "x", "y", "z")) + "\n" + ";".join(["rad"] * 6 + ["mm"] * 3) + "\n" + rows(";"),
    "quotes": ",".join(f'"{head}"' for head in HEAD) + "\n" + rows(",", lambda v: f'"{v!r}"'),
    "a byte order mark": ("\ufeff" + PLAIN + "\n" + rows(",")).encode("utf-8"),
    "UTF-16": (PLAIN + "\n" + rows(",")).encode("utf-16"),
    "UTF-16 without its mark": (PLAIN + "\n" + rows(",")).encode("utf-16-le"),
    "Windows line ends": (PLAIN + "\n" + rows(",")).replace("\n", "\r\n"),
    "a comment in Latin-1": ("# Gerät 7\n" + PLAIN + "\n" + rows(",")).encode("latin-1"),
}


@pytest.mark.parametrize("case", TEXTS)
def test_however_a_table_is_written_it_is_the_same_table(case: str, tmp_path: Path) -> None:
    found = read(tmp_path, TEXTS[case])
    as_plain(found)
    if case == "lines before the header":
        assert any("2 lines before the header were skipped" in note for note in found.notes)
    if case == "a comment in Latin-1":
        assert any("read as Windows-1252" in note for note in found.notes)


def test_heads_of_an_instrument_are_told_by_the_problem_file(tmp_path: Path) -> None:
    heads = [*(f"A{k} (rad)" for k in range(1, 7)), "Pos X [mm]", "Pos Y [mm]", "Pos Z [mm]", "RMS [mm]", "Operator"]
    lines = rows(";").replace("\n", ";0.01;M. Rossi\n")
    columns = {name: f"A{k + 1}" for k, name in enumerate(NAMES)}
    columns |= {"x": "Pos X [mm]", "y": "Pos Y", "z": 9}
    found = read(tmp_path, ";".join(heads) + "\n" + lines, columns=columns)
    as_plain(found)
    assert found.notes == ("columns of the file that are not used: RMS, Operator",)


def test_a_file_without_a_header_is_told_by_numbers(tmp_path: Path) -> None:
    columns = {name: k + 1 for k, name in enumerate((*NAMES, "x", "y", "z"))}
    units = {**dict.fromkeys(NAMES, "rad"), **dict.fromkeys("xyz", "mm")}
    as_plain(read(tmp_path, rows(" "), columns=columns, units=units))
    with pytest.raises(po.errors.InputError, match=r"no unit in j1, j2, .* data: \{units: \{j1: deg, j2: deg"):
        read(tmp_path, rows(" "), columns=columns)


TURNED = Rotation.from_matrix(ROTATIONS)
QUATERNIONS = TURNED.as_quat(canonical=True, scalar_first=True)
ORIENTATIONS = {
    "quaternion": ("qw, qx, qy, qz", QUATERNIONS),
    "the other sign": ("qw, qx, qy, qz", -QUATERNIONS),
    "rotation vector": ("rx [rad], ry [rad], rz [rad]", TURNED.as_rotvec()),
    "angles": ("roll [deg], pitch [deg], yaw [deg]", TURNED.as_euler("xyz", degrees=True)),
}


@pytest.mark.parametrize("case", ORIENTATIONS)
def test_orientations_are_those_of_the_nominal_arm(case: str, tmp_path: Path) -> None:
    heads, values = ORIENTATIONS[case]
    found = read(tmp_path, f"{PLAIN}, {heads}\n" + rows(",", numbers=np.column_stack([NUMBERS, values])))
    assert found.rotation is not None
    np.testing.assert_allclose(found.rotation, QUATERNIONS, atol=1e-9)


@pytest.mark.parametrize(
    ("heads", "values", "told"),
    [
        ("rx [deg], ry [deg], rz [deg]", (10, 20, 30), "rx, ry, rz in degrees: a rotation vector is in rad"),
        ("rx [rad], ry [rad], rz [rad]", (10, 20, 30), "a length of 37.42 rad, more than a turn"),
        ("roll [rad], pitch [rad], yaw [rad]", (10, 20, 30), "roll: 10 rad is more than a turn"),
        ("roll [deg], pitch [deg]", (1, 2), "roll: the orientation lacks yaw"),
        (
            "qw, qx, qy, qz, roll [deg], pitch [deg], yaw [deg]",
            (1, 0, 0, 0, 0, 0, 0),
            "the orientation is stated twice",
        ),
    ],
)
def test_orientations_that_may_mean_two_things_are_refused(
    heads: str, values: tuple[float, ...], told: str, tmp_path: Path
) -> None:
    numbers = np.column_stack([NUMBERS, np.tile(values, (ROWS, 1))])
    with pytest.raises(po.errors.InputError, match=told):
        read(tmp_path, f"{PLAIN}, {heads}\n" + rows(",", numbers=numbers))


def test_a_motive_export_is_read_by_the_numbers_of_its_columns(tmp_path: Path) -> None:
    """Eight lines before the rows, heads X, Y, Z twice, and the commanded joints appended as columns."""
    w, x, y, z = QUATERNIONS.T
    numbers = np.column_stack([np.arange(ROWS), np.arange(ROWS) / 120, x, y, z, w, POINTS, Q])
    text = (
        "Format Version,1.23,Take Name,Take 1,Export Frame Rate,120.000000,Rotation Type,Quaternion,"
        "Length Units,Meters,Coordinate Space,Global\n\n,Type"
        + ",Rigid Body" * 7
        + ",,,,,,\n,Name"
        + ",Tool" * 7
        + ",,,,,,\n"
        ',ID,"1","1","1","1","1","1","1",,,,,,\n'
        ",,Rotation,Rotation,Rotation,Rotation,Position,Position,Position,,,,,,\n"
        "Frame,Time (Seconds),X,Y,Z,W,X,Y,Z,j1,j2,j3,j4,j5,j6\n" + rows(",", numbers=numbers)
    )
    columns = {"time": 2, "qx": 3, "qy": 4, "qz": 5, "qw": 6, "x": 7, "y": 8, "z": 9}
    units = {"time": "s", **dict.fromkeys(NAMES, "rad"), **dict.fromkeys("xyz", "m")}
    found = read(tmp_path, text, columns=columns, units=units)
    as_plain(found)
    np.testing.assert_allclose(found.rotation, QUATERNIONS, atol=1e-9)
    assert found.time is not None


def test_a_recording_of_ur_rtde_is_read(tmp_path: Path) -> None:
    heads = ["timestamp", *(f"actual_q_{k}" for k in range(6)), *(f"actual_TCP_pose_{k}" for k in range(6))]
    numbers = np.column_stack([np.arange(ROWS) * 0.002, Q, POINTS, TURNED.as_rotvec()])
    columns = {"time": "timestamp", **{name: f"actual_q_{k}" for k, name in enumerate(NAMES)}}
    columns |= {name: f"actual_TCP_pose_{k}" for k, name in enumerate(("x", "y", "z", "rx", "ry", "rz"))}
    units = {"time": "s", **dict.fromkeys((*NAMES, "rx", "ry", "rz"), "rad"), **dict.fromkeys("xyz", "m")}
    found = read(tmp_path, " ".join(heads) + "\n" + rows(" ", numbers=numbers), columns=columns, units=units)
    as_plain(found)
    np.testing.assert_allclose(found.rotation, QUATERNIONS, atol=1e-9)


HEADERS = {
    "foreign coordinates": (
        ", ".join([*HEAD[:6], "Pos X [mm]", "Pos Y [mm]", "Pos Z [mm]"]),
        ["missing x [mm], y [mm], z [mm]", "'Pos X' (did you mean x?)", 'data: {columns: {x: "Pos X", y: "Pos Y"'],
    ),
    "mistyped and foreign": (
        ", ".join(["j11 [rad]", *HEAD[1:6], "x [mm]", "y [mm]", "Höhe [mm]"]),
        ["'j11' (did you mean j1?)", "'Höhe'"],
    ),
    "no units at all": (", ".join((*NAMES, "x", "y", "z")), ["no unit in j1, j2, j3, j4, j5, j6, x, y, z"]),
}


@pytest.mark.parametrize("case", HEADERS)
def test_a_wrong_header_is_told_once(case: str, tmp_path: Path) -> None:
    header, said = HEADERS[case]
    with pytest.raises(po.errors.InputError) as caught:
        read(tmp_path, header + "\n" + rows(","))
    (issue,) = caught.value.issues
    for words in said:
        assert words in str(issue)
    assert "ball bar" not in str(issue), "of no other instrument"


def test_columns_that_are_not_there_are_refused(tmp_path: Path) -> None:
    with pytest.raises(po.errors.InputError, match=r"x: there is no column 'Pos X' – did you mean 'Posn X"):
        read(tmp_path, PLAIN.replace("x [mm]", "Posn X [mm]") + "\n" + rows(","), columns={"x": "Pos X"})
    with pytest.raises(po.errors.InputError, match="the columns 7, 8 are called 'X' – name it by its number"):
        read(tmp_path, PLAIN.replace("x [", "X [").replace("y [", "X [") + "\n" + rows(","), columns={"x": "X"})
    with pytest.raises(po.errors.InputError, match="the column header says 'mm', the problem file 'm'"):
        read(tmp_path, PLAIN + "\n" + rows(","), units={"x": "m"})


@pytest.mark.parametrize("given", [{"columns": {"xx": "Pos X"}}, {"units": {"xx": "mm"}}])
def test_names_of_columns_are_judged_with_the_file(given: dict[str, Any]) -> None:
    with pytest.raises(po.errors.InputError, match="xx: no file of this robot has such a column"):
        problem_with(**given)


def test_a_stated_decimal_mark_settles_what_could_be_both(tmp_path: Path) -> None:
    text = ";".join(HEAD) + "\n" + rows(";", lambda v: f"{v:.3f}".replace(".", ","), np.full((3, 9), 1.234))
    with pytest.raises(po.errors.InputError, match=r"1,234 may be 1\.234 or 1234"):
        read(tmp_path, text)
    assert read(tmp_path, text, decimal=",").q[0, 0] == 1.234


def test_data_frames_go_both_ways(tmp_path: Path) -> None:
    pandas = pytest.importorskip("pandas", reason="pandas is an optional input and output")
    extra = ", qw, qx, qy, qz, pose, target, j1.approach, payload [kg], temperature [degC], time [s]"
    cells = [
        ",".join(map(repr, map(float, (*numbers, *rotation))))
        + f",p{k // 2},t{k % 2},{'' if k % 3 else '1'},1.5,20.25,{k}.5"
        for k, (numbers, rotation) in enumerate(zip(NUMBERS, QUATERNIONS, strict=True))
    ]
    data = read(tmp_path, PLAIN + extra + "\n" + "\n".join(cells) + "\n")
    frame = data.to_dataframe()
    assert isinstance(frame, pandas.DataFrame)
    assert list(frame.columns[:3]) == ["j1 [rad]", "j2 [rad]", "j3 [rad]"]
    again = po.read_measurements(frame, problem_with())
    for name in po.Measurements.__dataclass_fields__:
        before, after = getattr(data, name), getattr(again, name)
        assert np.array_equal(before, after) if isinstance(before, np.ndarray) else before == after, name
    assert math.isclose(frame["x [m]"].iloc[0], POINTS[0, 0], abs_tol=1e-12)
    frame.to_csv(tmp_path / "again.csv", index=False)
    np.testing.assert_array_equal(po.read_measurements(tmp_path / "again.csv", problem_with()).position, data.position)
