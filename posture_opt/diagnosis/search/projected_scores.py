"""What candidates of a few columns each explain, from their Gram matrices and scores alone; thousands at once."""

from __future__ import annotations

import numpy as np

from posture_opt.diagnosis.scores import levels
from posture_opt.numerics import Array


def principal_scores(gram: Array, score: Array) -> tuple[Array, Array]:
    """Eigenvalues (n, k) of Gram matrices (n, k, k), and squares of the scores (n, k) along their eigenvectors.

    In closed form up to two columns, of which there are thousands.
    """
    if gram.shape[1] == 1:
        return gram[:, 0], score**2
    if gram.shape[1] > 2:
        values, vectors = np.linalg.eigh(gram)
        return values, np.einsum("ikl,ik->il", vectors, score) ** 2
    a, b, c = gram[:, 0, 0], gram[:, 0, 1], gram[:, 1, 1]
    half = np.hypot((a - c) / 2, b)
    angle = np.arctan2(2 * b, a - c) / 2
    x, y = np.cos(angle), np.sin(angle)
    values = np.stack([(a + c) / 2 + half, (a + c) / 2 - half], axis=1)
    along = np.stack([x * score[:, 0] + y * score[:, 1], x * score[:, 1] - y * score[:, 0]], axis=1)
    return values, along**2


def explained_squares(gram: Array, score: Array) -> tuple[Array, Array]:
    """(n,) what candidates explain along the eigenvectors that are new, and how many these are.

    Args:
        gram: (n, k, k) of columns of former length one, projected off what was chosen; score: (n, k).
    """
    values, parts = principal_scores(gram, score)
    clear = values > levels.MIN_DISTINCT_SHARE
    gain = np.sum(np.where(clear, parts / np.maximum(values, levels.MIN_DISTINCT_SHARE), 0.0), axis=1)
    return gain, clear.sum(axis=1)


def projected_gains(gram: Array, inner: Array, score: Array) -> Array:
    """(n,) what candidates explain of residuals, given a basis of what was chosen.

    Args:
        gram: (n, k, k) inner products of the columns of each, of any lengths.
        inner: (n, k, p) those with the basis; score: (n, k) those with the residuals that it leaves.
    """
    scale = 1 / np.sqrt(np.maximum(np.einsum("ikk->ik", gram), 1e-300))
    rest = (gram - inner @ np.swapaxes(inner, 1, 2)) * scale[:, :, None] * scale[:, None, :]
    return explained_squares(rest, score * scale)[0]
