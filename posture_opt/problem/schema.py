"""The problem file as a schema: one field a section."""

from __future__ import annotations

from pydantic import ConfigDict, Field

from posture_opt.measurements.measurements import DataSpec
from posture_opt.model.effects import EffectSpec
from posture_opt.robot import RobotSpec
from posture_opt.selection.solvers import SolverSpec
from posture_opt.selection.solvers.ipopt import Ipopt
from posture_opt.selection.tasks import TaskSpec
from posture_opt.spec import Spec
from posture_opt.uncertainty.uncertainty_section import UncertaintySpec


class ProblemSpec(Spec):
    """A problem file of posture_opt: the robot, what is uncertain about it, and what it has to do."""

    model_config = ConfigDict(title="Problem file of posture_opt")

    name: str = Field("", description="what reports call the problem")
    robot: RobotSpec = Field(description="the nominal arm", examples=[{"kind": "preset", "name": "ur10e"}])
    uncertainty: UncertaintySpec = Field(UncertaintySpec(), description="where the scatter comes from")
    task: TaskSpec | None = Field(None, description="what the tool point has to do")
    effects: tuple[EffectSpec, ...] = Field((), description="what moves the tool point beyond the geometry")
    solver: SolverSpec = Field(Ipopt(), description="how the best posture is searched for")
    data: DataSpec = Field(DataSpec(), description="what is known about measurements besides their file")
