"""The covariance of the lecture's arm written out by hand: what a controller evaluates in every cycle.

A test holds them, and their print in docs/lecture/lecture.md, against the package. Lengths in m, angles in rad.
"""

from __future__ import annotations

import numpy as np


def first_order(t1, t2, a1, a2, v1, v2, w1, w2):
    """(Cxx, Cxy, Cyy) [m²] of J Σ Jᵀ, independent sources.

    Args:
        t1, t2: joint angles; a1, a2: lengths of the links.
        v1, v2: variances of the joint angles [rad²]; w1, w2: of the lengths [m²].
    """
    c1, s1, c, s = np.cos(t1), np.sin(t1), np.cos(t1 + t2), np.sin(t1 + t2)
    x, y, e, f = a1 * c1 + a2 * c, a1 * s1 + a2 * s, a2 * c, a2 * s
    return (
        y * y * v1 + f * f * v2 + c1 * c1 * w1 + c * c * w2,
        -x * y * v1 - e * f * v2 + s1 * c1 * w1 + s * c * w2,
        x * x * v1 + e * e * v2 + s1 * s1 * w1 + s * s * w2,
    )


def exact(t1, t2, a1, a2, v1, v2, w1, w2):
    """(Cxx, Cxy, Cyy) [m²] for independent Gaussian errors of any size; arguments as of `first_order`.

    With z = x + i y: Cxx + Cyy = E|z|² − |E z|² and Cxx − Cyy + 2i Cxy = E z² − (E z)², and E e^(i(φ + e)) =
    e^(iφ − v/2) for an error e of variance v.
    """
    t12, v12 = t1 + t2, v1 + v2
    g1, g2 = a1 * np.exp(-v1 / 2), a2 * np.exp(-v12 / 2)
    mx, my = g1 * np.cos(t1) + g2 * np.cos(t12), g1 * np.sin(t1) + g2 * np.sin(t12)
    h1, h2 = (a1 * a1 + w1) * np.exp(-2 * v1), (a2 * a2 + w2) * np.exp(-2 * v12)
    h = 2 * a1 * a2 * np.exp(-2 * v1 - v2 / 2)
    p = a1 * a1 + w1 + a2 * a2 + w2 + 2 * a1 * a2 * np.exp(-v2 / 2) * np.cos(t2) - mx * mx - my * my
    q = h1 * np.cos(2 * t1) + h2 * np.cos(2 * t12) + h * np.cos(t1 + t12) - mx * mx + my * my
    r = h1 * np.sin(2 * t1) + h2 * np.sin(2 * t12) + h * np.sin(t1 + t12) - 2 * mx * my
    return (p + q) / 2, r / 2, (p - q) / 2
