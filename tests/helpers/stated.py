"""A robot with stated errors: as much of a problem as the closed forms ask for."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import posture_opt as po
from posture_opt.uncertainty.sources import Sources


def stated(robot: po.Robot, sources: Sources) -> Any:
    """Robot and sources of error where a ``Problem`` would stand."""
    return SimpleNamespace(arm=po.Arm(robot), robot=robot, sources=sources, task=None)
