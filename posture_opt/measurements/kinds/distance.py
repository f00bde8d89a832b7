"""Distances of the tool point from fixed, unknown points: ball bars, draw wires, interferometers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np
from pydantic import Field

from posture_opt.measurements.kinds.kind import Kind, Seen, Slots, Vector, dot, stacked
from posture_opt.numerics import Array
from posture_opt.spec import Spec


class AnchorSpec(Spec):
    """What is known of the lengths to an anchor."""

    offset: Literal["free"] | None = Field(
        None, description="free: lengths are known up to a constant, as with a bar whose zero was not set"
    )


@dataclass(frozen=True, eq=False)
class AnchorDistance(Kind):
    """``h = |p − a| + c`` with a the unknown anchor, and c an unknown constant where the file says so.

    Source: Goswami, Quaid, Peshkin (1993), identification by a telescoping ball bar.
    """

    kind: ClassVar[str] = "distance"
    noun: ClassVar[str] = "distances"
    columns: ClassVar[Mapping[str, str]] = {"distance": "length"}
    label: ClassVar[str] = "anchor"
    example: ClassVar[str] = "distance [mm] and anchor for a ball bar"
    sigma_key: ClassVar[str] = "distance"
    error_words: ClassVar[str] = "error of the distance"
    number_words: ClassVar[str] = "row"
    axis_names: ClassVar[tuple[str, ...]] = ("along the line to the anchor",)
    settings: ClassVar[str] = "anchors"
    attached: ClassVar[bool] = True

    @property
    def free(self) -> Array:
        """(P,) whether the lengths to an anchor are known up to a constant only."""
        return np.array([n in self.stated and self.stated[n].offset == "free" for n in self.names], dtype=bool)

    def unknowns(self, place: str) -> tuple[tuple[str, str], ...]:
        offset = (("offset", "m"),) if self.free[list(self.names).index(place)] else ()
        return (("x", "m"), ("y", "m"), ("z", "m"), *offset)

    def start(self, seen: Seen, places: int) -> Array:
        points = stacked(seen.position, len(seen.place))
        found = np.zeros((places, 4))
        for k in np.unique(seen.place):
            own = seen.place == k
            found[k] = _sphere_centre(points[own], seen.reading[own, 0], bool(self.free[k]))
        return found

    def error(self, seen: Seen) -> Slots:
        """``|p − a| + c − l``."""
        return (self._at(seen)[1] + seen.values[:, 3] - seen.reading[:, 0],)

    def slope(self, seen: Seen, shift: Vector, turn: Vector) -> Slots:
        """``u·v`` with u the direction from the anchor to the tool point."""
        return (dot(self._at(seen)[0], shift),)

    def unknown_slope(self, seen: Seen, axis: int) -> Slots:
        """``−u`` for the anchor, 1 for the constant."""
        return (1.0,) if axis == 3 else (-self._at(seen)[0][axis],)

    def aspect(self, seen: Seen) -> Array:
        """The length, which the stroke of a bar or wire bounds [m]."""
        return np.asarray(self._at(seen)[1])[:, None]

    def _at(self, seen: Seen) -> tuple[Vector, Any]:
        """Directions u from the anchors, three of (N,), and the distances (N,) [m]."""
        apart = [seen.position[i] - seen.values[:, i] for i in range(3)]
        length = np.maximum(np.sqrt(dot(apart, apart)), 1e-9)
        return [v / length for v in apart], length


def _sphere_centre(points: Array, lengths: Array, offset: bool) -> Array:
    """(4,) anchor and constant [m] for points (n, 3) and their distances (n,)."""
    # ``|p|² − 2 p·a + s = l²`` is linear in a and ``s = |a|²``; points near one plane leave the side of the anchor
    # open: both are tried, and the better of the least squares solutions is kept
    middle = points.mean(axis=0)
    p = points - middle
    across = np.linalg.svd(p)[2][-1]
    A = np.column_stack([-2 * p, np.ones(len(p))])
    first = np.linalg.lstsq(A, lengths**2 - np.sum(p**2, axis=1), rcond=1e-6)[0][:3]
    inside = first - (first @ across) * across
    height = np.sqrt(max(float(np.mean(lengths**2 - np.sum((p - inside) ** 2, axis=1))), 1e-9))
    starts = (first, inside + height * across, inside - height * across)
    solved = [_polished(p, lengths, np.r_[start, 0.0], offset) for start in starts]
    _, best = min(solved, key=lambda one: one[0])
    return np.asarray(np.r_[best[:3] + middle, best[3]])


def _polished(p: Array, lengths: Array, x: Array, offset: bool) -> tuple[float, Array]:
    """The least squares solution near x (4,), by Levenberg-Marquardt, and its sum of squares."""

    def at(x: Array) -> tuple[Array, Array]:
        apart = p - x[:3]
        reached = np.maximum(np.linalg.norm(apart, axis=1), 1e-9)
        J = np.column_stack([-apart / reached[:, None], np.ones((len(p), int(offset)))])
        return reached + x[3] - lengths, J

    r, J = at(x)
    damping = 1e-3 * len(p)
    for _ in range(60):  # some ten are enough
        step = np.zeros(4)
        step[: J.shape[1]] = np.linalg.solve(J.T @ J + damping * np.eye(J.shape[1]), -J.T @ r)
        other, slope = at(x + step)
        if other @ other < r @ r:
            # The least damping keeps anchors that the points leave open where they are.
            x, r, J, damping = x + step, other, slope, max(damping / 5, 1e-12 * len(p))
        else:
            damping *= 5
        if float(np.abs(step).max()) < 1e-9:
            break
    return float(r @ r), x
