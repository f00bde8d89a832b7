"""Makes ``problems/planar_2r_batch.csv``: twelve planar 2R arms from one machine tool; not a line of the package.

Run from the folder of the project: ``python -m tests.helpers.batch_planar_2r > problems/planar_2r_batch.csv``
"""

from __future__ import annotations

import numpy as np

from tests.helpers.planar_2r import position

SIGMA = 0.5e-3  # m: of the length of each link across the batch
CORRELATION = 0.9  # both links of an arm are cut in one set-up
SCATTER = np.radians(0.005)  # of each joint from repeat to repeat
NOISE = 0.02e-3  # m: of a measured coordinate
HEAD = "robot, joint1 [deg], joint2 [deg], x [mm], y [mm]"


def lengths(robots=12, seed=11):
    """(robots, 2) lengths of the links [m]."""
    C = SIGMA**2 * np.array([[1, CORRELATION], [CORRELATION, 1]])
    return 1.0 + np.random.default_rng(seed).multivariate_normal([0, 0], C, robots)


def rows(robots=12, poses=12, seed=12):
    """(robots · poses, 5) number of the robot, commanded joints [deg], measured tool points [mm]."""
    rng = np.random.default_rng(seed)
    robot = np.arange(robots).repeat(poses)
    q = np.radians(np.round(np.degrees(rng.uniform(np.radians(-150), np.radians(150), (len(robot), 2))), 2))
    cut = lengths(robots)[robot]
    points = position(q + rng.normal(0, SCATTER, q.shape), cut.T) + rng.normal(0, NOISE, q.shape)
    return np.column_stack([robot + 1, np.degrees(q), 1e3 * points])


if __name__ == "__main__":
    print(HEAD, *(f"arm{k:02.0f}, {a:.2f}, {b:.2f}, {x:.4f}, {y:.4f}" for k, a, b, x, y in rows()), sep="\n")
