"""The planar 2R arm by hand: positions, inverse kinematics and moments, without a line of the package."""

from __future__ import annotations

import numpy as np

SOURCES = ("joint1.theta", "joint2.theta", "joint1.a", "joint2.a")


def position(q, a=(1.0, 1.0)):
    """(..., 2) tool point of postures (..., 2)."""
    t1, t12 = q[..., 0], q[..., 0] + q[..., 1]
    x = a[0] * np.cos(t1) + a[1] * np.cos(t12)
    return np.stack([x, a[0] * np.sin(t1) + a[1] * np.sin(t12)], axis=-1)


def postures_at(points):
    """(2, ..., 2) both elbows for points (..., 2) of the arm with links of 1 m; NaN out of reach."""
    x, y = points[..., 0], points[..., 1]
    with np.errstate(invalid="ignore"):
        elbow = np.arccos((x**2 + y**2 - 2) / 2)
    both = []
    for t2 in (elbow, -elbow):
        t1 = np.arctan2(y, x) - np.arctan2(np.sin(t2), 1 + np.cos(t2))
        both.append(np.stack([(t1 + np.pi) % (2 * np.pi) - np.pi, t2], axis=-1))
    return np.array(both)


def first_order(q, covariance, a=(1.0, 1.0)):
    """(..., 2, 2) J Σ Jᵀ, sources in the order of ``SOURCES``."""
    t1, t12 = q[..., 0], q[..., 0] + q[..., 1]
    c1, s1, c12, s12 = np.cos(t1), np.sin(t1), np.cos(t12), np.sin(t12)
    J = np.array([
        [-a[0] * s1 - a[1] * s12, -a[1] * s12, c1, c12],
        [a[0] * c1 + a[1] * c12, a[1] * c12, s1, s12],
    ])  # fmt: skip
    J = np.moveaxis(J, (0, 1), (-2, -1))
    return J @ covariance @ np.swapaxes(J, -1, -2)


def exact(q, covariance, a=(1.0, 1.0)):
    """(..., 2, 2) covariance for jointly Gaussian errors in the order of ``SOURCES``.

    The point is ``z = Σ (a_m + δ_m) exp(i (φ_m + ε_m))`` in the complex plane. For Gaussian δ, ε and ``s`` of variance
    v: ``E exp(is) = e^(-v/2)``, ``E δ exp(is) = i k e^(-v/2)``, ``E δ δ' exp(is) = (cov(δ, δ') - k k') e^(-v/2)`` with
    ``k = cov(δ, s)``: derivatives of the characteristic function.
    """
    angle = np.array([[1, 0, 0, 0], [1, 1, 0, 0]])  # errors of the links' directions
    length = np.array([[0, 0, 1, 0], [0, 0, 0, 1]])
    phi = [q[..., 0], q[..., 0] + q[..., 1]]
    mean, zz, zc = 0, 0, 0
    for m in range(2):
        v, k = _second(angle[m], angle[m], covariance), _second(length[m], angle[m], covariance)
        mean = mean + (a[m] + 1j * k) * np.exp(-v / 2) * np.exp(1j * phi[m])
        for n in range(2):
            for sign in (1, -1):
                s = angle[m] + sign * angle[n]
                v, km, kn = (_second(u, s, covariance) for u in (s, length[m], length[n]))
                both = _second(length[m], length[n], covariance) - km * kn
                factor = (a[m] * a[n] + 1j * (a[m] * kn + a[n] * km) + both) * np.exp(-v / 2)
                term = factor * np.exp(1j * (phi[m] + sign * phi[n]))
                zz, zc = (zz + term, zc) if sign > 0 else (zz, zc + term)
    zz, zc = zz - mean**2, (zc - abs(mean) ** 2).real
    xx, yy, xy = (zc + zz.real) / 2, (zc - zz.real) / 2, zz.imag / 2
    return np.moveaxis(np.array([[xx, xy], [xy, yy]]), (0, 1), (-2, -1))


def _second(u, w, covariance):
    return float(u @ covariance @ w)
