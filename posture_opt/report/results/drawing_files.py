"""Files that draw, loaded when something is drawn: without, the text on a single posture comes a tenth faster."""

from __future__ import annotations

from importlib import import_module
from typing import Any


def figures_of(file: str) -> Any:
    """A file of `posture_opt.report.figures`."""
    return import_module(f"posture_opt.report.figures.{file}")


def views_of(file: str) -> Any:
    """A file of `posture_opt.report.interactive`."""
    return import_module(f"posture_opt.report.interactive.{file}")
