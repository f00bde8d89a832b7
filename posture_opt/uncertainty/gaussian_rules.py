"""Nodes with positive weights for means over a few standard normal variables.

A covariance that is mixed over such nodes stays positive semidefinite, whatever is mixed: no rule here has a negative
weight. All are symmetric about zero and exact for polynomials of degree 3 at least, so what is linear in the
variables has its covariance to the last digit, however small it is.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from posture_opt.numerics import TURN, Array, Codes


@dataclass(frozen=True, eq=False)
class Nodes:
    """``E f(z) ≈ Σ_n weights_n f(points_n)`` for ``z ~ N(0, I)``."""

    points: Array  # (N, r)
    weights: Array  # (N,) > 0, of sum one

    @property
    def count(self) -> int:
        return len(self.weights)


def product_rule(counts: Sequence[int]) -> Nodes:
    """The product of Gauss-Hermite rules with ``counts[k]`` nodes along axis k, of degree ``2 counts[k] − 1`` each."""
    rules = [_gauss_hermite(count) for count in counts]
    points = np.array(list(itertools.product(*(x for x, _ in rules)))).reshape(-1, len(counts))
    weights = np.array([np.prod(w) for w in itertools.product(*(w / w.sum() for _, w in rules))])
    return Nodes(points, weights)


def _gauss_hermite(count: int) -> tuple[Array, Array]:
    if count <= 100:  # numpy has tested its rule so far; with hundreds of nodes it overflows
        return np.polynomial.hermite_e.hermegauss(count)
    from scipy.special import roots_hermitenorm

    nodes, weights = roots_hermitenorm(count)
    return np.asarray(nodes), np.asarray(weights)


def side_by_side(*rules: tuple[Nodes, Codes]) -> Nodes:
    """The product of rules, each with the places (r,) of its variables among all."""
    columns = np.concatenate([places for _, places in rules])
    points, weights = np.zeros((1, 0)), np.ones(1)
    for nodes, _ in rules:
        if nodes.points.shape[1]:
            points = np.hstack([np.repeat(points, nodes.count, axis=0), np.tile(nodes.points, (len(points), 1))])
            weights = np.repeat(weights, nodes.count) * np.tile(nodes.weights, len(weights))
    return Nodes(points[:, np.argsort(columns)], weights)


def degree_three(r: int) -> Nodes:
    """``±√r e_k``: degree 3 in r variables with 2 r nodes (A. H. Stroud 1971, E_n^{r²}: 3-1)."""
    axes = np.sqrt(r) * np.eye(r)
    return Nodes(np.vstack([axes, -axes]), np.full(2 * r, 1 / (2 * r)))


@lru_cache(maxsize=64)
def degree_five(r: int, *, other: bool = False) -> Nodes:
    """Degree 5 in r variables with positive weights: 3 nodes for one, 7 for two, 15 for three, then about ``4 r²``. For
    two a hexagon about the origin. For more, corners ``a (±1, …, ±1)`` of a cube, those of `_sign_array`, and ``±b
    e_k`` with ``a² = 1 + t``, ``b² = 2 + 2/t``, weights ``a⁻⁴`` in all and ``b⁻⁴`` each, and the origin with the rest.
    ``t = 2/(r − 2)`` puts the latter where `degree_three` has its nodes, which may share their walks. The ``other``
    rule of the degree, in other axes and with ``t = 4/(r − 2)``, leaves the origin nothing: how far two of a kind are
    apart is an estimate of their error. Source: A. H. Stroud, Approximate Calculation of Multiple Integrals (1971),
    E_n^{r²}: 5-2; corners from orthogonal arrays: N. Victoir, SIAM J. Numer. Anal. 42 (2004) 209."""
    if r == 1:
        return product_rule((4 if other else 3,))
    if r == 2:
        angles = np.pi / 3 * np.arange(6)
        hexagon = 2 * np.stack([np.cos(angles), np.sin(angles)], axis=1)
        rule = Nodes(np.vstack([np.zeros((1, 2)), hexagon]), np.array([1 / 2, *[1 / 12] * 6]))
        return product_rule((4, 4)) if other else rule
    t = (4 if other else 2) / (r - 2)
    cube = np.sqrt(1 + t) * _sign_array(r)
    dual = np.sqrt(2 + 2 / t) * np.vstack([np.eye(r), -np.eye(r)])
    points = np.vstack([cube, dual])
    weights = np.array([*[(1 + t) ** -2 / len(cube)] * len(cube), *[(2 + 2 / t) ** -2] * (2 * r)])
    if other:
        axes = np.linalg.qr(np.random.default_rng(r).standard_normal((r, r)))[0]
        return Nodes(points @ axes, weights)
    return Nodes(np.vstack([np.zeros((1, r)), points]), np.array([1 - weights.sum(), *weights]))


def rotated(nodes: Nodes, rng: np.random.Generator) -> Nodes:
    """The rule in random axes, uniform among all: of the same degree."""
    r = nodes.points.shape[1]
    axes, upper = np.linalg.qr(rng.standard_normal((r, r)))
    return Nodes(nodes.points @ (axes * np.sign(np.diag(upper))), nodes.weights)


def joined(rules: Sequence[Nodes]) -> Nodes:
    """The mean of several rules for the same variables."""
    weights = np.concatenate([nodes.weights for nodes in rules]) / len(rules)
    return Nodes(np.vstack([nodes.points for nodes in rules]), weights)


def _sign_array(r: int) -> Array:
    """(N, r) of ±1, with every row its opposite: in any five columns all 32 patterns occur equally often."""
    words: list[int] = []
    reached = {0}  # sums of up to three words
    for candidate in itertools.count(1):
        if len(words) == r:
            break
        if candidate not in reached:
            pairs = {0, *words, *(a ^ b for a, b in itertools.combinations(words, 2))}
            reached |= {candidate ^ pair for pair in pairs}
            words.append(candidate)
    size = max(words).bit_length()
    if r > size:  # else the words are independent altogether: the whole cube
        words, size = [word | 1 << size for word in words], size + 1
    bits = np.arange(size)
    shared = (np.arange(1 << size)[:, None] >> bits & 1) @ (np.array(words) >> bits[:, None] & 1)
    return np.asarray(1.0 - 2.0 * (shared % 2))


def quasi_random(r: int, count: int, rng: np.random.Generator) -> Nodes:
    """About ``count`` equally weighted, randomly shifted quasi-Monte Carlo nodes in r variables. Richtmyer's sequence
    ``n √prime_k``, shifted, made normal in pairs by Box and Muller's transformation; with every point comes the
    opposite one, and a linear map gives the whole its exact covariance I: degree 3, as of every rule. Source: A. Genz,
    F. Bretz, Computation of Multivariate Normal and t Probabilities (2009), section 4.2.2; G. Ökten, A. Göncü, Math.
    Comput. Model. 53 (2011) 1268."""
    half, pairs = max(count // 2, 2 * r), (r + 1) // 2
    uniform = (np.arange(1, half + 1)[:, None] * np.sqrt(first_primes(2 * pairs)) + rng.uniform(size=2 * pairs)) % 1.0
    radius, angle = np.sqrt(-2 * np.log1p(-uniform[:, :pairs])), TURN * uniform[:, pairs:]
    z = np.hstack([radius * np.cos(angle), radius * np.sin(angle)])[:, :r]
    points = np.linalg.solve(np.linalg.cholesky(z.T @ z / half), z.T).T
    return Nodes(np.vstack([points, -points]), np.full(2 * half, 0.5 / half))


def first_primes(count: int) -> Array:
    """(count,) the first primes, as floats."""
    found: list[int] = []
    for candidate in itertools.count(2):
        if len(found) == count:
            break
        if all(candidate % prime for prime in found):
            found.append(candidate)
    return np.array(found, dtype=float)
