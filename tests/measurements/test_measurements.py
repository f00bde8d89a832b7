"""Reading measurements: every column, every fault with its line, and what looks like a mistake of the whole file."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import posture_opt as po
from tests.helpers.planar_2r import position as planar_position
from tests.helpers.planar_files import PROBLEM
from tests.helpers.real_arms import DATA, long_on_real_arms, needs_real_arms
from tests.helpers.simulated_arm import SIX as TABLE
from tests.helpers.simulated_arm import SimulatedArm, shift, turn

DEG = math.pi / 180

PLANAR = {"robot": PROBLEM["robot"]}
SIX = {"robot": SimulatedArm(TABLE).section(("-360 deg", "360 deg"), base="free", tool="free")}
TOOL = shift(0.05, -0.02, 0.11)
TRACKER = shift(1.2, -0.7, 0.3) @ turn(2, -2.0) @ turn(1, 1.1) @ turn(0, 0.4)
SLIDER = {
    "robot": {
        "kind": "dh",
        "joints": [
            {"name": "turn", "alpha": "90 deg"},
            {"name": "slide", "type": "prismatic", "limits": ["0 mm", "900 mm"], "a": "0.1 m", "alpha": "90 deg"},
            {"name": "wrist", "a": "0.3 m"},
        ],
    },
}


def six_points(q: np.ndarray, base: np.ndarray = TRACKER) -> np.ndarray:
    """Tool points of ``SIX`` in a tracker's frame, by the textbook products and not by the package."""
    return SimulatedArm(TABLE, base=base, tool=TOOL).points(q)


def six_table(rows: int = 80, seed: int = 1) -> dict[str, np.ndarray]:
    """Measurements of ``SIX`` with 0.5 mm of noise, as columns with their headers."""
    rng = np.random.default_rng(seed)
    q = rng.uniform(-2.5, 2.5, (rows, 6))
    x = six_points(q) + rng.normal(0, 5e-4, (rows, 3))
    return {**{f"j{k + 1} [rad]": q[:, k] for k in range(6)}, **{f"{w} [m]": x[:, k] for k, w in enumerate("xyz")}}


def renamed(table: dict[str, np.ndarray], **heads: str) -> dict[str, np.ndarray]:
    """The table with other headers: ``x="x [mm]"`` replaces the header that begins with x."""
    return {heads.get(head.split(" ")[0], head): values for head, values in table.items()}


def write(folder: Path, text: str) -> Path:
    path = folder / "data.csv"
    path.write_text(text, encoding="utf-8")
    return path


def read(folder: Path, text: str, problem=PLANAR) -> po.Measurements:
    return po.read_measurements(write(folder, text), po.problem_from_dict(problem))


def refused(source, problem) -> list[str]:
    with pytest.raises(po.errors.InputError) as caught:
        po.read_measurements(source, po.problem_from_dict(problem))
    assert caught.value.exit_code == 2
    return str(caught.value).splitlines()


def test_every_column(tmp_path: Path) -> None:
    data = read(
        tmp_path,
        "pose, goal, target, robot, time [min], temperature [K], payload [g], joint2 [mrad], joint1 [deg],"
        " joint1.approach, x [mm], y [cm], z [m], qw, qx, qy, qz\n"
        "a, g, left, r1, 0, 293.15, 500, 100, 30, 1, 1800, 100, 0, -0.5, 0.5, 0.5, 0.5\n"
        "\n"
        "b, g, right, r1, 1, 294.15, 0, -300, 30, -1, 1700, 100, 0, 0.5, 0.5, 0.5, 0.5\n"
        "a, h, left, r1, 2, 295.15, 0, 100, 30, , 1800, 100, 0.001, 1, 0, 0, 0\n",
    )
    assert len(data) == 3
    assert data.joint_names == ("joint1", "joint2")
    np.testing.assert_allclose(data.q, [[30 * DEG, 0.1], [30 * DEG, -0.3], [30 * DEG, 0.1]], rtol=1e-14)
    np.testing.assert_allclose(data.position, [[1.8, 1, 0], [1.7, 1, 0], [1.8, 1, 1e-3]], rtol=1e-14)
    assert data.measured_axes.all()
    # -q and q are one rotation; the first is written with w < 0
    np.testing.assert_allclose(data.rotation[0], [0.5, -0.5, -0.5, -0.5], rtol=1e-14)
    assert (data.pose.tolist(), data.goal.tolist(), data.target.tolist()) == ([0, 1, 0], [0, 0, 1], [0, 1, 0])
    assert (data.target_names, data.robot_names, data.point_names) == (("left", "right"), ("r1",), ())
    np.testing.assert_allclose(data.time, [0, 60, 120])
    np.testing.assert_allclose(data.temperature, [20, 21, 22], rtol=1e-12)
    np.testing.assert_allclose(data.payload, [0.5, 0, 0])
    assert data.line.tolist() == [2, 4, 5]
    # joint1 is stated, but for the last row, where it has never moved; joint2 comes from the row before
    np.testing.assert_array_equal(data.approach, [[1, 0], [-1, -1], [0, 1]])
    np.testing.assert_allclose(data.approach_length, [[0, 0], [0, 0.4], [0, 0.4]], atol=1e-15)


