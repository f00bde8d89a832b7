"""How strong a hidden effect is: the noncentrality λ of its whitened signature beside the geometry that is fitted.

For an effect on the mean, λ = |P⊥ W Δp|², P⊥ off the tangent of all geometric parameters that the data determine
(singular values above 1e-5 of the largest, columns of unit norm). For an effect on the noise, λ is twice the Kullback
distance to the best noise of the stated form.
"""

from __future__ import annotations

import numpy as np

from tests.hidden.effects import Effect, Site, measured
from tests.hidden.mechanics import Array, columns

KEPT = 1e-5
DETECTABLE = 25.0


def names_of(site: Site, frames: bool) -> list[str]:
    """Geometric parameters that a calibration may move; those of the frames only where they are free."""
    arm, found = site.arm, []
    for f in arm.factors:
        prefix, _, last = f.name.rpartition(".")
        if not f.name or (prefix in ("base", "tool") and not frames):
            continue
        if prefix == "tool" and last in ("roll", "pitch", "yaw"):
            continue
        if last == "beta" and arm.joints.index(prefix) not in arm.parallel:
            continue
        found.append(f.name)
    return found


def tangent(site: Site, names: list[str], sigma: float) -> Array:
    """(N k, P) whitened derivatives of the measured coordinates."""
    w, k = columns(site.walk, site.arm), list(site.arm.measured)
    if not names:
        return np.zeros((len(site.session) * len(k), 0))
    return np.stack([w[name][:, k].ravel() for name in names], axis=1) / sigma


def basis(J: Array) -> Array:
    """(m, rank) orthonormal basis of the columns."""
    norms = np.linalg.norm(J, axis=0)
    J = J[:, norms > 1e-9 * max(norms.max(initial=0.0), 1e-300)]
    if not J.shape[1]:
        return np.zeros((len(J), 0))
    U, s, _ = np.linalg.svd(J / np.linalg.norm(J, axis=0), full_matrices=False)
    return np.asarray(U[:, s > KEPT * s[0]])


def off(U: Array, x: Array) -> Array:
    return np.asarray(x - U @ (U.T @ x))


def signature(site: Site, effects: tuple[Effect, ...], sigma: float) -> Array:
    """(N k,) whitened change of the measured coordinates."""
    k = list(site.arm.measured)
    return np.asarray((measured(site, effects) - site.walk.p)[:, k].ravel() / sigma)


def components(site: Site, e: Effect, sigma: float) -> Array:
    """(N k, c) whitened signatures of the linear parameters of an effect, each at the effect's own size."""
    size = max(abs(v) for v in e.size.values())
    # Lengths and angles of one effect are of one order here.
    return np.stack([signature(site, (e.only(name, size),), sigma) for name in e.size], axis=1)


def strength(site: Site, e: Effect, U: Array, sigma: float) -> float:
    """λ of one effect."""
    z = off(U, signature(site, (e,), sigma))
    return float(z @ z)


def strain(e: Effect) -> float:
    """What many parameters cost: the factor on λ that keeps the power of 25 at one parameter.

    To be found 93 % of the time at one false alarm in 2150 takes λ = 25, 30 and 48 at 1, 3 and 18 parameters, by the
    noncentral χ². Up to three, 25 is kept as the definition.
    """
    return max(1.0, len(e.size) / 3) ** 0.36


def noise_strength(covariances: Array) -> float:
    """λ of blocks (N, k, k) of true covariance against one common variance."""
    common = np.trace(covariances, axis1=1, axis2=2).mean() / covariances.shape[1]
    N, k = covariances.shape[:2]
    return float(N * k * np.log(common) - np.linalg.slogdet(covariances)[1].sum())


def reference_rms(site: Site, errors: Array, model: Array, folds: int = 10) -> float:
    """Cross-validated RMS [m] of the model whose tangent (N k, P) is given, poses held out together.

    ``errors`` (N, k) [m] are the measured less the true coordinates, so that the truth is at zero.
    """
    U = basis(model)
    pose = site.session.pose
    k = errors.shape[1]
    left = np.zeros_like(errors)
    for fold in range(folds):
        out = pose % folds == fold
        rows, held = np.repeat(~out, k), np.repeat(out, k)
        x = np.linalg.lstsq(U[rows], errors[~out].ravel(), rcond=None)[0]
        left[out] = errors[out] - (U[held] @ x).reshape(-1, k)
    return float(np.sqrt((left**2).sum(axis=1).mean()))
