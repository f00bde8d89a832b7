"""A robot with stated errors: as much of a problem as the closed forms ask for."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import posture_opt as po
from posture_opt.robot.robot import frame_factors
from posture_opt.uncertainty.sources import Sources

__all__ = ["Sources", "moved_base", "stated"]


def stated(robot: po.Robot, sources: Sources) -> Any:
    """Robot and sources of error where a ``Problem`` would stand."""
    return SimpleNamespace(arm=po.Arm(robot), robot=robot, sources=sources, task=None)


def moved_base(robot: po.Robot, shift: tuple[float, ...], angles: tuple[float, ...]) -> po.Robot:
    """The robot with its base shifted [m] and turned by roll, pitch and yaw [rad]."""
    return replace(robot, base=frame_factors("base", shift, angles))
