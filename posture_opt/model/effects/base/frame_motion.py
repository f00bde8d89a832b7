"""A frame that moves: what shifts along its axes and turns about them do to all that it carries."""

from __future__ import annotations

from collections.abc import Sequence

from posture_opt.model.arm_state import ArmState
from posture_opt.model.chain import ZERO, Scalar, Vector, cross, scale, subtract
from posture_opt.model.effects.base.effect import Sensitivity

ANGLES = ("roll", "pitch", "yaw")
"""Parameters about the x, y and z axis [rad]: the world's of the base, its own of the tool."""
WORLD_AXES: tuple[Vector, ...] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


def foot(state: ArmState) -> Vector:
    """(3,) where the axis of the first joint passes the base [m], world."""
    return state.walk.screws[len(state.robot.base)].origin


def frame_motion(
    state: ArmState, names: Sequence[str], axes: Sequence[Vector], about: Vector, size: Scalar
) -> tuple[Sensitivity, ...]:
    """The tool point under a motion of a frame of a ``size``, one unit for each of the parameters ``names``.

    Args:
        names: of ``x``, ``y``, ``z`` [m], ``roll``, ``pitch`` and ``yaw`` [rad].
        axes: (3,) unit vectors of shifts and turns; about: the point (3,) that turns leave where it is [m], world.
    """
    vectors, lever = [scale(size, axis) for axis in axes], subtract(state.tool, about)
    units = dict(zip("xyz", (Sensitivity(twist=(v, ZERO)) for v in vectors), strict=True))
    units |= {name: Sensitivity(twist=(cross(v, lever), v)) for name, v in zip(ANGLES, vectors, strict=True)}
    return tuple(units[name] for name in names)
