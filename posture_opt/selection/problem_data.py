"""``ProblemData``: a robot, its sources of error and what it has to do, as every room above computes with it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Self, TypeVar

import numpy as np

from posture_opt.collision.cell import CellSpec
from posture_opt.collision.obstacles.mesh import Mesh
from posture_opt.collision.scene import Scene
from posture_opt.errors import InputError, Issue, NoSolutionError
from posture_opt.measurements.data_section import DataSpec
from posture_opt.model.arm import Arm
from posture_opt.model.effects import CatalogueEntry, Effect, NoiseEffect
from posture_opt.numerics import Array
from posture_opt.result import Summarised
from posture_opt.robot.corrections import corrections_of
from posture_opt.robot.robot import Robot
from posture_opt.selection.solvers import Solver
from posture_opt.selection.tasks import Task
from posture_opt.statements import Statement, state
from posture_opt.uncertainty.sources import Sources
from posture_opt.uncertainty.uncertainty_section import MeasurementSpec


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class ProblemData(Summarised, ABC):
    """What a problem states, in SI units and radians; a ``Problem`` is one together with its file."""

    name: str
    arm: Arm  # with corrections and effects, under the inputs of the task
    nominal: Robot  # without corrections and effects
    stated: Sources
    sources: Sources  # with what effects add from repeat to repeat
    task: Task | None
    solver: Solver
    effects: tuple[CatalogueEntry, ...]  # of the arm, and those that only add scatter
    measurement: MeasurementSpec | None  # standard deviations of the instrument
    data: DataSpec  # how files of the instrument are written
    cell: CellSpec | None = None
    within_measured: bool = True  # postures stay where such effects were measured that hold nowhere else
    notes: tuple[str, ...] = ()  # what was assumed or overridden
    workpiece_sources: Sources = field(default_factory=Sources)  # errors of workpiece and features
    without_mounting: bool = False  # the assumed mounting plane is dropped
    part: Mesh | None = None  # the workpiece as an obstacle, where its shape and place are known

    @cached_property
    def task_sources(self) -> Sources:
        """Errors of the arm and of the workpiece."""
        return self.sources if self.workpiece_sources.empty else self.sources.plus(self.workpiece_sources)

    @property
    def robot(self) -> Robot:
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
        """The problem with its workpiece's shape at w (4,): x, y, z [m] and yaw [rad]."""
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
        """The problem without the next unstated preference: measured ranges, then the assumed plane; or None."""
        if self.narrowed:
            return replace(self, within_measured=False)
        return replace(self, without_mounting=True) if self.above_assumed_mounting else None

    def without_masses(self) -> Self:
        """The problem with links of unknown mass."""
        bare, nominal = self.robot.without_masses, self.nominal.without_masses
        return replace(self, arm=replace(self.arm, robot=bare), nominal=nominal)

    @property
    def corrections(self) -> dict[str, float]:
        """Nonzero deviations from nominal parameters [rad or m]."""
        return {name: value for name, value in corrections_of(self.nominal, self.robot).items() if value}

    @property
    def uncorrected(self) -> Self:
        """The problem without corrections and effects."""
        return replace(self, arm=Arm(self.nominal))

    @abstractmethod
    def with_task(self, kind: str | None = None, **keys: Any) -> ProblemData:
        """The problem with another task, or other keys of its task."""

    @abstractmethod
    def with_task_of(self, other: Self) -> ProblemData:
        """This arm and cell with another problem's task."""

    @abstractmethod
    def with_fit(self, fit: FittedArm) -> ProblemData:
        """The problem with a fitted arm."""

    @abstractmethod
    def released(self, frames: Sequence[str], parameters: Sequence[str], effects: Sequence[Effect] = ()) -> Self:
        """The problem with frames free, without stated σ's of parameters, with more effects."""

    @abstractmethod
    def without_noise(self) -> ProblemData:
        """The problem without effects that only add scatter."""

    @abstractmethod
    def replace(self, **changes: Any) -> ProblemData:
        """The problem with other values at some keys of its file."""

    @abstractmethod
    def to_dict(self) -> dict[str, Any]:
        """The plain data of the problem file."""

    @abstractmethod
    def to_yaml(self) -> str:
        """The problem file as text."""

    @abstractmethod
    def files(self, stem: str) -> dict[str, bytes]:
        """File name -> content: the problem file and its companions."""

    @property
    def remarks(self) -> tuple[Statement, ...]:
        """What a posture of an arm without a shape is not checked against."""
        scene = self.scene
        if self.robot.n < 3 or scene.active or scene.switched_off:
            return ()
        tipped = any(f.kind == "rotate" and f.axis != 2 and abs(f.nominal) > 1e-6 for f in self.robot.base)
        asked = any(term.keeps_clear for term in task_of(self).subject_to)
        hint = () if tipped or asked else (state("collision.link-height"),)
        why = "; ".join(self.robot.shape_notes) or "the shape of the arm is not known"
        return (state("collision.shape-unknown", why=why), *hint)


