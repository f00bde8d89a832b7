"""Lower bounds of distances: never above the exact ones, never far below, and smooth."""

from __future__ import annotations

from itertools import product

import casadi as ca
import numpy as np
import pytest

from posture_opt.collision import segment_distances as exact
from posture_opt.collision import smooth_bounds as smooth
from tests.helpers.variants import conformance

COUNT = 100_000
RADIUS = 0.06
POINT = np.array([0.1, 0.2, 0.0])
HALF = (0.3, 0.2, 0.01)
SOFT_MINIMUM_WIDTH_M = 1e-12  # m
START, ALONG = ca.SX.sym("start", 3), ca.SX.sym("along", 3)
OTHER, OTHER_ALONG = ca.SX.sym("other", 3), ca.SX.sym("other_along", 3)
KINDS = {
    "box": lambda length: smooth.box_bound(START, ALONG, HALF, RADIUS),
    "post": lambda length: smooth.cylinder_bound(START, ALONG, 0.06, 0.4, RADIUS),
    "disc": lambda length: smooth.cylinder_bound(START, ALONG, 0.3, 0.02, RADIUS),
    "sphere": lambda length: smooth.point_bound(START, ALONG, length, POINT, RADIUS),
    "capsule": lambda length: smooth.segment_bound(START, ALONG, length, OTHER, OTHER_ALONG, 0.4, RADIUS),
}
TRUE = {
    "box": lambda a, b, c, d: exact.to_box(a, b, np.array(HALF)),
    "post": lambda a, b, c, d: exact.to_cylinder(a, b, 0.06, 0.4),
    "disc": lambda a, b, c, d: exact.to_cylinder(a, b, 0.3, 0.02),
    "sphere": lambda a, b, c, d: exact.to_point(a, b, POINT),
    "capsule": exact.to_segment,
}


def drawn(length, count=COUNT, seed=0):
    """Segments of one length near the solids, half of them along an axis but for a little, and others beside them."""
    rng = np.random.default_rng(seed)
    start = rng.uniform(-0.7, 0.7, (count, 3)) * rng.choice([0.4, 1.0], count)[:, None]
    along = rng.normal(size=(count, 3))
    along[: count // 4] *= [1, 1e-3, 1e-3]
    along[count // 4 : count // 2] *= [1e-3, 1e-3, 1]
    other, beside = rng.uniform(-0.3, 0.3, (count, 3)), along.copy()
    beside[::2] = rng.normal(size=beside[::2].shape)
    unit, other_unit = (v / np.linalg.norm(v, axis=1, keepdims=True) for v in (along, beside))
    return start, length * unit, other, 0.4 * other_unit


def function(expression):
    return ca.Function("bound", [START, ALONG, OTHER, OTHER_ALONG], [expression])


@pytest.mark.parametrize(
    ("kind", "length"),
    conformance(product(KINDS, [0.6, 0.1, 0.0]), [(kind, 0.1) for kind in KINDS if kind not in ("disc", "post")]),
)
def test_the_bound_is_never_above_the_distance_and_little_below(kind: str, length: float) -> None:
    a, u, b, v = drawn(length)
    bound = np.array(function(KINDS[kind](length)).map(COUNT)(a.T, u.T, b.T, v.T)).ravel()
    true = TRUE[kind](a, a + u, b, b + v) - RADIUS
    lines_apart = true > -RADIUS + 5e-3
    assert np.all(bound[lines_apart] <= true[lines_apart] + SOFT_MINIMUM_WIDTH_M)
    assert np.all(bound[true < 0] < 0)
    clear = true >= 0
    assert clear.sum() > COUNT / 3
    assert np.max(true[clear] - bound[clear]) < 1.01 * smooth.BOUND_SLACK_M


@pytest.mark.parametrize("kind", KINDS)
def test_slope_and_curvature_are_those_of_the_bound(kind: str) -> None:
    """Against central differences of the bound and of its gradient, at segments that are not nearly parallel."""
    length, step = 0.6, 1e-6
    expression = KINDS[kind](length)
    x = ca.vertcat(START, ALONG, OTHER, OTHER_ALONG)
    gradient = ca.gradient(expression, x)
    value, slope = ca.Function("value", [x], [expression]), ca.Function("slope", [x], [gradient])
    curvature = ca.Function("curvature", [x], [ca.jacobian(gradient, x)])
    # What lengths do is known beforehand and no variable: only turns and shifts of the segments are asked for.
    points = np.hstack(drawn(length, 200, seed=3))[100:]
    rng = np.random.default_rng(4)
    checked = 0
    for point in points:
        way = rigid(point, rng)
        ends = [point + side * step * way for side in (-1, 1)]
        values = [float(value(end)) for end in ends]
        slopes = [np.array(slope(end)).ravel() for end in ends]
        second = np.array(curvature(point))
        assert (values[1] - values[0]) / (2 * step) == pytest.approx(
            float(np.array(slope(point)).ravel() @ way), abs=1e-6
        )
        change = (slopes[1] - slopes[0]) / (2 * step)
        checked += np.allclose(change, second @ way, rtol=1e-3, atol=1e-2)
    assert checked >= 95  # of 100: between pieces the second derivative jumps


def rigid(point, rng):
    """A direction in which both segments keep their lengths: each turned about an axis and shifted."""
    parts = point.reshape(4, 3)
    turned = [np.cross(rng.normal(size=3), part) for part in (parts[1], parts[3])]
    return np.concatenate([rng.normal(size=3), turned[0], rng.normal(size=3), turned[1]])


@pytest.mark.parametrize("kind", KINDS)
def test_the_slope_does_not_jump(kind: str) -> None:
    """Along a line through parallel positions the gradient changes as little as the line is cut finely."""
    length = 0.6
    expression = KINDS[kind](length)
    x = ca.vertcat(START, ALONG, OTHER, OTHER_ALONG)
    slope = ca.Function("slope", [x], [ca.gradient(expression, x)])
    jumps = [np.max(np.abs(np.diff(np.array([slopes_at(slope, t) for t in np.linspace(-0.01, 0.01, count)]), axis=0)))
             for count in (500, 5000)]  # fmt: skip
    assert jumps[1] < jumps[0] / 5


def slopes_at(slope, angle):
    """The gradient for a segment at an angle to the plane of a face, above the solids."""
    along = 0.6 * np.array([np.cos(angle), 0, np.sin(angle)])
    return np.array(slope(np.concatenate([[-0.3, 0.1, 0.15], along, [-0.2, 0, 0], [0.4, 0, 0]]))).ravel()