def test_repeats_and_approach_come_from_the_rows(tmp_path: Path) -> None:
    data = read(
        tmp_path,
        "robot, joint1 [deg], joint2 [deg], x [m], y [m]\n"
        "a,0,10,1.9,0.2\nb,5,5,1.9,0.3\na,20,-0,1.9,0.7\na,20,10,1.8,0.8\na,0,10,1.9,0.21\na,0,10,1.9,0.22\n",
    )
    assert data.pose.tolist() == [0, 1, 2, 3, 0, 0]
    assert data.goal.tolist() == data.pose.tolist()
    # a's rows are compared with a's; a joint that stands still keeps the side it came from
    np.testing.assert_array_equal(data.approach, [[0, 0], [0, 0], [1, -1], [1, 1], [-1, 1], [-1, 1]])
    np.testing.assert_allclose(data.approach_length[4] / DEG, [20, 10], rtol=1e-12)


def test_planar_arm_without_z(tmp_path: Path) -> None:
    lifted = {"robot": {**PLANAR["robot"], "base": {"xyz": ["0 m", "0 m", "0.25 m"]}}}
    data = read(tmp_path, "joint1 [deg], joint2 [deg], x [m], y [m]\n0,0,2,0\n", lifted)
    assert data.measured_axes.tolist() == [True, True, False]
    np.testing.assert_allclose(data.position, [[2, 0, 0.25]], atol=1e-15)
    table = six_table()
    del table["z [m]"]
    (line,) = refused(table, SIX)
    assert "z: the column z is missing, and this arm moves along z – add z [mm]" in line


def test_touched_points_and_known_distances(tmp_path: Path) -> None:
    problem = {**PLANAR, "data": {"distances": [["front/0", "front/1", "50 mm"], ["front/0", "frnt/2", "2 cm"]]}}
    assert po.problem_from_dict(problem).data.distances == (("front/0", "front/1", 0.05), ("front/0", "frnt/2", 0.02))
    text = "point, joint1 [deg], joint2 [deg]\nfront/0,0,0\nfront/1,1,0\nfront/0,0,1\nfront/2,0,3\n"
    data = read(tmp_path, text, problem)
    assert data.touches
    assert data.position is None
    assert data.point.tolist() == [0, 1, 0, 2]
    assert data.point_names == ("front/0", "front/1", "front/2")
    assert data.warnings == ("data.distances names the point 'frnt/2', which no row touches; did you mean 'front/2'?",)


@pytest.mark.parametrize(
    ("distances", "message"),
    [
        ([["a", "b", 50]], "data.distances[0][2]: the length has no unit"),
        ([["a", "a", "5 mm"]], "the distance of 'a' to itself"),
        ([["a", "b", "-5 mm"]], "a distance is greater than 0"),
        ([["a", "b", "5 mm"], ["b", "a", "6 mm"]], "is given twice"),
        ([["a", "b"]], "data.distances[0]: 2 entries, 3 expected"),
    ],
)
def test_bad_distances(distances: list, message: str) -> None:
    with pytest.raises(po.errors.InputError) as caught:
        po.problem_from_dict({**PLANAR, "data": {"distances": distances}})
    assert message in str(caught.value)


