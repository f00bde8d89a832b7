"""The files of planar 2R arms: their parts of a problem file, and measurements of the one whose links are 1 m."""

from __future__ import annotations

import numpy as np

import posture_opt as po

HEAD = "joint1 [deg], joint2 [deg], x [mm], y [mm]"
PLANAR = """
name: Planar arm
robot:
  kind: dh
  joints:
    - {name: joint1, type: revolute, a: 1 m, limits: [-180 deg, 180 deg]}
    - {name: joint2, type: revolute, a: 1 m, limits: [-180 deg, 180 deg]}
"""
SHORT = """
robot:
  kind: dh
  joints:
    - {name: joint1, a: 500 mm}
    - {name: joint2, a: 400 mm}
task: {kind: insert, direction: [0, 1, 0], position: [0.5 m, 0.4 m, 0 m]}
"""
"""An arm of links of 0.5 m and 0.4 m, and its task."""

PROBLEM = {
    "name": "Planar arm",
    "robot": {"kind": "dh", "joints": [{"name": f"joint{i}", "type": "revolute", "a": "1 m"} for i in (1, 2)]},
    "uncertainty": {"measurement": {"position": "0.02 mm"}},
}
"""The arm of two links of 1 m as a dict, measured by an instrument of 20 µm."""


def write(file, q, points, **more):
    """Rows of joints (N, 2) [rad] and points (N, 2) [m]; ``more`` columns (N,) as ``time=("s", values)``."""
    head = ", ".join([HEAD, *(f"{name} [{unit}]" for name, (unit, _) in more.items())])
    columns = [np.degrees(q), 1e3 * points, *(values for _, values in more.values())]
    np.savetxt(file, np.column_stack(columns), fmt="%.9f", delimiter=",", header=head, comments="")


def planar_rows(q, points, problem=PROBLEM, **more):
    """The problem, and such rows as they are read without a file."""
    stated = po.problem_from_dict(problem)
    table = {"joint1 [rad]": q[:, 0], "joint2 [rad]": q[:, 1], "x [m]": points[:, 0], "y [m]": points[:, 1]}
    further = {f"{name} [{unit}]": values for name, (unit, values) in more.items()}
    return stated, po.read_measurements({**table, **further}, stated)
