"""An arm as its joint axes and its flange at zero joint values: all that its motion depends on.

Frames may stand anywhere along the axes. Nearly parallel ones meet hundreds of metres away, and a Denavit-Hartenberg
table of such an arm has its frames there; masses, shapes and link ends belong to frames where the nominal arm has them.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np

from posture_opt.errors import BadValueError
from posture_opt.numerics import Array
from posture_opt.robot.robot import Factor, Robot
from posture_opt.robot.shape_section import factor_transform

Links = tuple[tuple[Factor, ...], ...]  # (n,) the factors of each link
# Sine of the angle of two axes below which ``d`` and ``a`` cannot follow a tilt of the next one (Hayati 1983)
NEARLY_PARALLEL = 0.17364817766693033  # sin 10 deg
_STEP = 1e-6  # of a parameter [rad or m], for differences
_MOST_ROUNDS = 30
_BODY_M = 0.01  # no body of a calibrated arm is farther from its nominal place
_CLOSED = 1e-10  # [rad and m] left of axes and flange; double precision leaves 1e-13 at 1 km
_FREE = 1e-5  # singular values below belong to frames that slide along, or turn about, their axes


def axes_of(factors: Iterable[Factor]) -> tuple[Array, Array]:
    """(n, 6) direction and moment of each joint's axis and (4, 4) the pose at the end, all joints at zero [m]."""
    T, found = np.eye(4), []
    for factor in factors:
        if factor.joint is not None:
            direction = T[:3, factor.axis]
            turns = factor.kind == "rotate"
            found.append(np.r_[direction, np.cross(T[:3, 3], direction) if turns else np.zeros(3)])
        T = T @ factor_transform(factor)
    return np.array(found), T


def nearest_values(nominal: Links, axes: Array, flange: Array) -> dict[str, float]:
    """What to add to parameters of the links so that the arm has these axes (n, 6) and this flange (4, 4): of all such
    values the smallest, found by Gauss and Newton from the nominal arm."""
    factors = [factor for link in nominal for factor in link]
    names = [factor.parameter for factor in factors if factor.parameter]

    def gaps(x: Array) -> Array:
        own, end = axes_of(moved_factors(factors, dict(zip(names, x.tolist(), strict=True))))
        return np.concatenate(((own - axes).ravel(), (end - flange)[:3].ravel()))

    x = np.zeros(len(names))
    for _ in range(_MOST_ROUNDS):
        gap = gaps(x)
        if np.abs(gap).max() < _CLOSED:
            return {name: float(v) for name, v in zip(names, x, strict=True) if abs(v) > _CLOSED}
        J = np.column_stack([(gaps(x + step) - gap) / _STEP for step in _STEP * np.eye(len(names))])
        if not np.isfinite(J).all():
            break
        x = x - np.linalg.pinv(J, _FREE) @ gap
    raise BadValueError("its axes lie elsewhere than those of the nominal arm", "is it of another arm?")


def beside_bodies(nominal: Robot, values: Mapping[str, float]) -> dict[str, float]:
    """The same motion from frames that stand near the nominal ones, where ``values`` [rad or m] put frames far from
    them that later ones take back; else ``values``, as of an arm that was built longer."""
    links = [factor for link in nominal.links for factor in link]
    lengths = [f.parameter for f in links if f.kind == "translate"]

    def longest(of: Mapping[str, float]) -> float:
        return max((abs(of.get(name, 0.0)) for name in lengths), default=0.0)

    if longest(values) < _BODY_M:
        return dict(values)
    own = {f.parameter for f in links if f.parameter}
    rest = {name: value for name, value in values.items() if name not in own}
    try:
        near = nearest_values(nominal.links, *axes_of(moved_factors(links, values)))
    except BadValueError:
        if longest(values) > nominal.length:
            raise
        return dict(values)
    return {**rest, **near} if longest(near) < 0.1 * longest(values) else dict(values)


def moved_factors(factors: Iterable[Factor], values: Mapping[str, float]) -> tuple[Factor, ...]:
    """The factors with ``values`` [rad or m] added to their parameters."""
    return tuple(replace(f, nominal=f.nominal + values.get(f.parameter, 0.0)) for f in factors)