HEAD = "joint1 [deg], joint2 [deg], x [mm], y [mm]"
FAULTS = {
    # file: (line, what the message holds), ...
    "nothing": ("", [(0, "the file is empty")]),
    "header only": (HEAD + "\n", [(1, "no row behind the header")]),
    "unknown column": (
        HEAD + ", temperatur [degC]\n0,0,2000,0,20\n",
        [(1, "temperatur: unknown column – did you mean 'temperature'?")],
    ),
    "mistyped joint": (
        HEAD.replace("joint1", "jiont1") + "\n0,0,2000,0\n",
        [(1, "jiont1: unknown column – did you mean 'joint1'?")],
    ),
    "missing joint": (
        "joint1 [deg], x [m], y [m]\n0,2,0\n",
        [(1, "joint2: the column of this joint is missing – add joint2 [deg]")],
    ),
    "missing unit": (
        HEAD.replace(" [deg]", "", 1) + "\n0,0,2000,0\n",
        [(1, "joint1: the column has no unit – write joint1 [deg]")],
    ),
    "wrong dimension": (
        HEAD.replace("x [mm]", "x [deg]") + "\n0,0,2000,0\n",
        [(1, "x: 'deg' is not a unit of length – write x [mm]")],
    ),
    "unknown unit": (
        HEAD.replace("x [mm]", "x [mmm]") + "\n0,0,2000,0\n",
        [(1, "x: unknown unit 'mmm' – write x [mm]")],
    ),
    "unit of a label": (
        HEAD + ", pose [m]\n0,0,2000,0,1\n",
        [(1, "pose: a column without dimension has the unit 'm'")],
    ),
    "wrong temperature": (HEAD + ", temperature [degR]\n0,0,2000,0,1\n", [(1, "'degR' is not a unit of temperature")]),
    "twice": (HEAD + ", x [m]\n0,0,2000,0,2\n", [(1, "x: two columns have this name – keep one")]),
    "no name": (HEAD + ",\n0,0,2000,0,5\n", [(2, "5 cells in the row, 4 columns in the header")]),
    "no name within": ("," + HEAD + "\n1,0,0,2000,0\n", [(1, "a column has no name")]),
    "both": (HEAD + ", point\n0,0,2000,0,p\n", [(1, "point: both point and x, y are given")]),
    "neither": ("joint1 [deg], joint2 [deg]\n0,0\n", [(1, "nothing is measured – add x [mm]")]),
    "half a rotation": (HEAD + ", qw, qx\n0,0,2000,0,1,0\n", [(1, "qw: the quaternion lacks qy, qz")]),
    "another robot": (
        "shoulder [deg], elbow [deg], x [mm], y [mm]\n0,0,2000,0\n",
        [(1, "no column is a joint of the problem's robot (joint1, joint2), but there are shoulder, elbow")],
    ),
    "mixed separators": (
        HEAD + "\n0;0;2000;0\n",
        [(2, "1 cell in the row, 4 columns")],
    ),
    "text": (HEAD + "\n0,zero,2000,0\n", [(2, "joint2: 'zero' is not a number")]),
    "unit in a cell": (
        HEAD + "\n0,0,2000 mm,0\n",
        [(2, "x: '2000 mm' is not a number – the unit is in the header")],
    ),
    "two decimal marks": (
        HEAD + '\n0,0.5,"2000,5",0\n',
        [(0, "2000,5 has a decimal comma, 0.5 a decimal point – say in the problem file which it is: data: {decimal:")],
    ),
    "thousands or not": (HEAD + '\n0,0,"2,000",0\n', [(0, "2,000 may be 2.000 or 2000 – say in the problem file")]),
    "underscore": (HEAD + "\n0,0,2_000,0\n", [(2, "x: '2_000' is not a number")]),
    "empty cell": (HEAD + "\n0,0,,0\n", [(2, "x: the cell is empty")]),
    "nan": (HEAD + "\n0,0,2000,0\n0,0,nan,0\n", [(3, "x: nan is not a finite number")]),
    "overflow": (HEAD + "\n0,0,2000,1e999\n", [(2, "y: 1e999 is not a finite number")]),
    "huge": (HEAD + "\n0,0,2000,1e300\n", [(2, "y: 1e300 is larger than anything measured")]),
    "binary": ("\x00\x01\x02\n", [(1, "the header is no plain text")]),
    "ragged": (
        HEAD + "\n0,0,2000\n0,0,2000,0,1\n7\n",
        [(2, "3 cells in the row, 4 columns"), (3, "5 cells"), (4, "1 cell in")],
    ),
    "beyond a turn": (
        HEAD + "\n721,0,2000,0\n0,-900,2000,0\n",
        [(2, "joint1: 721 deg lies more than a turn beyond the limits [-360, 360]"), (3, "joint2: -900 deg")],
    ),
    "norm": (HEAD + ", qw, qx, qy, qz\n0,0,2000,0,1,1,0,0\n", [(2, "qw: the quaternion has norm 1.414")]),
    "side": (
        HEAD + ", joint1.approach\n0,0,2000,0,0\n0,0,2000,0,2\n",
        [(2, "joint1.approach: 0 is no side – write 1 or -1"), (3, "2 is no side")],
    ),
    "payload": (HEAD + ", payload [kg]\n0,0,2000,0,-2\n", [(2, "payload: a payload is not negative")]),
    "grams": (HEAD + ", payload [kg]\n0,0,2000,0,5000\n", [(2, "payload: no arm like this one carries 5000 kg")]),
    "no label": (HEAD + ", pose\n0,0,2000,0,\n", [(2, "pose: the cell is empty")]),
    "all at once": (
        HEAD.replace("y [mm]", "y") + ", spin\n0,x,2000,0,1\n0,0,nan,0,1\n",
        [
            (
                1,
                "the header does not fit: unknown 'spin' (did you mean point?); no unit in y",
            ),
            (2, "joint2: 'x' is not"),
            (3, "x: nan is not"),
        ],
    ),
}


