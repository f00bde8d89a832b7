"""The numbers of lecture.md: what the lecture prints, what the package computes, and what chance allows."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

import posture_opt as po
from posture_opt.uncertainty.regions import coverage_factor, coverage_probability
from posture_opt.uncertainty.sampler import wilson_interval

PROBLEMS = Path(__file__).resolve().parents[2] / "problems"
SMALL, LARGE = 50, 1_000_000
BESIDE = 200_000  # points of the clouds beside the closing question
CLOUD_SIZES = (50, 1000)
PLANE = np.ix_((0, 1), (0, 1))
ENTRIES = {"Cxx": (0, 0), "Cxy": (0, 1), "Cyy": (1, 1)}
HALF_DIGIT = 0.5e-5  # m²: the lecture prints five decimals


@dataclass(frozen=True)
class Printed:
    """What the lecture prints [m²]; the eigenvectors stand in rows, one for each eigenvalue."""

    C: tuple[tuple[float, float], tuple[float, float]]
    eigenvalues: tuple[float, float]
    vectors: tuple[tuple[float, float], tuple[float, float]]

    @property
    def matrix_eigenvalues(self) -> np.ndarray:
        """(2,) eigenvalues of the printed matrix."""
        return np.linalg.eigvalsh(np.array(self.C))

    @property
    def rebuilt(self) -> np.ndarray:
        """(2, 2) the matrix of the printed eigenvalues and eigenvectors."""
        units = [np.array(v) / np.linalg.norm(v) for v in self.vectors]
        return sum(value * np.outer(v, v) for value, v in zip(self.eigenvalues, units, strict=True))


@dataclass(frozen=True)
class Example:
    """One example of the lecture: its problem file and the posture [deg]."""

    file: str
    degrees: tuple[float, float]
    printed: Printed | None = None

    @property
    def q(self) -> list[float]:
        return [math.radians(angle) for angle in self.degrees]

    @cached_property
    def problem(self):
        return po.load_problem(PROBLEMS / f"{self.file}.yaml")

    @cached_property
    def spread(self):
        return po.propagate(self.problem, self.q)

    @cached_property
    def first(self) -> np.ndarray:
        return self.spread.covariance_first_order[PLANE]

    @cached_property
    def exact(self) -> np.ndarray:
        return self.spread.covariance[PLANE]

    @cached_property
    def small(self):
        return po.simulate(self.problem, self.q, n=SMALL, seed=0)

    @cached_property
    def large(self):
        return po.simulate(self.problem, self.q, n=LARGE, seed=0)

    def within(self, k: float) -> tuple[float, tuple[float, float]]:
        """The part of the large cloud inside the k-sigma ellipse of the exact covariance, with its 95 % interval."""
        inside = int(np.count_nonzero(self.spread.ellipse.mahalanobis(self.large.points[:, :2]) <= k))
        return inside / LARGE, wilson_interval(inside, LARGE)


EXAMPLES = {
    "angles": Example("lecture_folded_angles", (90, -180)),
    "lengths": Example("lecture_folded_lengths", (90, -180)),
    "folded": Example(
        "lecture_folded_all", (90, -180),
        Printed(((3.0e-4, -1e-5), (-1e-5, 2.2e-4)), (1.9e-4, 3.0e-4), ((0.074, -0.99), (-0.99, -0.074))),
    ),
    "bent": Example(
        "lecture_bent_equal_angles", (90, -135),
        Printed(((2.3e-4, -3e-5), (-3e-5, 4.2e-4)), (2.3e-4, 4.2e-4), ((-0.98, 0.14), (0.14, 0.98))),
    ),
    "weak": Example(
        "lecture_bent_weak_elbow", (90, -135),
        Printed(((1.48e-3, 1.26e-3), (1.26e-3, 1.73e-3)), (3.3e-4, 2.9e-3), ((-0.74, 0.67), (0.67, 0.74))),
    ),
    "correlated": Example("lecture_folded_correlated_lengths", (90, -180)),
    "correlated_stretched": Example("lecture_folded_correlated_lengths", (90, 0)),
}  # fmt: skip


@dataclass(frozen=True)
class Chance:
    """What sampling does to one entry of the covariance of n Gaussian points whose true covariance is C."""

    C: np.ndarray
    entry: tuple[int, int]
    n: int

    def cdf(self, value: float) -> float:
        """Probability that the sample entry (n − 1 in the denominator) is at most ``value`` [m²].

        A sample variance is ``σ² χ²/ν``. A sample covariance is
        ``σx σy ((1 + ρ) χ² − (1 − ρ) χ'²) / 2ν`` with two independent χ² of ν = n − 1 degrees of freedom, because
        ``4 xy = (x + y)² − (x − y)²`` and sum and difference of standardised x and y are independent.
        """
        from scipy.integrate import quad
        from scipy.special import gammainc, gammaincinv

        (i, j), half = self.entry, (self.n - 1) / 2
        if i == j:
            return float(gammainc(half, max(value, 0.0) * half / self.C[i, i]))
        sigma = math.sqrt(self.C[i, i] * self.C[j, j])
        rho = self.C[i, j] / sigma
        low, high = gammaincinv(half, [1e-14, 1 - 1e-14])

        # In h = χ²/2, whose distribution function is the incomplete gamma function: scipy.stats is forty times slower.
        def given(h: float) -> float:
            density = math.exp((half - 1) * math.log(h) - h - math.lgamma(half))
            other = (2 * half * value / sigma + (1 - rho) * h) / (1 + rho)
            return density * float(gammainc(half, max(other, 0.0)))

        return min(1.0, quad(given, low, high, epsabs=1e-13, epsrel=1e-10, limit=400)[0])

    def quantile(self, p: float) -> float:
        """The value [m²] below which the sample entry stays with probability p."""
        from scipy.optimize import brentq

        i, j = self.entry
        sd = math.sqrt((self.C[i, i] * self.C[j, j] + self.C[i, j] ** 2) / (self.n - 1))
        low = 0.0 if i == j else self.C[i, j] - 12 * sd
        return float(brentq(lambda v: self.cdf(v) - p, low, self.C[i, j] + 12 * sd, xtol=1e-12))

    def as_far_as(self, printed: float) -> float:
        """Two-sided probability of an entry that lies, as printed to five decimals, at least so far off."""
        i, j = self.entry
        if abs(printed - self.C[i, j]) <= HALF_DIGIT:
            return 1.0
        if printed < self.C[i, j]:
            return min(1.0, 2 * self.cdf(printed + HALF_DIGIT))
        return min(1.0, 2 * (1 - self.cdf(printed - HALF_DIGIT)))


@dataclass(frozen=True)
class Place:
    """A posture of the closing question [deg] and what scatters there [m]."""

    what: str
    degrees: tuple[float, float]
    position: np.ndarray
    first: float
    exact: float
    cloud: float
    interval: tuple[float, float]


class Closing:
    """The closing question: the answer, its rivals, and the map over both joint angles."""

    STEP = 1.0  # deg, of the map

    @cached_property
    def problem(self):
        # The lecture's hole may stand anywhere in reach, that of the built-in problem in front of the arm only.
        built_in = po.load_problem(PROBLEMS / "insert_planar_2r.yaml").to_dict()
        del built_in["task"]["region"]
        return po.problem_from_dict(built_in)

    @cached_property
    def solution(self):
        return po.select_posture(self.problem)

    def place(self, what: str, degrees: tuple[float, float], problem=None) -> Place:
        problem = problem or self.problem
        q = [math.radians(angle) for angle in degrees]
        spread = po.propagate(problem, q)
        cloud = po.simulate(problem, q, n=BESIDE, seed=0)
        low, high = np.sqrt(np.maximum(cloud.covariance_interval[0, 0], 0))
        sigmas = (spread.covariance_first_order[0, 0], spread.covariance[0, 0], cloud.covariance[0, 0])
        return Place(what, degrees, spread.position, *map(math.sqrt, sigmas), (low, high))

    @cached_property
    def optima(self) -> list[Place]:
        """The distinct optima that the package finds, best first; of two mirror images the one to the right."""
        found: dict[str, tuple[float, float]] = {}
        for alternative in self.solution.alternatives:
            degrees = [math.degrees(value) for value in alternative.posture.values()]
            # -180 and 180 deg are one posture; rounding must not decide which of them is printed.
            t1, t2 = (180.0 if abs(abs(d) - 180) < 1e-3 else round(d, 3) + 0.0 for d in degrees)
            shape = "folded" if abs(t2) > 90 else "stretched"
            found[shape] = min(found.get(shape, (t1, t2)), (t1, t2))
        return [self.place(f"{shape}, horizontal", degrees) for shape, degrees in found.items()]

    @cached_property
    def rivals(self) -> list[Place]:
        named = {
            "the lecture's bent arm": (90.0, -135.0),
            "folded, upright (the lecture's folded arm)": (90.0, 180.0),
            "stretched, upright": (90.0, 0.0),
        }
        return [self.place(what, degrees) for what, degrees in named.items()]

    @cached_property
    def angles_only(self) -> list[Place]:
        data = self.problem.to_dict()
        sigma = {k: v for k, v in data["uncertainty"]["sigma"].items() if k.endswith("theta")}
        problem = po.problem_from_dict({**data, "uncertainty": {"sigma": sigma}})
        return [self.place("folded", (0.0, 180.0), problem), self.place("stretched", (0.0, 0.0), problem)]

    @cached_property
    def axis(self) -> np.ndarray:
        """(m,) joint angles of the map [deg]."""
        return np.arange(-180, 180 + self.STEP / 2, self.STEP)

    @cached_property
    def map(self) -> np.ndarray:
        """(m, m) σ across the direction [m]; rows are θ2, columns θ1."""
        t1, t2 = np.meshgrid(np.radians(self.axis), np.radians(self.axis))
        covariances = po.SpreadFunction(self.problem)(np.column_stack([t1.ravel(), t2.ravel()]))
        return np.sqrt(covariances[:, 0, 0]).reshape(t1.shape)

    @property
    def median(self) -> float:
        return float(np.median(self.map[:-1, :-1]))

    @property
    def worst(self) -> float:
        return float(self.map.max())

    @property
    def tell_apart(self) -> float:
        """Samples that Monte Carlo needs to tell folded from stretched: a gap of 1.96 standard errors."""
        folded, stretched = self.optima[0].exact, self.optima[-1].exact
        return (1.96 * folded / (stretched - folded)) ** 2

    @property
    def length_threshold(self) -> float:
        """σ of the lengths [m] above which horizontal links stop being best, from the joints' part of the form."""
        s1, s2 = np.radians([1.0, 3.0])
        return math.sqrt(np.linalg.eigvalsh([[s1**2, s1**2], [s1**2, s1**2 + s2**2]])[0])


TWO_SIGMA = coverage_probability(2.0, 2)
TWO_SIGMA_LINE = coverage_probability(2.0, 1)
K95_SPACE = coverage_factor(0.95, 3)
K95 = coverage_factor(0.95, 2)
K95_SMALL = coverage_factor(0.95, 2, SMALL, "prediction")
