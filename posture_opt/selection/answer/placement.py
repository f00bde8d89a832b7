"""Where a workpiece may stand, where it was put, and how the objectives of its stations become one."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from posture_opt.numerics import TURN, Array, Mask, finite_or_none
from posture_opt.selection.tasks.workpiece import Combine, Workpiece
from posture_opt.statements import Quantity

COORDINATES = ("x", "y", "z", "yaw")
_IRRATIONAL_STEPS = np.sqrt([2.0, 3.0, 5.0, 7.0])
# What a person sets up: 0.1 mm and 0.01 degrees.
_SETTING_STEPS = np.array([1e-4, 1e-4, 1e-4, math.radians(0.01)])


@dataclass(frozen=True)
class PlacementRange:
    """A box of placements w = (x, y, z, yaw) [m, rad], ``Trans(x, y, z) Rz(yaw)`` in the world."""

    lower: Array  # (4,)
    upper: Array  # (4,), equal where a coordinate is fixed

    @classmethod
    def of(cls, workpiece: Workpiece | None) -> PlacementRange:
        """What a task says of its workpiece; its frame is the world's where it says nothing."""
        stated = workpiece or Workpiece()
        return cls(np.array(stated.lower), np.array(stated.upper))

    @property
    def free(self) -> Mask:
        """(4,) which coordinates may be chosen."""
        return np.asarray(self.upper > self.lower)

    @property
    def centre(self) -> Array:
        """(4,) the middle of the box."""
        return (self.lower + self.upper) / 2

    @property
    def all_round(self) -> bool:
        """Whether the yaw goes through a whole turn, so that its ends are none."""
        return bool(self.upper[3] - self.lower[3] >= TURN - 1e-9)

    @property
    def without_seam(self) -> PlacementRange:
        """The same box for a local search: half a turn more to either side where the yaw goes all round."""
        if not self.all_round:
            return self
        more = np.array([0.0, 0.0, 0.0, TURN / 2])
        return PlacementRange(self.lower - more, self.upper + more)

    def drawn(self, count: int, rng: np.random.Generator) -> Array:
        """(count, 4) multiples of irrational steps (R. D. Richtmyer, Los Alamos report LA-1342, 1951)."""
        steps = np.outer(np.arange(1, count + 1), _IRRATIONAL_STEPS)
        return self.lower + ((steps + rng.random(4)) % 1.0) * (self.upper - self.lower)

    def near(self, w: Array, share: float, count: int, rng: np.random.Generator) -> Array:
        """(count, 4) placements in a box of that ``share`` of this one about ``w``."""
        away = rng.uniform(-0.5, 0.5, (count, 4)) * share * (self.upper - self.lower)
        return np.clip(w + away, self.lower, self.upper)

    def tidied(self, w: Array) -> Array:
        """(4,) a placement as people write it: tenths of a millimetre, hundredths of a degree, turns taken off."""
        turned = np.array(w)
        if self.all_round:
            turned[3] = self.lower[3] + (turned[3] - self.lower[3]) % TURN
        rounded = np.where(self.free, np.rint(turned / _SETTING_STEPS) * _SETTING_STEPS, turned)
        return np.clip(rounded, self.lower, self.upper)


def placement_text(w: Array, placement: PlacementRange) -> str:
    """A placement w (4,) [m, rad] in a line, with the coordinates that are fixed or at an end."""
    texts = []
    for k, name in enumerate(COORDINATES):
        text = f"{name} {Quantity(float(w[k]), 'coordinate' if k < 3 else 'joint angle')}"
        if not placement.free[k]:
            text += " (fixed)"
        elif k < 3 or not placement.all_round:
            text += " (end of its range)" * bool(min(w[k] - placement.lower[k], placement.upper[k] - w[k]) < 1e-9)
        texts.append(text)
    return ", ".join(texts)


def placement_json(w: Array) -> dict[str, float]:
    """x, y, z [m] and yaw [rad] by name."""
    return dict(zip(COORDINATES, map(float, w), strict=True))


@dataclass(frozen=True)
class PlacementFigure:
    w: Array  # (4,) of the workpiece [m, rad], world
    sigma: float  # [m] of the worst station, or the mean; infinite where one cannot be done
    success: float | None = None  # probability that all stations succeed, where that counts

    def to_json(self) -> dict[str, Any]:
        """Plain numbers, SI; no spread where a station cannot be done."""
        figures = {"sigma": finite_or_none(self.sigma), "success_all": self.success}
        return {"workpiece": placement_json(self.w), **figures}


@dataclass(frozen=True)
class PlacementStatistics:
    placements: int  # looked at
    feasible: int  # with a posture for every station
    starts: int  # random postures led to stations
    solves: int  # of the program of all stations
    batches: int
    recurred: int  # batches that found the best optimum
    seconds: float


@dataclass(frozen=True)
class Placement(PlacementRange):
    """The placement that the stations of an answer share, in the range where the workpiece may stand."""

    w: Array  # (4,) x, y, z [m] and yaw [rad] of the workpiece, world
    statistics: PlacementStatistics | None = None  # None where it was searched for with its path
    at_centre: PlacementFigure | None = None  # None where the placement is fixed, or not feasible
    typical: PlacementFigure | None = None  # median of random feasible placements
    others: tuple[PlacementFigure, ...] = ()  # further optima, best first

    @property
    def workpiece(self) -> dict[str, float]:
        """x, y, z [m] and yaw [rad] of the workpiece, by name."""
        return placement_json(self.w)

    @property
    def central(self) -> float:
        """Standard deviation [m] in the middle of the range; NaN where that was not tried, or is not feasible."""
        return math.nan if self.at_centre is None else self.at_centre.sigma

    @property
    def search_json(self) -> dict[str, Any]:
        """What the part ``solver`` of ``solution.json`` says of the search for it."""
        return {} if self.statistics is None else vars(self.statistics)

    def bench(self, postures: Array) -> Any:
        """A map of the spread over the placement, from the postures (K, n) of an answer; None where none is made."""
        return None

    def to_json(self) -> dict[str, Any]:
        """The part ``placements`` of ``solution.json``."""
        return {
            "centre": None if self.at_centre is None else self.at_centre.to_json(),
            "typical": None if self.typical is None else self.typical.to_json(),
            "others": [other.to_json() for other in self.others],
        }


ALMOST_ONE = 1 - 1e-9  # of a probability to miss: the logarithm of its complement stays finite


def combined_symbols(combine: Combine, main: ca.MX, extra: ca.MX) -> ca.MX:
    """The objective of K stations, from terms f = ``main`` and e = ``extra`` (K, 1).

    ``worst``: ``max(f_k + e_k)``; ``mean``: ``Σ sqrt(f_k)/K + Σ e_k/K``; ``success``, f logarithms of the probability
    to miss: ``log(−Σ log(1 − exp f_k)) + Σ e_k/K``.
    """
    if combine == "worst":
        return ca.mmax(main + extra)
    count = main.shape[0]
    further = ca.sum1(extra) / count
    if combine == "mean":
        return ca.sum1(ca.sqrt(ca.fmax(main, 0) + 1e-12)) / count + further
    return ca.log(ca.sum1(-ca.log1p(-ALMOST_ONE * ca.exp(main)))) + further


def combined_success(success: ca.MX, extra: ca.MX) -> ca.MX:
    """``log(−log P) + Σ e_k/K``, P the mean over N draws of shared errors of the product of ``success`` (K, N)."""
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
