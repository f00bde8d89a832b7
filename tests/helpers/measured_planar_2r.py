"""Makes ``problems/planar_2r_measured.csv``: a planar 2R arm with hidden errors, measured; not a line of the package.

Run from the folder of the project: ``python -m tests.helpers.measured_planar_2r > problems/planar_2r_measured.csv``
"""

from __future__ import annotations

import numpy as np

from tests.helpers.planar_2r import position

OFFSETS = np.radians([0.06, -0.09])  # of the joints' zeros
LENGTHS = 1.00062, 0.99952  # m: drawn with 1 m each
SCATTER = np.radians(0.005)  # of each joint from repeat to repeat
NOISE = 0.02e-3  # m: of a measured coordinate
HEAD = "joint1 [deg], joint2 [deg], x [mm], y [mm]"


def reached(q):
    """(..., 2) where the arm comes to lie when told to go to the postures (..., 2)."""
    return position(q + OFFSETS, LENGTHS)


def rows(n=60, seed=7):
    """(n, 4) commanded joints [deg] and measured tool points [mm]."""
    rng = np.random.default_rng(seed)
    q = np.radians(np.round(np.degrees(rng.uniform(np.radians(-150), np.radians(150), (n, 2))), 2))
    points = reached(q + rng.normal(0, SCATTER, q.shape)) + rng.normal(0, NOISE, q.shape)
    return np.column_stack([np.degrees(q), 1e3 * points])


if __name__ == "__main__":
    print(HEAD, *(f"{a:.2f}, {b:.2f}, {x:.4f}, {y:.4f}" for a, b, x, y in rows()), sep="\n")
