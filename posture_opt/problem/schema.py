"""The problem file as a schema: one field a section."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import ConfigDict, Field, WithJsonSchema, field_validator

from posture_opt.diagnosis.data_spec import DataSpec
from posture_opt.robot import RobotSpec
from posture_opt.selection.solvers import SolverSpec
from posture_opt.selection.tasks import TaskSpec
from posture_opt.spec import Spec
from posture_opt.uncertainty.spec import UncertaintySpec

EFFECT_KINDS: tuple[str, ...] = ()

Section = Annotated[dict[str, Any], WithJsonSchema({"type": "object"})]


class ProblemSpec(Spec):
    """A problem file of posture_opt: the robot, what is uncertain about it, and what it has to do."""

    model_config = ConfigDict(title="Problem file of posture_opt")

    name: str = Field("", description="what reports call the problem")
    robot: RobotSpec = Field(description="the nominal arm", examples=[{"kind": "preset", "name": "ur10e"}])
    uncertainty: UncertaintySpec = Field(UncertaintySpec(), description="where the scatter comes from")
    task: TaskSpec | None = Field(None, description="what the tool point has to do")
    effects: tuple[Section, ...] = Field((), description="extensions of the model")
    solver: SolverSpec = Field(SolverSpec(), description="how the best posture is searched for")
    data: DataSpec = Field(DataSpec(), description="what is known about measurements besides their file")

    @field_validator("effects")
    @classmethod
    def _known_effects(cls, effects: tuple[dict[str, Any], ...]) -> tuple[dict[str, Any], ...]:
        if effects:
            kinds = ", ".join(EFFECT_KINDS) or "none so far"
            raise ValueError(f"there is no effect of kind '{effects[0].get('kind', '')}'; kinds: {kinds}; write []")
        return effects
