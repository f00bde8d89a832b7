"""The smallest capsules about a body: it is sliced across its longest axis, and runs of slices get a capsule each.

Used once when a URDF is read, so that a second of computing time for a fine mesh is affordable.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from posture_opt.numerics import Array
from posture_opt.robot.robot import Capsule

# A further capsule must save this factor of volume: each one more is checked against all others in every posture
VOLUME_FACTOR = 1.15
_DIRECTION_COUNT = 80  # Directions whose outermost points stand for a body while its capsule is searched for
# Values of x[6] to start from: the radius is the least one times 1 + x[6]², see `_enclosing_capsule`
_START_EXCESSES = (0.0, 0.25)


@dataclass(frozen=True)
class Edges:
    """Edges of a surface; of a convex body those between its corners are enough."""

    tails: Array  # tails, heads: (m, 3), (m, 3) both ends of each edge [m], in the frame of the body
    heads: Array

    @classmethod
    def about(cls, points: Array) -> Edges:
        """The edges of the convex hull of points (k, 3) [m] that do not lie in one plane."""
        from scipy.spatial import ConvexHull

        faces = ConvexHull(points, qhull_options="QJ").simplices
        return cls(points[faces].reshape(-1, 3), points[np.roll(faces, -1, axis=1)].reshape(-1, 3))

    def slices(self, axis: Array, count: int) -> list[Array]:
        """Points (k, 3) [m] of each slice across an axis: corners in it, and where edges cross the planes on both
        sides. The hull of the points of neighbouring slices holds all of the surface there. axis: (3,) unit vector,
        frame of the body."""
        a, b = self.tails @ axis, self.heads @ axis
        planes = np.linspace(min(a.min(), b.min()), max(a.max(), b.max()), count + 1)
        points, heights = [self.tails, self.heads], [a, b]
        for plane in planes[1:-1]:
            crosses = (a - plane) * (b - plane) < 0
            t = ((plane - a[crosses]) / (b - a)[crosses])[:, None]
            points.append(self.tails[crosses] + t * (self.heads - self.tails)[crosses])
            heights.append(np.full(len(t), plane))
        every, height = np.vstack(points), np.concatenate(heights)
        return [every[(height >= low) & (height <= high)] for low, high in itertools.pairwise(planes)]


# Capsules for one body: a link is a beam between two housings.
def fitted_capsules(body: Edges, joint: str, most: int = 3) -> tuple[Capsule, ...]:
    """Up to ``most`` capsules that together contain the surface of a body, frame behind ``joint``, to rounding. All
    ways to cut its slices into runs are compared by capsules along main axes; the runs of the best one then get their
    smallest capsules, if these are together smaller than the one of the whole."""
    ends = np.vstack([body.tails, body.heads])
    one = [smallest_capsule(ends, joint)]
    if most == 1:
        return tuple(one)
    longest = max(_main_axes(ends), key=lambda axis: float(np.ptp(ends @ axis)))
    # Slices of a body along its longest axis: 9 leave 36 ways to cut it into at most three runs.
    runs = _cheapest_runs(body.slices(longest, 9), most)
    return tuple(min(one, [smallest_capsule(points, joint) for points in runs], key=_total_cost))


def _total_cost(capsules: Iterable[Capsule]) -> float:
    """``Σ V · VOLUME_FACTOR^k`` of k capsules [m³]."""
    volumes = [capsule.volume for capsule in capsules]
    return sum(volumes) * VOLUME_FACTOR ** len(volumes)


def _cheapest_runs(slices: list[Array], most: int) -> list[Array]:
    """The points (k, 3) of each run of slices, cut where their capsules cost least together."""
    count = len(slices)
    seen = [_outermost_points(points) for points in slices]
    volume = {(i, j): _least_volume(np.vstack(seen[i:j])) for i, j in itertools.combinations(range(count + 1), 2)}
    ways = [
        list(itertools.pairwise((0, *cuts, count)))
        for k in range(1, most)
        for cuts in itertools.combinations(range(1, count), k)
    ]
    best = min(ways, key=lambda way: sum(volume[run] for run in way) * VOLUME_FACTOR ** len(way))
    return [points for i, j in best if len(points := np.vstack(slices[i:j]))]


def _least_volume(points: Array) -> float:
    """The least volume [m³] of a capsule about points (k, 3) whose axis is one of their main axes; 0 without points."""
    return min((_capsule_volume(start, points) for start in _start_variables(points)), default=0.0)


def smallest_capsule(points: Array, joint: str) -> Capsule:
    """The capsule of least volume about points (k, 3) [m], frame behind ``joint``. Its axis is sought by the simplex
    method from the main axes about the outermost points; radius and ends follow from all points, so it contains them
    and their hull to rounding."""
    from scipy.optimize import minimize

    middle, size = points.mean(axis=0), float(np.ptp(points, axis=0).max()) or 1.0
    scaled = (points - middle) / size
    outer = _outermost_points(scaled)
    starts = sorted(_start_variables(outer), key=lambda start: _capsule_volume(start, outer))[:2]
    options = {"xatol": 1e-3, "fatol": 1e-5, "maxiter": 400}
    found = [minimize(_capsule_volume, start, (outer,), "Nelder-Mead", options=options) for start in starts]
    a, b, radius = _enclosing_capsule(min(found, key=lambda result: float(result.fun)).x, scaled)
    (ax, ay, az), (bx, by, bz) = ((middle + size * end).tolist() for end in (a, b))
    # Added to each radius: more than rounding can take away of it.
    return Capsule(joint, (ax, ay, az), (bx, by, bz), size * radius + 1e-9)


def _outermost_points(points: Array) -> Array:
    """(k, 3) the points that are outermost in one of many directions, spread evenly over the sphere (Fibonacci
    lattice)."""
    if not len(points):
        return points
    n = np.arange(_DIRECTION_COUNT) + 0.5
    z, turn = 1 - 2 * n / _DIRECTION_COUNT, np.pi * (1 + 5**0.5) * n
    directions = np.array([np.sqrt(1 - z * z) * np.cos(turn), np.sqrt(1 - z * z) * np.sin(turn), z])
    extremes: Array = points[np.unique(np.argmax(points @ directions, axis=0))]
    return extremes


def _main_axes(points: Array) -> Array:
    """(3, 3) rows: the principal axes of points (k, 3), unit vectors, the least extent first."""
    apart = points - points.mean(axis=0)
    axes: Array = np.linalg.eigh(apart.T @ apart)[1].T
    return axes


def _start_variables(points: Array) -> list[Array]:
    """(7,) variables of capsules along the main axes through the middle of the points, see `_enclosing_capsule`."""
    found = []
    for axis in _main_axes(points) if len(points) else ():
        across = points - (points @ axis)[:, None] * axis
        middle = (across.min(axis=0) + across.max(axis=0)) / 2
        found += [np.concatenate([axis, middle, [thicker]]) for thicker in _START_EXCESSES]
    return found


def _capsule_volume(x: Array, points: Array) -> float:
    """``π r² (|b − a| + 4/3 r)`` [m³] of the capsule that the variables (7,) give about points (k, 3)."""
    a, b, radius = _enclosing_capsule(x, points)
    return float(np.pi * radius**2 * (np.linalg.norm(b - a) + 4 / 3 * radius))


def _enclosing_capsule(x: Array, points: Array) -> tuple[Array, Array, float]:
    """Both ends (3,), (3,) and the radius of the shortest capsule about points (k, 3), all in the unit of the points.
    Its axis is along ``x[:3]``, of any length, through ``x[3:6]``; the radius is the least that the axis allows, times
    ``1 + x[6]²``: a thicker capsule may be shorter."""
    axis = x[:3] / np.linalg.norm(x[:3])
    apart = points - x[3:6]
    t = apart @ axis
    squared = np.maximum(np.einsum("ij,ij->i", apart, apart) - t * t, 0.0)
    widest = float(squared.max()) * (1 + x[6] ** 2) ** 2
    cap = np.sqrt(np.maximum(widest - squared, 0.0))
    low, high = float((t + cap).min()), float((t - cap).max())
    if low > high:  # one sphere is enough
        low = high = (low + high) / 2
    return x[3:6] + low * axis, x[3:6] + high * axis, float(np.sqrt(widest))