@pytest.mark.parametrize(("unit", "value"), [("degC", 25.0), ("K", 298.15), ("degF", 77.0)])
def test_temperatures_are_read_in_each_unit(unit: str, value: float) -> None:
    table = {"joint1 [deg]": [0.0], "joint2 [deg]": [0.0], "x [mm]": [2e3], "y [mm]": [0.0]}
    data = po.read_measurements(table | {f"temperature [{unit}]": [value]}, po.problem_from_dict(PLANAR))
    assert data.temperature == pytest.approx([25.0])


@pytest.mark.parametrize("case", FAULTS)
def test_every_fault_has_its_line(case: str, tmp_path: Path) -> None:
    text, expected = FAULTS[case]
    said = refused(write(tmp_path, text), PLANAR)
    assert len(said) == len(expected)
    for line, (number, message) in zip(said, expected, strict=True):
        assert line.startswith(f"{tmp_path / 'data.csv'}:" + (f"{number}: " if number else " ")), line
        assert message in line


def test_many_faults_are_counted(tmp_path: Path) -> None:
    said = refused(write(tmp_path, HEAD + "\n" + "0,0,2000,?\n" * 500), PLANAR)
    assert len(said) == 4
    assert "y: 497 more rows like these (lines 5 to 501)" in said[-1]


def test_files_that_are_no_tables(tmp_path: Path) -> None:
    problem = po.problem_from_dict(PLANAR)
    write(tmp_path, HEAD)
    with pytest.raises(
        po.errors.InputError, match=r"no such file: .*dta.csv – did you mean .*data.csv in the same folder\?"
    ):
        po.read_measurements(tmp_path / "dta.csv", problem)
    with pytest.raises(po.errors.InputError, match="this is a folder, not a file"):
        po.read_measurements(tmp_path, problem)
    (tmp_path / "no_text.csv").write_bytes(b"joint1 [\x81\xff], joint2 [deg], x [m], y [m]\n")
    with pytest.raises(po.errors.InputError, match="not UTF-8 text"):
        po.read_measurements(tmp_path / "no_text.csv", problem)
    (tmp_path / "long.csv").write_bytes(b"0" * 10**6)
    with pytest.raises(po.errors.InputError, match="more than 100000 characters"):
        po.read_measurements(tmp_path / "long.csv", problem)
    with pytest.raises(po.errors.InputError, match="not int"):
        po.read_measurements(3, problem)


