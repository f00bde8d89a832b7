"""Monte Carlo of a chain of elementary transforms in plain NumPy, written without a line of the package."""

from __future__ import annotations

import numpy as np

BLOCKS = 40


def poses(factors, q, errors, n):
    """Tool points (3, n) and the columns (3, 3, n) of the rotation, errors (n,) by place in the chain."""
    columns = [np.eye(3)[:, k : k + 1] for k in range(3)]
    x = np.zeros((3, 1))
    for place, f in enumerate(factors):
        value = f.nominal + errors.get(place, 0.0) + (q[f.joint] if f.joint is not None else 0.0)
        if f.kind == "translate":
            x = x + columns[f.axis] * value
            continue
        i, j = (f.axis + 1) % 3, (f.axis + 2) % 3
        c, s = np.cos(value), np.sin(value)
        columns[i], columns[j] = c * columns[i] + s * columns[j], c * columns[j] - s * columns[i]
    return np.broadcast_to(x, (3, n)), np.stack([np.broadcast_to(column, (3, n)) for column in columns])


def rotation_vectors(columns, nominal):
    """(3, n) logarithms of R R₀ᵀ, world axes."""
    M = np.einsum("kan,kb->abn", columns, nominal[:, :, 0])
    axial = np.stack([M[2, 1] - M[1, 2], M[0, 2] - M[2, 0], M[1, 0] - M[0, 1]]) / 2
    sine = np.linalg.norm(axial, axis=0)
    angle = np.arctan2(sine, (np.trace(M) - 1) / 2)
    return axial * (angle / np.where(sine > 0, sine, 1.0))


def sampled_pose(robot, q, names, covariance, n, seed=0):
    """Mean (6,) and covariance (6, 6) of shift and rotation vector, and the standard error of every entry.

    The errors are those of the means over 40 blocks of the sample.
    """
    place = {f.parameter: i for i, f in enumerate(robot.factors) if f.parameter}
    rng = np.random.default_rng(seed)
    sigma = np.sqrt(np.diag(covariance))
    values, vectors = np.linalg.eigh(covariance / np.outer(sigma, sigma))
    root = sigma[:, None] * vectors * np.sqrt(np.clip(values, 0, None))
    x0, R0 = poses(robot.factors, q, {}, 1)
    blocks = []
    for _ in range(BLOCKS):
        p = root @ rng.standard_normal((len(names), n // BLOCKS))
        x, R = poses(robot.factors, q, {place[name]: p[k] for k, name in enumerate(names)}, n // BLOCKS)
        blocks.append(np.vstack([x - x0, rotation_vectors(R, R0)]))
    mean = np.mean([block.mean(axis=1) for block in blocks], axis=0)
    covariances = np.array([(b - mean[:, None]) @ (b - mean[:, None]).T / b.shape[1] for b in blocks])
    means = np.array([b.mean(axis=1) for b in blocks])
    root_n = np.sqrt(BLOCKS)
    return mean, covariances.mean(axis=0), means.std(axis=0, ddof=1) / root_n, covariances.std(axis=0, ddof=1) / root_n
