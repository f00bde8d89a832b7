"""CPU time of a repeated, compiled solve: the set-up of `benchmarks.posture_selection`, one thread."""

from __future__ import annotations

import time

import numpy as np

from benchmarks.arms import ARMS
from benchmarks.tables import table
from benchmarks.ways import ours


def times(targets: int = 100, seed: int = 0) -> str:
    """Median, mean and largest milliseconds at random positions of each arm's box, the unreachable ones left out."""
    rows = []
    for arm in ARMS:
        solve = ours.build(arm)
        spent = []
        for position in np.random.default_rng(seed).uniform(arm.lower, arm.upper, (targets + 1, 3)):
            began = time.process_time()
            q = solve(position)
            spent += [] if q is None else [1e3 * (time.process_time() - began)]
        rows.append([arm.name, len(spent) - 1, np.median(spent[1:]), np.mean(spent[1:]), np.max(spent[1:])])
    return table(["arm", "targets", "median CPU ms", "mean", "largest"], rows, ("", "d", ".2f", ".2f", ".2f"))