def test_a_data_frame_is_read_like_its_file(tmp_path: Path) -> None:
    pandas = pytest.importorskip("pandas", reason="pandas is an optional input")
    text = "pose,joint1 [deg],joint2 [deg],x [mm],y [mm],joint1.approach\n0,0,5,1990,90,1\n1,10,5,1950,400,\n"
    frame = pandas.read_csv(write(tmp_path, text))
    problem = po.problem_from_dict(PLANAR)
    ours, theirs = read(tmp_path, text), po.read_measurements(frame, problem)
    for name in ("q", "position", "pose", "approach"):
        np.testing.assert_array_equal(getattr(ours, name), getattr(theirs, name))
    assert theirs.line.tolist() == [1, 2]
    frame.loc[1, "x [mm]"] = math.nan
    assert refused(frame, PLANAR) == ["table:2: x: the cell is NaN – give a number, or leave out the row"]
    frame["x [mm]"] = ["1990", "many"]
    assert "table:2: x: 'many' is not a number" in refused(frame, PLANAR)[0]
    assert "no row behind the header" in refused(frame.iloc[:0], PLANAR)[0]


def test_duplicated_rows_are_told(tmp_path: Path) -> None:
    text = HEAD + "\n0,0,2000,0\n1,0,1999,30\n0,0,2000,0.01\n1,0,1999,30\n"
    (warning,) = read(tmp_path, text).warnings
    assert warning == "1 row repeats an earlier one to the last digit, as if copied: lines 5 (of 3)"


def test_rows_of_one_pose_with_other_commands_are_told(tmp_path: Path) -> None:
    (warning,) = read(tmp_path, HEAD + ",pose\n0,0,2000,0,7\n0,1,1999,10,7\n").warnings
    assert "1 rows have another posture than the first row of their pose, by up to 0.0175" in warning


@pytest.mark.parametrize("rows", [8, 80])  # few rows do not determine a free linear map
def test_good_data_raise_no_suspicion(rows: int) -> None:
    data = po.read_measurements(six_table(rows), po.problem_from_dict(SIX))
    assert data.warnings == ()


@pytest.mark.parametrize("rows", [3, 80])  # three rows are judged by the distances between their points
def test_millimetres_read_as_metres(rows: int) -> None:
    table = six_table(rows)
    (line,) = refused({head: values * (1 if head[0] == "j" else 1e3) for head, values in table.items()}, SIX)
    assert "look like mm: write x [mm], y [mm], z [mm]" in line
    (line,) = refused(renamed(table, x="x [mm]", y="y [mm]", z="z [mm]"), SIX)
    assert "look like m: write x [m], y [m], z [m]" in line


def test_degrees_read_as_radians() -> None:
    table = six_table()
    degrees = {head: values / DEG if head[0] == "j" else values for head, values in table.items()}
    said = refused(degrees, SIX)
    assert len(said) == 6
    assert all("they look like deg: write j" in line for line in said)


def test_radians_read_as_degrees() -> None:
    table = six_table()
    every = {f"j{k}": f"j{k} [deg]" for k in range(1, 7)}
    (line,) = refused(renamed(table, **every), SIX)
    assert "the numbers of j1, j2, j3, j4, j5, j6 are rad" in line
    (line,) = refused(renamed(table, j3="j3 [deg]"), SIX)
    assert "the numbers of j3 are rad" in line
    assert line.endswith("write j3 [rad]")


def test_swapped_joint_columns() -> None:
    (line,) = refused(renamed(six_table(), j2="j4 [rad]", j4="j2 [rad]"), SIX)
    assert "if the columns j2 and j4 are exchanged" in line
    assert "are the two swapped?" in line


def test_mirrored_frame() -> None:
    table = six_table(8)
    (line,) = refused({**table, "z [m]": -table["z [m]"]}, SIX)
    assert "the measured frame is left-handed" in line
    (line,) = refused(renamed(table, x="y [m]", y="x [m]"), SIX)
    assert "the measured frame is left-handed" in line


