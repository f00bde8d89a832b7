"""``HasTask``: what a selection needs of a ``Problem``."""

from __future__ import annotations

from typing import Protocol

from posture_opt.collision.scene import Scene
from posture_opt.robot.robot import Robot
from posture_opt.selection.solvers import Solver
from posture_opt.selection.tasks import Task
from posture_opt.uncertainty.sources.uncertainty_section import MeasurementSpec
from posture_opt.uncertainty.spread.spread import HasSources


class HasTask(HasSources, Protocol):
    """What a selection needs of a ``Problem``."""

    @property
    def name(self) -> str: ...
    @property
    def robot(self) -> Robot: ...
    @property
    def task(self) -> Task | None: ...
    @property
    def solver(self) -> Solver: ...
    @property
    def notes(self) -> tuple[str, ...]: ...
    @property
    def scene(self) -> Scene: ...
    @property
    def measurement(self) -> MeasurementSpec | None: ...
