"""Which rows belong to one visit, and which revisit one posture."""

from __future__ import annotations

import numpy as np

from posture_opt.measurements.measurements import Measurements
from posture_opt.numerics import Array, Codes, Mask

NEAR = 1e-3  # rad: commands that differ by less lead to one posture
_SLIDE = 1e-4  # m: the same of a slide


def repeat_groups(data: Measurements, slides: Mask) -> Codes:
    """(N,) a code for each row: rows of one code revisit one posture with one target.

    Rows of one pose do, and so do rows whose joint values agree within 1 mrad or 0.1 mm: joint values that were
    read back never agree to the last digit. Rows strung out along a slow path are no revisits.

    Args:
        slides: (n,) which joints are prismatic.
    """
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    posture = np.column_stack([data.q / np.where(slides, _SLIDE, NEAR), data.target * 1e6, data.robot * 1e6])
    pairs = cKDTree(posture).query_pairs(1.0, p=np.inf, output_type="ndarray")
    n = len(data)
    near = coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(n, n))
    code = np.asarray(connected_components(near, directed=False)[1], dtype=np.intp)
    own = np.unique(np.column_stack([data.pose, data.target, data.robot]), axis=0, return_inverse=True)[1].ravel()
    strung = np.array([np.ptp(posture[rows], axis=0).max() > 1.0 for rows in rows_of(code)])
    merged = np.where(strung[code], own + n, code)
    # A pose keeps together whatever its joint values were.
    first = np.full(own.max() + 1, -1)
    first[own[::-1]] = merged[::-1]
    return np.asarray(np.unique(first[own], return_inverse=True)[1], dtype=np.intp)


def repeat_of_row(data: Measurements) -> Codes:
    """(N,) the visit of each row, counted from 0: rows that follow each other at one pose, whatever their target.

    The arm has not moved between them, so that one draw of the joints' scatter is in all of them.
    """
    sides = data.approach if data.approach_given else np.zeros((len(data), 0))
    place = np.column_stack([data.pose, data.robot, sides])
    return np.asarray(np.cumsum(np.any(np.diff(place, axis=0, prepend=place[:1]) != 0, axis=1)), dtype=np.intp)


def rows_of(codes: Codes) -> list[Codes]:
    """The rows of each code, in the order of the codes."""
    order = np.argsort(codes, kind="stable")
    return np.split(order, np.flatnonzero(np.diff(codes[order])) + 1)


def outlying_groups(size: Array, freedom: Array) -> Mask:
    """(G,) postures whose visits differ far more than the others explain: a slip or a wrong reading, no scatter.

    The scale is the median's, which these cannot move far. Gross is twice what Gaussian visits reach once in a thousand
    sets of data; twice, because scatter is neither round nor the same at every posture.

    Args:
        size: (G,) sum of squares about the mean of each posture's visits [m²].
        freedom: (G,) how many coordinates it sums, those of the mean taken off.
    """
    from scipy.special import chdtri

    if not len(freedom):
        return np.zeros(0, dtype=bool)
    scale = np.median(size / chdtri(freedom, 0.5))
    return np.asarray(size > 4 * scale * chdtri(freedom, 1e-3 / len(freedom)))
