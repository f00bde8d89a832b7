"""``ProductSolid``: one description of every kind of obstacle, with its signed distance and the way out of it.

In a frame of its own a solid is a product of balls, each in some of the three coordinates: a box is three intervals, a
cylinder a disc and an interval, a sphere a ball; a half-space is all that is below zero in one coordinate. With the
excess ``e_g = ‖p_g‖ − h_g`` of each ball the distance is ``√Σ max(e_g, 0)²`` outside and ``max e_g`` inside, a convex
function of the point.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from posture_opt.numerics import Array

FREE = -1
"""Group of a coordinate that bounds nothing."""
LEAST_LENGTH_M = 1e-9
"""A vector shorter than this [m] has no direction."""


class ProductSolid(NamedTuple):
    """A solid as a product of balls.

    Args:
        rotation: (3, 3) R_world_solid; origin: (3,) [m], world.
        group: (3,) the ball of each coordinate, `FREE` for none.
        size: (3,) radius of each ball [m].
        one_sided: whether the only ball is a half-line.
    """

    rotation: Array
    origin: Array
    group: tuple[int, int, int]
    size: tuple[float, float, float]
    one_sided: bool = False

    @property
    def bounding_radius(self) -> float:
        """Radius [m] about the origin that holds it; infinite where none does."""
        if self.one_sided or FREE in self.group:
            return math.inf
        return math.sqrt(sum(self.size[g] ** 2 for g in set(self.group)))

    @property
    def numbers(self) -> list[float]:
        """(20,) all of it, row by row."""
        return [*self.rotation.ravel(), *self.origin, *self.group, *self.size, self.one_sided, self.bounding_radius]


C_TEXT = """
static double po_signed_distance(const double* solid, const double* x, double* normal) {
  const double *R = solid, *origin = solid + 9, *group = solid + 12, *size = solid + 15;
  const int one_sided = solid[18] != 0;
  double p[3], length[3] = {0, 0, 0}, way[3] = {0, 0, 0}, excess, deepest = -INFINITY, outside = 0;
  int i, k, g, best = 0, first;
  for (k = 0; k < 3; ++k) {
    p[k] = 0;
    for (i = 0; i < 3; ++i) p[k] += R[3 * i + k] * (x[i] - origin[i]);
    if (group[k] >= 0) length[(int)group[k]] += p[k] * p[k];
  }
  for (g = 0; g < 3; ++g) {
    for (first = 0; first < 3 && (int)group[first] != g; ++first) {}
    if (first == 3) continue;
    length[g] = one_sided ? p[first] : sqrt(length[g]);
    excess = length[g] - size[g];
    if (excess > deepest) { deepest = excess; best = g; }
    outside += excess > 0 ? excess * excess : 0;
  }
  outside = sqrt(outside);
  for (k = 0; k < 3; ++k) {
    double share;
    g = (int)group[k];
    if (g < 0) continue;
    for (first = 0; (int)group[first] != g; ++first) {}
    excess = length[g] - size[g];
    share = outside > LEAST ? (excess > 0 ? excess / outside : 0) : g == best;
    if (one_sided) way[k] = share;
    else way[k] = share * (length[g] > LEAST ? p[k] / length[g] : k == first);
  }
  for (i = 0; i < 3; ++i) for (normal[i] = 0, k = 0; k < 3; ++k) normal[i] += R[3 * i + k] * way[k];
  return outside > LEAST ? outside : deepest;
}
""".replace("LEAST", repr(LEAST_LENGTH_M))
"""C text of the same for one point; ``solid`` are the ``numbers``."""
SIZE = 20
"""Numbers of a solid."""
