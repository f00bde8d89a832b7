"""How the objectives of several stations become one: the largest, the mean, or the probability that all succeed."""

from __future__ import annotations

import casadi as ca
import numpy as np

from posture_opt.numerics import Array
from posture_opt.selection.tasks.workpiece import Combine

ALMOST_ONE = 1 - 1e-9  # of a probability to miss: the logarithm of its complement stays finite
_LEAST_VARIANCE = 1e-12  # under the root of a scaled variance, about 1


def combined_symbols(combine: Combine, main: ca.MX, extra: ca.MX) -> ca.MX:
    """The objective of K stations as a symbol.

    ``worst``: ``max(f_k + e_k)``; ``mean``: ``Σ sqrt(f_k)/K + Σ e_k/K``; ``success``: ``log(−Σ log(1 − exp f_k)) +
    Σ e_k/K``, as the logarithm of the probability of missing any.

    Args:
        main: (K, 1) first terms f, scaled variances; of the criterion ``miss`` the logarithms of the probabilities.
        extra: (K, 1) sums of the further terms e.
    """
    if combine == "worst":
        return ca.mmax(main + extra)
    count = main.shape[0]
    further = ca.sum1(extra) / count
    if combine == "mean":
        return ca.sum1(ca.sqrt(ca.fmax(main, 0) + _LEAST_VARIANCE)) / count + further
    return ca.log(ca.sum1(-ca.log1p(-ALMOST_ONE * ca.exp(main)))) + further


def combined_success(success: ca.MX, extra: ca.MX) -> ca.MX:
    """``log(−log P) + Σ e_k/K`` of K stations that share errors, P the mean over N draws of the product of ``success``.

    Args:
        success: (K, N) probabilities given the draws.
        extra: (K, 1) sums of the further terms e.
    """
    count, draws = success.shape
    product = success[0, :]
    for k in range(1, count):
        product *= success[k, :]
    return ca.log(-ca.log(ALMOST_ONE * ca.sum2(product) / draws + 1e-300)) + ca.sum1(extra) / count


def combined_numbers(combine: Combine, main: Array, extra: Array) -> Array:
    """(M,) the same of numbers (M, K), where the first terms are infinite if a station cannot be done."""
    with np.errstate(divide="ignore", invalid="ignore"):
        if combine == "worst":
            return np.asarray((main + extra).max(axis=1))
        further = extra.mean(axis=1)
        if combine == "mean":
            return np.asarray(np.sqrt(np.maximum(main, 0.0)).mean(axis=1) + further)
        total = np.log(np.sum(-np.log1p(-np.exp(np.minimum(main, -1e-9))), axis=1)) + further
    return np.where(np.isfinite(main).all(axis=1), total, np.inf)


def combined_sigma(combine: Combine, sigma: Array) -> Array:
    """(...) the standard deviation [m] that an answer is stated by, of those of its stations (..., K)."""
    return np.asarray(sigma.mean(axis=-1) if combine == "mean" else sigma.max(axis=-1))
