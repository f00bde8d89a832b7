"""The smallest capsules about a body: it is sliced across its longest axis, and runs of slices get a capsule each."""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from posture_opt.numerics import Array
from posture_opt.robot.shape import Capsule

MOST = 3
"""Capsules for one body: a link is a beam between two housings."""
PRICE = 1.15
"""A further capsule must save this factor of volume: every one more is checked against all others in every posture."""
_SLICES = 9  # of a body along its longest axis
_DIRECTIONS = 80  # in which a body is looked at while its capsule is searched for
_THICKER = (0.0, 0.25)  # of which radii the volume is compared, see `_capsule`
_MARGIN = 1e-9  # m: what rounding may take away of a radius


@dataclass(frozen=True)
class Edges:
    """Edges of a surface, given by both ends (m, 3), (m, 3) [m]; of a convex body those of its corners are enough."""

    tails: Array
    heads: Array

    @classmethod
    def about(cls, points: Array) -> Edges:
        """The convex hull of points (k, 3) that do not lie in one plane."""
        from scipy.spatial import ConvexHull

        faces = ConvexHull(points, qhull_options="QJ").simplices
        return cls(points[faces].reshape(-1, 3), points[np.roll(faces, -1, axis=1)].reshape(-1, 3))

    def slices(self, axis: Array, count: int) -> list[Array]:
        """Points (k, 3) of each slice across ``axis``: corners in it, and where edges cross the planes on both sides.

        The hull of the points of neighbouring slices holds all of the surface there.
        """
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


def fitted_capsules(body: Edges, joint: str, most: int = MOST) -> tuple[Capsule, ...]:
    """Up to ``most`` capsules that together contain the surface of a body given in the frame behind ``joint``.

    All ways to part the slices into runs are compared by capsules along main axes; the runs of the best one then get
    their smallest capsules, if these are together smaller than the one of the whole.
    """
    ends = np.vstack([body.tails, body.heads])
    one = [smallest_capsule(ends, joint)]
    if most == 1:
        return tuple(one)
    longest = max(_main_axes(ends), key=lambda axis: float(np.ptp(ends @ axis)))
    runs = _best_runs(body.slices(longest, _SLICES), most)
    return tuple(min(one, [smallest_capsule(points, joint) for points in runs], key=_price))


def _price(capsules: Iterable[Capsule]) -> float:
    volumes = [capsule.volume for capsule in capsules]
    return sum(volumes) * PRICE ** len(volumes)


def _best_runs(slices: list[Array], most: int) -> list[Array]:
    """The points of the runs of slices whose capsules have the least volume together."""
    count = len(slices)
    seen = [_extremes(points) for points in slices]
    volume = {(i, j): _estimate(np.vstack(seen[i:j])) for i, j in itertools.combinations(range(count + 1), 2)}
    ways = [
        list(itertools.pairwise((0, *cuts, count)))
        for k in range(1, most)
        for cuts in itertools.combinations(range(1, count), k)
    ]
    best = min(ways, key=lambda way: sum(volume[run] for run in way) * PRICE ** len(way))
    return [points for i, j in best if len(points := np.vstack(slices[i:j]))]


def _estimate(points: Array) -> float:
    """The least volume of a capsule along one of the main axes [m³]."""
    return min((_volume(start, points) for start in _starts(points)), default=0.0)


def smallest_capsule(points: Array, joint: str) -> Capsule:
    """The capsule of least volume about points (k, 3) [m] in the frame behind ``joint``.

    Its axis is searched for by the simplex method, from the main axes of the points, about those that are outermost in
    many directions; for an axis the radius and the ends follow from all points. So it contains the points, and thus
    their hull, to rounding.
    """
    from scipy.optimize import minimize

    middle, size = points.mean(axis=0), float(np.ptp(points, axis=0).max()) or 1.0
    scaled = (points - middle) / size
    outer = _extremes(scaled)
    starts = sorted(_starts(outer), key=lambda start: _volume(start, outer))[:2]
    options = {"xatol": 1e-3, "fatol": 1e-5, "maxiter": 400}
    found = [minimize(_volume, start, (outer,), "Nelder-Mead", options=options) for start in starts]
    a, b, radius = _capsule(min(found, key=lambda result: float(result.fun)).x, scaled)
    (ax, ay, az), (bx, by, bz) = ((middle + size * end).tolist() for end in (a, b))
    return Capsule(joint, (ax, ay, az), (bx, by, bz), size * radius + _MARGIN)


def _extremes(points: Array) -> Array:
    """(k, 3) the points that are outermost in one of many directions, spread evenly over the sphere (Fibonacci)."""
    if not len(points):
        return points
    n = np.arange(_DIRECTIONS) + 0.5
    z, turn = 1 - 2 * n / _DIRECTIONS, np.pi * (1 + 5**0.5) * n
    directions = np.array([np.sqrt(1 - z * z) * np.cos(turn), np.sqrt(1 - z * z) * np.sin(turn), z])
    extremes: Array = points[np.unique(np.argmax(points @ directions, axis=0))]
    return extremes


def _main_axes(points: Array) -> Array:
    """(3, 3) rows: the principal axes of the points."""
    apart = points - points.mean(axis=0)
    axes: Array = np.linalg.eigh(apart.T @ apart)[1].T
    return axes


def _starts(points: Array) -> list[Array]:
    """(7,) variables of capsules along the main axes through the middle of the points, see `_capsule`."""
    found = []
    for axis in _main_axes(points) if len(points) else ():
        across = points - (points @ axis)[:, None] * axis
        middle = (across.min(axis=0) + across.max(axis=0)) / 2
        found += [np.concatenate([axis, middle, [thicker]]) for thicker in _THICKER]
    return found


def _volume(x: Array, points: Array) -> float:
    a, b, radius = _capsule(x, points)
    return float(np.pi * radius**2 * (np.linalg.norm(b - a) + 4 / 3 * radius))


def _capsule(x: Array, points: Array) -> tuple[Array, Array, float]:
    """Both ends and the radius of the shortest capsule about the points, its axis along ``x[:3]`` through ``x[3:6]``.

    The radius is the least that the axis allows, times ``1 + x[6]²``: a thicker one may be shorter.
    """
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
