"""The targets: uniform draws in the arm's box, the unreachable ones replaced and counted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchmarks.arms import Arm, Array
from benchmarks.judge import judge
from benchmarks.ways import Solve, eaik_sweep, rtb_sampling


@dataclass(frozen=True)
class Targets:
    """Reachable tool positions (N, 3) [m] in the base frame, and how many draws were thrown away."""

    positions: Array
    replaced: int


def draw(arm: Arm, count: int, seed: int) -> Targets:
    """Draw until `count` reachable targets are found.

    Reachable is what some posture of the judge's liking attains: looked for by analytic inverse kinematics over
    the yaw where there is one, by 2000 random searches elsewhere.
    """
    rng = np.random.default_rng(seed)
    attempt: Solve = eaik_sweep.build(arm, steps=72) if arm.analytic else rtb_sampling.build(arm, samples=2000)
    positions: list[Array] = []
    drawn = 0
    while len(positions) < count:
        position = rng.uniform(arm.lower, arm.upper)
        drawn += 1
        q = attempt(position)
        if q is not None and judge(arm, position, q).feasible:
            positions.append(position)
    return Targets(np.array(positions), drawn - count)
