"""``ProblemData``: a robot, its sources of error and what it has to do, as every room above computes with it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Self

from posture_opt.collision.cell import CellSpec
from posture_opt.collision.obstacles.mesh import Mesh
from posture_opt.collision.scene import Scene
from posture_opt.measurements.data_section import DataSpec
from posture_opt.model.arm import Arm
from posture_opt.model.effects import CatalogueEntry, Effect
from posture_opt.numerics import Array
from posture_opt.result import Summarised
from posture_opt.robot.corrections import corrections_of
from posture_opt.robot.robot import Robot
from posture_opt.selection.solvers import Solver
from posture_opt.selection.tasks import Task
from posture_opt.uncertainty.sources.sources import Sources
from posture_opt.uncertainty.sources.uncertainty_section import MeasurementSpec

if TYPE_CHECKING:
    from posture_opt.selection.fitted_arm import FittedArm


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class ProblemData(Summarised, ABC):
    """What a problem states, in SI units and radians; a ``Problem`` is one together with its file.

    Args:
        name: of the problem.
        arm: the robot with its corrections and effects, under the inputs of the task.
        nominal: the robot without corrections and effects.
        stated: the sources of error as they are stated; ``sources`` with what effects add from repeat to repeat.
        workpiece_sources: errors of the workpiece and its features, which belong to the task and not to the arm.
        task: None where none is stated.
        effects: those that move the tool point, ``arm.effects``, and those that only add scatter.
        measurement: the standard deviations of the instrument; None where none is stated.
        data: how files of the instrument are written.
        cell: obstacles, and whether the arm may collide with itself; None where nothing is stated.
        within_measured: whether postures are chosen where the effects were measured that hold nowhere else.
        notes: sentences for the report on what was assumed or overridden.
        without_mounting: whether an assumed mounting plane is dropped, as the task cannot be done above it.
        part: the workpiece as an obstacle, where it is fixed or was put; None without a shape, or a place yet.
    """

    name: str
    arm: Arm
    nominal: Robot
    stated: Sources
    sources: Sources
    task: Task | None
    solver: Solver
    effects: tuple[CatalogueEntry, ...]
    measurement: MeasurementSpec | None
    data: DataSpec
    cell: CellSpec | None = None
    within_measured: bool = True
    notes: tuple[str, ...] = ()
    workpiece_sources: Sources = field(default_factory=Sources)
    without_mounting: bool = False
    part: Mesh | None = None

    @cached_property
    def task_sources(self) -> Sources:
        """Whose errors a task sees: those of the arm and those of the workpiece."""
        return self.sources if self.workpiece_sources.empty else self.sources.plus(self.workpiece_sources)

    @property
    def robot(self) -> Robot:
        """The arm without its effects."""
        return self.arm.robot

    @cached_property
    def scene(self) -> Scene:
        """What the arm may collide with: obstacles, a workpiece whose shape and place are known, and itself."""
        cell = self.cell
        if self.part is not None:
            cell = cell or CellSpec()
            cell = cell.model_copy(update={"obstacles": (*cell.obstacles, self.part)})
        return Scene.of(self.robot, cell, without_mounting=self.without_mounting)

    def with_workpiece_at(self, w: Array) -> Self:
        """The same problem with the shape of its workpiece, if it has one, at w (4,): x, y, z [m] and yaw [rad]."""
        given = None if self.task is None else self.task.workpiece
        return self if given is None or given.file is None else replace(self, part=given.solid(w.tolist()))

    @property
    def above_assumed_mounting(self) -> bool:
        """Whether the arm is kept above a mounting plane that the problem does not state."""
        mounting = self.scene.mounting
        return mounting is not None and mounting.assumed and not mounting.dropped

    @property
    def narrowed(self) -> bool:
        """Whether joints are kept within ranges that their effects were measured in."""
        return self.within_measured and bool(self.arm.measured_ranges)

    @property
    def fallback(self) -> Self | None:
        """The same problem without the next thing that it prefers and does not state; None where nothing is left.

        First postures may leave the ranges that effects were measured in, where such effects are errors that are not
        known; then the mounting plane that was assumed is dropped.
        """
        if self.narrowed:
            return replace(self, within_measured=False)
        return replace(self, without_mounting=True) if self.above_assumed_mounting else None

    def without_masses(self) -> Self:
        """The same problem with an arm of whose links no mass is known."""
        bare, nominal = self.robot.without_masses, self.nominal.without_masses
        return replace(self, arm=replace(self.arm, robot=bare), nominal=nominal)

    @property
    def corrections(self) -> dict[str, float]:
        """What is added to the nominal values of parameters, where it is not zero [rad or m]."""
        return {name: value for name, value in corrections_of(self.nominal, self.robot).items() if value}

    @property
    def uncorrected(self) -> Self:
        """The same problem with the arm as it is drawn, without corrections and effects."""
        return replace(self, arm=Arm(self.nominal))

    @abstractmethod
    def with_task(self, kind: str | None = None, **keys: Any) -> ProblemData:
        """The same problem with another task, or other keys of it."""

    @abstractmethod
    def with_task_of(self, other: Self) -> ProblemData:
        """The same arm in the same cell with the task of another problem."""

    @abstractmethod
    def with_fit(self, fit: FittedArm) -> ProblemData:
        """The same problem with the arm that measurements found."""

    @abstractmethod
    def released(self, frames: Sequence[str], parameters: Sequence[str], effects: Sequence[Effect] = ()) -> Self:
        """The same problem with frames free, without the stated σ's of parameters, and with more effects."""

    @abstractmethod
    def without_noise(self) -> ProblemData:
        """The same problem without the effects that only add scatter."""

    @abstractmethod
    def replace(self, **changes: Any) -> ProblemData:
        """The same problem with other values at some keys of its file."""

    @abstractmethod
    def to_dict(self) -> dict[str, Any]:
        """The plain data of the problem file."""

    @abstractmethod
    def to_yaml(self) -> str:
        """The problem file as text."""

    @abstractmethod
    def files(self, stem: str) -> dict[str, bytes]:
        """File name -> content: the problem file and what it needs beside it."""
