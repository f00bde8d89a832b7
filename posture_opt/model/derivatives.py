"""Derivatives of the tool pose with respect to the factors, in closed form from their screws.

For factor i before factor j in the chain, with axis ``a``, origin ``o`` and tool point ``x``:

- rotation:     ``∂x/∂i = a_i × (x − o_i)``,  translation: ``∂x/∂i = a_i``
- ``∂²x/∂i∂j = a_i × ∂x/∂j`` where i rotates, else zero (what lies nearer to the base turns the rest)
"""

from __future__ import annotations

from posture_opt.model.chain import Scalar, Vector, Walk, cross, subtract

ZERO: Vector = (0.0, 0.0, 0.0)


def position_column(walk: Walk, i: int) -> Vector:
    """``∂x/∂i`` [m/rad or m/m], world frame."""
    screw = walk.screws[i]
    return cross(screw.axis, subtract(walk.position, screw.origin)) if screw.rotates else screw.axis


def rotation_column(walk: Walk, i: int) -> Vector:
    """Angular velocity of the tool per unit of factor i [rad/rad], world frame."""
    screw = walk.screws[i]
    return screw.axis if screw.rotates else ZERO


def twist_column(walk: Walk, i: int) -> tuple[Scalar, ...]:
    """The (6,) twist ``(v, ω)`` of the tool point per unit of factor i, world-aligned axes."""
    return (*position_column(walk, i), *rotation_column(walk, i))