def test_swapped_or_reversed_coordinates_in_a_known_frame() -> None:
    q = np.random.default_rng(2).uniform(-2.5, 2.5, (60, 2))
    x, y = planar_position(q).T
    known = {"joint1 [rad]": q[:, 0], "joint2 [rad]": q[:, 1]}
    assert po.read_measurements({**known, "x [m]": x, "y [m]": y}, po.problem_from_dict(PLANAR)).warnings == ()
    (line,) = refused({**known, "x [m]": y, "y [m]": x}, PLANAR)
    assert "(x and y look swapped)" in line
    (line,) = refused({**known, "x [m]": x, "y [m]": -y}, PLANAR)
    assert "(y looks as if it had the opposite sign)" in line
    (turned,) = po.read_measurements({**known, "x [m]": -y, "y [m]": x}, po.problem_from_dict(PLANAR)).warnings
    assert "turned by 90 deg against the base" in turned


def test_a_sliding_joint_in_another_unit() -> None:
    rng = np.random.default_rng(3)
    turn, slide, wrist = rng.uniform(-2, 2, 60), rng.uniform(0, 0.9, 60), rng.uniform(-2, 2, 60)
    problem = po.problem_from_dict(SLIDER)
    points = np.array([po.Arm.from_problem(problem).pose(q)[:3, 3] for q in np.c_[turn, slide, wrist]])
    table = {"turn [rad]": turn, "wrist [rad]": wrist, **{f"{w} [m]": points[:, k] for k, w in enumerate("xyz")}}
    assert po.read_measurements({**table, "slide [m]": slide}, problem).warnings == ()
    assert "they look like mm: write slide [mm]" in refused({**table, "slide [m]": 1e3 * slide}, SLIDER)[0]
    assert "the numbers of slide are m" in refused({**table, "slide [mm]": slide}, SLIDER)[0]


def test_joints_that_scatter_by_degrees_are_no_mistake() -> None:
    # the lecture's arm: 1 deg and 3 deg
    rng = np.random.default_rng(4)
    q = rng.uniform(-2.5, 2.5, (200, 2))
    x, y = planar_position(q + rng.normal(0, [1 * DEG, 3 * DEG], (200, 2))).T
    table = {"joint1 [rad]": q[:, 0], "joint2 [rad]": q[:, 1], "x [m]": x, "y [m]": y}
    assert po.read_measurements(table, po.problem_from_dict(PLANAR)).warnings == ()


def test_another_robots_file_with_the_same_joint_names() -> None:
    table = six_table()
    wrong = {**SIX["robot"], "joints": [{**joint} for joint in SIX["robot"]["joints"]]}
    wrong["joints"][1]["a"], wrong["joints"][3]["d"] = "-0.3 m", "0.5 m"
    data = po.read_measurements(table, po.problem_from_dict({"robot": wrong}))
    assert any("is it another robot's file" in warning for warning in data.warnings)


@pytest.mark.long
def test_touches_in_another_unit_or_swapped() -> None:
    # A touched point: six joints reach it in many ways; here by turning about the ball with damped least squares.
    table = touches()
    assert po.read_measurements(table, po.problem_from_dict(SIX)).warnings == ()
    every = {f"j{k}": f"j{k} [deg]" for k in range(1, 7)}
    assert "are rad" in refused(renamed(table, **every), SIX)[0]
    assert "the columns j2 and j3 are exchanged" in refused(renamed(table, j2="j3 [rad]", j3="j2 [rad]"), SIX)[0]


def touches() -> dict[str, np.ndarray]:
    rng = np.random.default_rng(5)
    rows, names = [], []
    for name, point in (("a", (0.5, 0.3, 0.2)), ("b", (-0.3, 0.5, 0.4))):
        while names.count(name) < 20:
            q = rng.uniform(-2.5, 2.5, 6)
            for _ in range(60):
                steps = six_points(q + 1e-6 * np.vstack([np.zeros(6), np.eye(6)]), base=np.eye(4))
                J = (steps[1:] - steps[0]).T / 1e-6
                q = q + J.T @ np.linalg.solve(J @ J.T + 1e-4 * np.eye(3), np.array(point) - steps[0])
            if np.linalg.norm(steps[0] - point) < 1e-4 and np.abs(q).max() < 6:
                rows.append(q)
                names.append(name)
    return {"point": np.array(names), **{f"j{k + 1} [rad]": column for k, column in enumerate(np.array(rows).T)}}


