"""The order of visits against all orders there are."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

import posture_opt as po
from posture_opt.selection.answer.placement import best_order, moves

UR10 = po.problem_from_dict({"robot": {"kind": "preset", "name": "ur10"}}).robot


@pytest.mark.parametrize("seed", range(4))
def test_no_order_is_shorter(seed: int) -> None:
    Q = np.random.default_rng(seed).uniform(-2, 2, (7, 6))
    D = moves(UR10, Q)
    shortest = min(
        sum(D[a, b] for a, b in itertools.pairwise(order)) for order in itertools.permutations(range(len(Q)))
    )
    found = best_order(UR10, Q)
    assert found.travel <= shortest * (1 + 1e-3)  # as listed, where that is as good
    assert sorted(found.order) == list(range(7))
    assert found.exact


def test_exchanges_find_the_way_along_a_line() -> None:
    order = np.random.default_rng(1).permutation(20)
    Q = np.zeros((20, 6))
    Q[:, 2] = 0.1 * order
    found = best_order(UR10, Q)
    assert found.travel == pytest.approx(1.9)
    assert found.as_listed > found.travel
    assert not found.exact
