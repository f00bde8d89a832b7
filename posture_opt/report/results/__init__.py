"""The presenters of results. Modules that draw load with the first drawing: text alone comes a tenth faster without."""

from __future__ import annotations

from importlib import import_module
from typing import Any


def figures_of(file: str) -> Any:
    return import_module(f"posture_opt.report.figures.{file}")


def scene_of(file: str) -> Any:
    return import_module(f"posture_opt.report.scene.{file}")
