"""Nodes for normal variables: moments against the normal distribution's, weights positive."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from posture_opt.uncertainty.gaussian_rules import (
    degree_five,
    degree_three,
    quasi_random,
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
