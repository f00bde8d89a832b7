"""``Critical``: the part of a spread that a task cares about."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from posture_opt.numerics import Array, Json
from posture_opt.uncertainty.regions.clearance import coverage_radius
from posture_opt.uncertainty.regions.regions import RANK_TOLERANCE, deviation

# The part of the spread: across the direction of the task, along it, or all of it
Within = Literal["across", "along", "all"]
# The parts by name, as sentences have them
PARTS: dict[str, str] = {"across": "across the direction", "along": "along the direction", "all": "in space"}


@dataclass(frozen=True)
class Critical:
    """The part of the spread that counts for the task."""

    within: Within  # across the direction, along it, or all of it
    basis: Array  # (m, 3) unit vectors, one a row as in the documents, world
    covariance: Array  # (m, m) in that basis [m²]
    bias: Array  # (m,) mean shift in that basis [m]
    sigma_max: float  # largest standard deviation [m]
    worst_axis: Array  # (3,) the direction of it, world; its largest component is positive

    @classmethod
    def of(cls, within: Within, basis: Array, covariance: Array, bias: Array) -> Critical:
        """The part of a spread in a basis. basis: (3, m) orthonormal columns, world; covariance: (3, 3) [m²], world;
        bias: (3,) mean shift [m], world."""
        C, b = basis.T @ covariance @ basis, basis.T @ bias
        values, vectors = np.linalg.eigh(C)
        if values[-1] <= RANK_TOLERANCE * np.trace(covariance):
            C = np.zeros_like(C)  # what nothing moves: rounding
        worst = basis @ vectors[:, -1]
        worst = worst * np.sign(worst[np.argmax(np.abs(worst))])  # as the axes of an ellipse: a line, written one way
        sigma_max = deviation(float(values[-1]), covariance)
        return cls(within, basis.T, C, b, sigma_max, worst)

    @cached_property
    def radius95(self) -> float:
        """Distance from the target that 95 % of all tool points stay within [m]."""
        return coverage_radius(0.95, self.covariance, self.bias)

    def to_json(self) -> dict[str, Json]:
        return {
            "within": self.within,
            "sigma_max": self.sigma_max,
            "basis": self.basis.tolist(),
            "covariance": self.covariance.tolist(),
            "radius95": self.radius95,
        }