@needs_real_arms
@pytest.mark.parametrize(
    ("file", "problem", "rows"),
    [
        ("ipa_ur10/series_a.csv", "ipa_ur10/problem.yaml", 11911),
        ("ipa_ur10/series_b.csv", "ipa_ur10/problem.yaml", 1495),
        ("jacobi_ur5/grid.csv", "jacobi_ur5/problem.yaml", 1000),
        ("jacobi_ur5/random.csv", "jacobi_ur5/problem.yaml", 20),
        ("mukca_sockets/panda_3.csv", "mukca_sockets/problem_panda.yaml", 387),
        ("mukca_sockets/kuka_14.csv", "mukca_sockets/problem_iiwa.yaml", 180),
    ],
)
def test_real_measurements(file: str, problem: str, rows: int) -> None:
    data = po.read_measurements(DATA / file, po.load_problem(DATA / problem))
    assert len(data) == rows
    assert data.warnings == ()


@long_on_real_arms
def test_mistakes_in_real_measurements(tmp_path: Path) -> None:
    path = DATA / "jacobi_ur5" / "random.csv"
    head, _, rows = path.read_text(encoding="utf-8").partition("\n")
    problem = po.load_problem(path.parent / "problem.yaml")
    for wrong, said in (
        (head.replace("[rad]", "[deg]"), "wrist_3 are rad"),
        (head.replace("x [m],y [m],z [m]", "x [m],z [m],y [m]"), "left-handed"),
        (head.replace("[m]", "[cm]"), "look like m: write x [m]"),
        (head.replace("elbow", "?").replace("wrist_1", "elbow").replace("?", "wrist_1"), "elbow and wrist_1 are exch"),
    ):
        with pytest.raises(po.errors.InputError) as caught:
            po.read_measurements(write(tmp_path, f"{wrong}\n{rows}"), problem)
        assert said in str(caught.value)


def small_volume(seed: int, volume: float) -> np.ndarray:
    """(60, 6) joint values of ``SIX`` whose tool stays within a cube of this size [m], about in one orientation."""
    rng, arm = np.random.default_rng(seed), po.Arm.from_problem(po.problem_from_dict(SIX))
    q0, step = rng.uniform(-1.5, 1.5, 6), 1e-6
    T0 = np.asarray(arm.pose(q0), dtype=float)
    J = np.empty((6, 6))
    for k in range(6):
        dT = (np.asarray(arm.pose(q0 + step * np.eye(6)[k]), dtype=float) - T0) / step
        W = dT[:3, :3] @ T0[:3, :3].T
        J[:, k] = [*dT[:3, 3], W[2, 1], W[0, 2], W[1, 0]]
    moved = np.c_[rng.uniform(-volume / 2, volume / 2, (60, 3)), np.zeros((60, 3))]
    return q0 + moved @ np.linalg.pinv(J, rcond=1e-3).T


def test_a_small_volume_in_one_orientation_is_not_refused() -> None:
    """Zeros that are off by 1 deg: with two wrist joints exchanged, the tool's path is explained 14 times as well."""
    seed = 24
    q, rng = small_volume(seed, 0.15), np.random.default_rng(seed)
    x = six_points(q + rng.normal(0, DEG, 6)) + rng.normal(0, 5e-5, (60, 3))
    table = {**{f"j{k + 1} [rad]": q[:, k] for k in range(6)}, **{f"{w} [m]": x[:, k] for k, w in enumerate("xyz")}}
    assert po.read_measurements(table, po.problem_from_dict(SIX)).warnings == ()
    # Columns that are exchanged leave far more than that in the same volume.
    (line,) = refused(renamed(table, j2="j3 [rad]", j3="j2 [rad]"), SIX)
    assert "are exchanged" in line
