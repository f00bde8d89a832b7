"""Nodes for normal variables: moments against the normal distribution's, weights positive."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from posture_opt.uncertainty.moments.gaussian_rules import (
    degree_five,
    degree_three,
    product_rule,
    quasi_random,
    side_by_side,
)

RULES = {
    "degree 3": (degree_three, 3),
    "degree 5": (degree_five, 5),
    "the other of degree 5": (lambda r: degree_five(r, other=True), 5),
    "quasi-random": (lambda r: quasi_random(r, 600, np.random.default_rng(1)), 3),
}


def normal_moment(powers):
    """E Π z_k^{p_k} of independent standard normal variables: the product of (p − 1)!!, zero for odd p."""
    return math.prod(0 if p % 2 else math.prod(range(1, p, 2)) for p in powers)


def moments_agree(nodes, degree, atol):
    r = nodes.points.shape[1]
    for total in range(degree + 1):
        for axes in itertools.combinations_with_replacement(range(r), total):
            powers = [axes.count(k) for k in range(r)]
            found = nodes.weights @ np.prod(nodes.points ** np.array(powers), axis=1)
            assert found == pytest.approx(normal_moment(powers), abs=atol), powers


@pytest.mark.parametrize("r", [1, 2, 3, 4, 5, 6, 9])
@pytest.mark.parametrize("name", RULES)
def test_polynomials_are_exact_up_to_the_degree(name, r):
    build, degree = RULES[name]
    nodes = build(r)
    assert (nodes.weights > 0).all()
    assert nodes.points.shape == (nodes.count, r)
    moments_agree(nodes, degree, 1e-12)  # sums of some hundred terms of up to r²


@pytest.mark.parametrize("counts", [(3,), (4, 2), (5, 3, 2)])
def test_products_have_the_degree_of_each_axis(counts):
    nodes = product_rule(counts)
    assert nodes.count == math.prod(counts)
    for k, count in enumerate(counts):
        for power in range(2 * count):
            assert nodes.weights @ nodes.points[:, k] ** power == pytest.approx(normal_moment([power]), rel=1e-12)


def test_rules_stand_side_by_side_in_the_order_of_their_variables():
    nodes = side_by_side((product_rule((3, 3)), np.array([0, 2])), (degree_three(2), np.array([3, 1])))
    assert nodes.points.shape == (36, 4)
    moments_agree(nodes, 3, 1e-14)
    assert nodes.weights @ nodes.points[:, 2] ** 4 == pytest.approx(3)  # of three nodes of Gauss and Hermite
    assert nodes.weights @ nodes.points[:, 1] ** 4 == pytest.approx(2)  # of degree 3 in two variables
