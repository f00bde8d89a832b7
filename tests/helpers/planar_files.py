"""The files of a planar 2R arm of two links of 1 m: its part of a problem file, and measurements of it."""

from __future__ import annotations

import numpy as np

HEAD = "joint1 [deg], joint2 [deg], x [mm], y [mm]"
PLANAR = """
name: Planar arm
robot:
  kind: dh
  joints:
    - {name: joint1, type: revolute, a: 1 m, limits: [-180 deg, 180 deg]}
    - {name: joint2, type: revolute, a: 1 m, limits: [-180 deg, 180 deg]}
"""
PROBLEM = {
    "name": "Planar arm",
    "robot": {"kind": "dh", "joints": [{"name": f"joint{i}", "type": "revolute", "a": "1 m"} for i in (1, 2)]},
    "uncertainty": {"measurement": {"position": "0.02 mm"}},
}
"""The same as a dict, measured by an instrument of 20 µm."""


def write(file, q, points, **more):
    """Rows of joints (N, 2) [rad] and points (N, 2) [m]; ``more`` columns (N,) as ``time=("s", values)``."""
    head = ", ".join([HEAD, *(f"{name} [{unit}]" for name, (unit, _) in more.items())])
    columns = [np.degrees(q), 1e3 * points, *(values for _, values in more.values())]
    np.savetxt(file, np.column_stack(columns), fmt="%.9f", delimiter=",", header=head, comments="")
