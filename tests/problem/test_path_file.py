"""Files of paths: what is read, and what is said of those that are not as they should be."""

from __future__ import annotations

import numpy as np
import pytest

import posture_opt as po
from tests.helpers.same_problem import written

PROBLEM = "robot: {kind: preset, name: panda}\ntask:\n  kind: trace\n  path: seam.csv\n"


def loaded(folder, text, problem=PROBLEM):
    (folder / "seam.csv").write_text(text, encoding="utf-8")
    (folder / "problem.yaml").write_text(problem, encoding="utf-8")
    return po.load_problem(folder / "problem.yaml")


def test_lengths_are_read_in_their_own_units_and_axes_beside_them(tmp_path):
    text = "dx, y [mm], dz, x [cm], dy, z [m]\n0, 10, -2, 50, 0, 0.2\n\n0.5, 20, -1, 51, 0.5, 0.3\n"
    task = loaded(tmp_path, text).task
    np.testing.assert_allclose(task.points, [(0.5, 0.01, 0.2), (0.51, 0.02, 0.3)])
    assert task.axes == ((0, 0, -2), (0.5, 0.5, -1))
    assert task.axis_request == "aligned"


@pytest.mark.parametrize(
    ("text", "line", "message"),
    [
        ("x, y [mm], z [mm]\n1,2,3\n4,5,6\n", 1, "x: the column has no unit – write x [mm]"),
        ("x [kg], y [mm]\n1,2\n3,4\n", 1, "x: "),
        ("x [mm], y [mm], t [mm]\n1,2,3\n4,5,6\n", 1, ": unknown column"),
        ("x [mm], z [mm]\n1,2\n4,5\n", 1, "y: the column is missing"),
        ("x [mm], y [mm], x [mm]\n1,2,3\n4,5,6\n", 1, "two columns have this name"),
        ("x [mm], y [mm], dz\n1,2,3\n4,5,6\n", 1, "dz alone make no direction"),
        ("x [mm], y [mm], dx [mm], dy\n1,2,3,4\n4,5,6,7\n", 1, "a direction has no unit"),
        ("x [mm], y [mm]\n1,nan\n4,5\n", 2, "y: this is not a finite number"),
        ("x [mm], y [mm]\n1,2\n4,five\n", 3, "y: this is not a finite number"),
        ("x [mm], y [mm]\n1,2\n4,1e200\n", 3, "y: this is not plausible"),
        ("x [mm], y [mm], dx, dy, dz\n1,2,0,0,1\n4,2,0,1e200,1\n", 3, "dy: this is not plausible"),
        ("x [mm], y [mm]\n1,2\n", 2, "a path has at least two points, 1 given"),
        ("x [mm], y [mm]\n1,2\n3,4\n3,4\n", 4, "the point of line 3 again"),
        ("x [mm], y [mm], dx, dy, dz\n1,2,0,0,1\n3,4,0,0,0\n", 3, "dx, dy, dz of length zero point nowhere"),
        ("x [mm], y [mm]\n1,2,3\n4,5\n", 2, "3 cells in the row, 2 columns in the header"),
        ("x [mm]; y [mm]\n1;2\n", 2, "a path has at least two points, 1 given"),
    ],
)
def test_faults_are_named_with_file_and_line(tmp_path, text, line, message):
    with pytest.raises(po.errors.InputError) as caught:
        loaded(tmp_path, text)
    first = caught.value.issues[0]
    assert (first.file, first.line) == (str(tmp_path / "seam.csv"), line)
    assert message in str(first)


@pytest.mark.parametrize(
    ("task", "message"),
    [
        ("kind: trace\n  points: [[0 m, 0 m, 0 m]]", "a path has at least two points"),
        ("kind: trace\n  points: [[0 m, 0 m, 0 m], [0 m, 0 m, 0 m]]", "point 2 is where point 1 is"),
        ("kind: trace\n  path: seam.csv\n  position: [0 m, 0 m, 0 m]", "path and position are given"),
        ("kind: trace\n  points: [[0 m, 0 m, 0 m], [1 m, 0 m, 0 m]]\n  axes: [[0, 0, 1]]", "1 axes for 2 points"),
        ("kind: weld", "weld follows a seam and none is given"),
        ("kind: trace\n  points: [[0 m, 0 m, 0 m], [1 m, 0 m, 0 m]]\n  largest_step: 0 deg", "largest_step"),
    ],
)
def test_faults_of_the_section_are_named(tmp_path, task, message):
    with pytest.raises(po.errors.InputError, match=message):
        loaded(tmp_path, "x [mm], y [mm]\n1,2\n3,4\n", f"robot: {{kind: preset, name: panda}}\ntask:\n  {task}\n")


def test_the_file_travels_with_the_problem(tmp_path):
    problem = loaded(tmp_path, "x [mm], y [mm]\n500, 0\n600, 0\n")
    assert written(problem, tmp_path).task.points == problem.task.points
    assert problem.files("other")["other_path.csv"] == (tmp_path / "seam.csv").read_bytes()
