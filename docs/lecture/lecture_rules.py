"""The numbers of lecture.md beyond its examples: the lecture's rules of thumb, the measuring robot, the pose."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from lecture_numbers import BESIDE, EXAMPLES, K95, LARGE, PROBLEMS, Example

import posture_opt as po
from posture_opt.uncertainty.regions import coverage_factor, coverage_probability
from posture_opt.uncertainty.sampler import wilson_interval

SIGMAS = np.array([math.radians(1), math.radians(3), 0.01, 0.01])  # θ1, θ2, a1, a2 of the weak elbow
READINGS = {"√(2 α), each eigenvalue doubled": math.sqrt(2), "2 √α, two standard deviations": 2.0, "2.448 √α": K95}
K_LINE = coverage_factor(0.95, 1)
K_POSE = coverage_factor(0.95, 6)
GRIPPER = 0.2  # m beyond the tool point, along the last link


@dataclass(frozen=True)
class Axes:
    """C = A diag(α1, α2) Aᵀ of one example."""

    example: Example

    @cached_property
    def alphas(self) -> np.ndarray:
        """(2,) [m²], ascending, from the exact covariance."""
        (xx, xy), (_, yy) = self.example.exact
        middle, half = (xx + yy) / 2, math.hypot((xx - yy) / 2, xy)
        return np.array([middle - half, middle + half])

    @property
    def angle(self) -> float:
        """Of the longer axis from x [deg], in (−90, 90]."""
        (xx, xy), (_, yy) = self.example.exact
        return math.degrees(math.atan2(2 * xy, xx - yy) / 2)

    @property
    def whitened(self) -> np.ndarray:
        """(2, 2) covariance of Aᵀ (point − mean), each coordinate over its √α, in the cloud of 10⁶."""
        t = math.radians(self.angle)
        A = np.array([[-math.sin(t), math.cos(t)], [math.cos(t), math.sin(t)]])  # columns: minor axis, major axis
        points = self.example.large.points[:, :2]
        return np.cov((points - points.mean(axis=0)) @ A / np.sqrt(self.alphas), rowvar=False)


def along_one_axis(example: Example, k: float) -> tuple[float, tuple[float, float]]:
    """The part of the large cloud within ±kσx of the mean, with its 95 % interval."""
    x = example.large.points[:, 0] - example.spread.position[0] - example.spread.bias[0]
    inside = int(np.count_nonzero(np.abs(x) <= k * math.sqrt(example.exact[0, 0])))
    return inside / LARGE, wilson_interval(inside, LARGE)


def jacobian(q: np.ndarray) -> np.ndarray:
    """(3, 4) of x, y [m] and φ [rad] in θ1, θ2, a1, a2; links of 1 m."""
    c1, s1, c, s = math.cos(q[0]), math.sin(q[0]), math.cos(q[0] + q[1]), math.sin(q[0] + q[1])
    return np.array([[-s1 - s, -s, c1, c], [c1 + c, c, s1, s], [1, 1, 0, 0]])


class KlineMcClintock:
    """The scalar law on the bent arm with the weak elbow."""

    example = EXAMPLES["weak"]

    @cached_property
    def parts(self) -> np.ndarray:
        """(2, 4) |∂R/∂p| w of R = x, y and every source [m]."""
        return np.abs(jacobian(np.array(self.example.q))[:2]) * SIGMAS

    @property
    def w(self) -> np.ndarray:
        """(2,) root sum squares for x and y [m]."""
        return np.sqrt((self.parts**2).sum(axis=1))

    @cached_property
    def minor(self) -> np.ndarray:
        """(2,) unit vector of the shorter axis, first order."""
        return np.linalg.eigh(self.example.first)[1][:, 0]

    @property
    def across_alone(self) -> float:
        """σ along the shorter axis from w of x and y as if they were independent [m]."""
        return float(np.linalg.norm(self.minor * self.w))

    @property
    def across(self) -> float:
        """The same with R = the coordinate along the shorter axis from the start [m]."""
        return float(np.linalg.norm((self.minor @ jacobian(np.array(self.example.q))[:2]) * SIGMAS))

    @property
    def boxed(self) -> float:
        """The part of the large cloud within ±1.96 w of the mean in x and in y."""
        e = self.example
        points = e.large.points[:, :2] - e.spread.position[:2] - e.spread.bias[:2]
        return float(np.mean(np.all(np.abs(points) <= K_LINE * self.w, axis=1)))

    @property
    def box_to_ellipse(self) -> float:
        """Area of the box over that of the 95 % ellipse."""
        ellipse = math.pi * K95**2 * math.sqrt(np.linalg.det(self.example.first))
        return float(4 * K_LINE**2 * self.w.prod() / ellipse)


class Pose:
    """(x, y, φ) of the bent arm with the weak elbow: the part of the 6-vector that a planar arm can move."""

    q = np.array(EXAMPLES["weak"].q)

    @cached_property
    def covariance(self) -> np.ndarray:
        """(3, 3) first order; m², m rad, rad²."""
        J = jacobian(self.q) * SIGMAS
        return J @ J.T

    @property
    def correlations(self) -> np.ndarray:
        """(3, 3)."""
        sigma = np.sqrt(np.diag(self.covariance))
        return self.covariance / np.outer(sigma, sigma)

    def tip(self, *, together: bool) -> np.ndarray:
        """(2,) semi-axes (1σ, ascending) of the tip of a gripper [m]; position and turn together, or as if apart."""
        phi = self.q.sum()
        T = np.array([[1, 0, -GRIPPER * math.sin(phi)], [0, 1, GRIPPER * math.cos(phi)]])
        C = self.covariance.copy()
        if not together:
            C[:2, 2] = C[2, :2] = 0
        return np.sqrt(np.linalg.eigvalsh(T @ C @ T.T))


class MeasuringRobot:
    """The arm as an instrument: where it measures a point best, and a length between two points."""

    ENDS = ((0.8, -0.2), (0.8, 0.2))  # m

    @cached_property
    def solution(self):
        return po.select_posture(po.load_problem(PROBLEMS / "measure_planar_2r.yaml"))

    @property
    def by_hand(self) -> float:
        """Root of the total variance to first order, √(r² σ1² + a2² σ2² + σa1² + σa2²), at the answer [m]."""
        r = float(np.linalg.norm(self.solution.spread.position))
        return math.sqrt((r * SIGMAS[0]) ** 2 + SIGMAS[1] ** 2 + SIGMAS[2] ** 2 + SIGMAS[3] ** 2)

    @property
    def rms(self) -> float:
        """The same, exact [m]."""
        return math.sqrt(np.trace(self.solution.spread.covariance))

    @property
    def sigmas(self) -> np.ndarray:
        """(2,) σx, σy at the answer [m]."""
        return np.sqrt(np.diag(self.solution.spread.covariance))[:2]

    @cached_property
    def postures(self) -> np.ndarray:
        """(2, 2) at both ends of the length [rad], elbow at the same side."""
        postures = []
        for x, y in self.ENDS:
            t2 = -math.acos((x * x + y * y - 2) / 2)
            postures.append([math.atan2(y, x) - math.atan2(math.sin(t2), 1 + math.cos(t2)), t2])
        return np.array(postures)

    def length_sigma(self, shared: tuple[bool, bool]) -> float:
        """σ of the measured length [m], first order; whether angle errors and link errors are the same at both ends."""
        first, second = (jacobian(q)[1] * SIGMAS for q in self.postures)  # the length lies along y
        same = np.repeat(shared, 2)
        return float(np.sqrt(np.where(same, (second - first) ** 2, first**2 + second**2).sum()))

    def length_cloud(self, shared: tuple[bool, bool]) -> tuple[float, float, float]:
        """The same of a simulated sample of lengths, with the 95 % interval of its own sampling error [m]."""
        rng = np.random.default_rng(0)
        errors = rng.standard_normal((2, BESIDE, 4)) * SIGMAS
        errors[1] = np.where(np.repeat(shared, 2), errors[0], errors[1])
        points = []
        for q, e in zip(self.postures, errors, strict=True):
            t1, t12 = q[0] + e[:, 0], q.sum() + e[:, 0] + e[:, 1]
            a1, a2 = 1 + e[:, 2], 1 + e[:, 3]
            points.append(np.column_stack([a1 * np.cos(t1) + a2 * np.cos(t12), a1 * np.sin(t1) + a2 * np.sin(t12)]))
        sigma = float(np.linalg.norm(points[1] - points[0], axis=1).std(ddof=1))
        half = 1.96 * sigma / math.sqrt(2 * (BESIDE - 1))
        return sigma, sigma - half, sigma + half


LENGTHS = {
    "nothing: every reading draws all errors anew": (False, False),
    "the links: their lengths are what they are": (False, True),
    "links and angles: a zero error, no play": (True, True),
}


@dataclass(frozen=True)
class Times:
    """What `python -m benchmarks.lecture --write` measured."""

    machine: str
    ns: dict[str, float]

    @classmethod
    def read(cls) -> Times:
        return cls(**json.loads((Path(__file__).parent / "lecture_times.json").read_text(encoding="utf-8")))

    def ratio(self, way: str) -> float:
        """To the first order written out by hand."""
        return self.ns[way] / next(iter(self.ns.values()))


COVERED = {k: [coverage_probability(k, m) for m in (1, 2, 3, 6)] for k in (1.0, 2.0, 3.0)}