Problem = TypeVar("Problem", bound=ProblemData)
Answer = TypeVar("Answer")


def with_fallbacks(problem: Problem, solve: Callable[[Problem], Answer]) -> Answer:
    """``solve(problem)``, or that of its first `ProblemData.fallback` with a solution; else the last error."""
    while (wider := problem.fallback) is not None:
        try:
            return solve(problem)
        except NoSolutionError:
            problem = wider
    return solve(problem)


NEGLIGIBLE = {"m": 1e-11, "rad": 1e-13}  # below, a deviation is rounding: [m], and [rad] at any reach of an arm


@dataclass(frozen=True, eq=False)
class FittedArm:
    """The arm that fits measurements: deviations, effects, and their remaining uncertainty."""

    label: str  # beside the name of the problem: calibrated
    deviations: Mapping[str, float]  # of parameters from the problem's values [rad or m]; such a frame is known
    known: Sources | None = None  # covariance of errors that stay; None: as the problem states
    scatter: Mapping[str, float] = field(default_factory=dict)  # JOINT.theta or JOINT.d -> σ [rad or m]
    effects: tuple[Effect, ...] = ()  # add to those of the problem, as ``noises``
    noises: tuple[NoiseEffect, ...] = ()
    gravity: tuple[float, float, float] | None = None  # world of the data [m/s²]; None: the problem's
    header: tuple[str, ...] = ()  # first lines of a file of this arm
    second_arms: Mapping[str, FittedArm] = field(default_factory=dict)  # name -> the arm that this one touched

    @property
    def covariance_file(self) -> str:
        return f"{self.label}_covariance.csv"


def task_of(problem: ProblemData) -> Task:
    """The task; InputError without one, or without an arm that could do it."""
    if problem.robot.pose_prefix:
        hint = "state the arm: robot: {kind: preset, name: ur10}, say"
        raise InputError(Issue("the flange of an unknown arm has no posture to choose", ("robot", "kind"), hint=hint))
    if problem.task is None:
        hint = "add task: {kind: insert}, or name one: --task insert"
        raise InputError(Issue("the problem states no task", ("task",), hint=hint))
    return problem.task


def one_target(task: Task) -> Task:
    """The task, or an InputError for several targets."""
    if task.features or task.on_path:
        what, key = ("features", ("task", "features")) if task.features else ("a path", ("task",))
        hint = "solve the task as it is, or name one target: position: [0.6 m, 0.2 m, 0.1 m]"
        raise InputError(Issue(f"this takes a task with one target, and the task has {what}", key, hint=hint))
    return task


def sources_of(problem: ProblemData) -> Sources:
    """The sources that the task sees; an InputError without one of the arm: the workpiece's are alike everywhere."""
    # Stricter than for one posture: a spread of zero is an answer there, but no reason for any choice.
    if problem.sources.empty or not np.any(np.diag(problem.sources.covariance) > 0):
        hint = "add uncertainty: {sigma: {JOINT.theta: 0.02 deg}} or uncertainty: {repeatability: 0.05 mm}"
        what = "nothing" if problem.workpiece_sources.empty else "nothing of the arm"
        message = f"{what} is uncertain, so no posture is better than another"
        raise InputError(Issue(message, ("uncertainty",), hint=hint))
    return problem.task_sources
