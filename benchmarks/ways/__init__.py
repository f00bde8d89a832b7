"""The ways to select a posture, one module each.

A module offers `TITLE` and `build(arm, ...)`, which does once what can be done once and returns `solve`: it takes
the tool position (3,) [m] and gives the joint angles (n,) [rad], or None where it finds nothing. Whether what it
gives is feasible, and how good it is, only the judge says.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from benchmarks.arms import Arm, Array

Solve = Callable[[Array], Array | None]


def random_starts(arm: Arm, count: int, seed: int) -> Array:
    """Postures (count, n) [rad] in the middle half of each joint's range, of one turn at most.

    SLSQP and SNOPT meet hard equality constraints from there in most starts; from the whole range they fail in
    most, which would make a weak opponent.
    """
    lower, upper = (np.clip(limit, -np.pi, np.pi) for limit in arm.limits)
    middle, quarter = (lower + upper) / 2, (upper - lower) / 4
    return np.random.default_rng(seed).uniform(middle - quarter, middle + quarter, (count, len(middle)))
