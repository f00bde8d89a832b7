"""Noise of the instrument and of the joints, and the kinds of the catalogue that are nothing else."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tests.hidden.effects import Site
from tests.hidden.mechanics import Array, columns
from tests.hidden.strength import noise_strength

NOISES = ("outliers", "joint_noise", "range_noise", "stated_sigma")
SIGMA = 0.05e-3  # m, stated of each coordinate


@dataclass(frozen=True)
class Noise:
    """σ = factor · (a + b r), r from the world's origin, where the instrument stands; joints scatter at every visit."""

    a: float = SIGMA
    b: float = 0.0
    factor: float = 1.0
    joint: int = -1
    joint_sigma: float = 0.0
    gross: int = 0  # rows that are wrong by ``gross_size``
    gross_size: float = 0.0
    freedom: float = 0.0  # of Student's t, scaled to the same variance; 0: Gaussian

    def sigma(self, p: Array) -> Array:
        return np.asarray(self.factor * (self.a + self.b * np.linalg.norm(p, axis=1)))

    def draw(self, rng: np.random.Generator, site: Site) -> tuple[Array, Array]:
        """(N, 3) what is added to the measured points, and the rows (gross,) with gross errors."""
        N, p = len(site.session), site.walk.p
        if self.freedom:
            white = rng.standard_t(self.freedom, (N, 3)) / np.sqrt(self.freedom / (self.freedom - 2))
        else:
            white = rng.normal(size=(N, 3))
        noise = white * self.sigma(p)[:, None]
        if self.joint_sigma:
            noise = noise + lever(site, self.joint) * rng.normal(0, self.joint_sigma, (N, 1))
        rows = rng.choice(N, self.gross, replace=False) if self.gross else np.zeros(0, int)
        errors = rng.normal(size=(len(rows), 3))
        errors *= self.gross_size * rng.uniform(0.6, 1.7, (len(rows), 1)) / np.linalg.norm(errors, axis=1)[:, None]
        noise[rows] += errors
        return noise, np.sort(rows)

    def strength(self, site: Site) -> float:
        """λ against Gaussian noise of one σ; of gross errors, their expected χ²."""
        k = list(site.arm.measured)
        if self.gross:
            return float(self.gross * (self.gross_size / self.a) ** 2)
        blocks = np.eye(len(k)) * self.sigma(site.walk.p)[:, None, None] ** 2
        if self.joint_sigma:
            J = lever(site, self.joint)[:, k] * self.joint_sigma
            blocks = blocks + J[:, :, None] * J[:, None, :]
        if self.factor != 1.0:  # against the stated σ itself
            n = len(blocks) * len(k)
            return float(n * (self.factor**2 - 1 - 2 * np.log(self.factor)))
        return noise_strength(blocks)


def lever(site: Site, joint: int) -> Array:
    """(N, 3) ∂p/∂q of a joint."""
    name = site.arm.joints[joint]
    d = columns(site.walk, site.arm)
    factor = next(f for f in site.arm.factors if f.joint == joint)
    return np.asarray(factor.sign * d[f"{name}.{factor.name.rpartition('.')[2]}"])


def draw_noise(rng: np.random.Generator, site: Site, kind: str) -> tuple[Noise, dict]:
    """A noise of a kind, and its entry of the truth."""
    if kind == "joint_noise":
        j = int(rng.choice([j for j in range(site.arm.n) if not site.arm.prismatic[j]]))
        s = float(np.exp(rng.uniform(np.log(0.05e-3), np.log(0.3e-3))))
        return Noise(joint=j, joint_sigma=s), _entry(kind, site.arm.joints[j], sigma=s)
    if kind == "range_noise":
        near, far = np.quantile(np.linalg.norm(site.walk.p, axis=1), [0.0, 1.0])
        b = SIGMA * rng.uniform(0.5, 2.0) / (far - near)
        return Noise(a=0.3 * SIGMA - b * near, b=b), _entry(kind, "instrument", b=b)
    if kind == "stated_sigma":
        factor = float(rng.choice([rng.uniform(0.5, 0.75), rng.uniform(1.35, 3.0)]))
        return Noise(factor=factor), _entry(kind, "data", factor=factor)
    size = float(np.exp(rng.uniform(np.log(0.4e-3), np.log(3e-3))))
    count = int(rng.integers(1, 5))
    return Noise(gross=count, gross_size=size), _entry(kind, "data", count=count)


def _entry(kind: str, target: str, **size: float) -> dict:
    return {"kind": kind, "target": target, "size": size, "shape": {}}
