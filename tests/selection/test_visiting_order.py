"""The order of visits against all orders there are."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from posture_opt.problem.load import problem_from_dict
from posture_opt.selection.answer.placement import best_order, moves, nearest_turns

UR10 = problem_from_dict({"robot": {"kind": "preset", "name": "ur10"}}).robot
SCARA = problem_from_dict({"robot": {"kind": "preset", "name": "scara"}}).robot


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


def test_slides_do_not_count_where_joints_turn() -> None:
    Q = np.array([[0.0, 0.0, 0.15, 0.0], [0.1, 0.0, 0.0, 0.0]])
    assert moves(SCARA, Q)[0, 1] == pytest.approx(0.1)


def test_whole_turns_are_taken_off_within_the_limits() -> None:
    Q = np.array([[3.0, 0, 0, 0, 0, 6.0], [-3.0, 0, 0, 0, 0, -6.0]])
    near = nearest_turns(UR10, Q, (0, 1))
    assert near[1, 0] == pytest.approx(2 * math.pi - 3.0)
    assert near[1, 5] == pytest.approx(2 * math.pi - 6.0)  # two turns would be nearer, and beyond the limit
    assert np.all(near <= np.array(UR10.upper) + 1e-12)
    assert np.allclose(np.sin(near - Q), 0, atol=1e-12)
