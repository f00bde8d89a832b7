"""``Effect``: what moves the tool point beyond the geometry, by parameters that are zero in the nominal model."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, Literal

import numpy as np
from pydantic import ConfigDict, Field, model_validator

from posture_opt.model.arm_state import ZERO, ArmState
from posture_opt.model.chain import Scalar, Vector
from posture_opt.model.effects.catalogue_entry import CatalogueEntry, Input, Quantity
from posture_opt.robot.robot import Robot
from posture_opt.units import DIMENSIONS, parse_quantity


@dataclass(frozen=True)
class Sensitivity:
    """What one unit of a parameter does: it adds to joints and lengths, and shifts and turns the tool.

    Args:
        joints: joint index -> increment of the joint value [rad or m].
        lengths: name of a model parameter -> increment [rad or m].
        twist: shift of the tool point and small rotation of the tool (v, ω), world axes.
    """

    joints: Mapping[int, Scalar] = field(default_factory=dict)
    lengths: Mapping[str, Scalar] = field(default_factory=dict)
    twist: tuple[Vector, Vector] = (ZERO, ZERO)


@dataclass(frozen=True)
class Excitation:
    """What measurements, or a problem, can show of effects.

    Args:
        inputs: those that are known and vary: approach, payload, temperature, time.
        span: (n,) range of each joint in the data [rad or m].
        duration: of the measurements [s].
    """

    robot: Robot
    inputs: frozenset[Input]
    span: tuple[float, ...]
    duration: float = 0.0

    def moving(self, *types: str) -> tuple[str, ...]:
        """Names of the joints of these types that move in the data."""
        return tuple(
            j.name for j, span in zip(self.robot.joints, self.span, strict=True) if j.type in types and span > 1e-6
        )


def _schema_of_estimate(schema: dict[str, Any], cls: type[Any]) -> None:
    """Name the parameters in the JSON Schema, for editors that complete and check."""
    known = getattr(cls, "parameters", ())
    if not known:
        return
    entry = schema["properties"]["estimate"]
    entry["properties"] = {name: _schema_of(dimension) for name, dimension in known}
    if cls.dimensions is Effect.dimensions:
        entry["additionalProperties"] = False


def _schema_of(dimension: str) -> dict[str, Any]:
    if dimension == "ratio":
        return {"type": "number", "description": "a ratio", "examples": [2e-4]}
    return {
        "type": "string", "description": f"{dimension} with its unit", "examples": [DIMENSIONS[dimension][1]]
    }  # fmt: skip


class Effect(CatalogueEntry):
    """One kind of effect that moves the tool point; ``estimate`` holds its parameters with their units."""

    model_config = ConfigDict(json_schema_extra=_schema_of_estimate)

    parameters: ClassVar[tuple[tuple[str, str], ...]]
    """Name and dimension of each linear parameter."""
    shape: ClassVar[tuple[str, ...]] = ()
    """Fields that enter in another way than linearly, found by a search."""
    family: ClassVar[Literal["named", "steps", "periodic"]] = "named"
    """Whose share of the error level a diagnosis tests it with: what comes in many shapes is kept by itself."""
    limits: ClassVar[tuple[float, float]] = (-math.inf, math.inf)
    """What an only parameter can be [SI]."""
    flexible: ClassVar[bool] = False
    """Whether it takes any smooth shape, and so stands for effects of other kinds too."""
    for_planning: ClassVar[bool] = True
    """Whether a task can be planned with it; what changes with time cannot be."""

    estimate: dict[str, Quantity] = Field({}, description="parameter: value with its unit")
    covariance: str | None = Field(None, min_length=1, description="CSV file with the covariance of the estimate")

    @abstractmethod
    def moves(self, site: ArmState) -> tuple[Sensitivity, ...]:
        """What each parameter does, in the order of ``parameters``."""

    @classmethod
    @abstractmethod
    def candidates(cls, case: Excitation) -> Sequence[Effect]:
        """Every instance that the data of ``case`` could show, one for each value of the shape's grid."""

    @property
    def name(self) -> str:
        """``kind(target)``, under which its parameters stand among the sources; a line tells its cycles."""
        label = "".join(f" {getattr(self, name):.4g}" for name in self.shape if name == "cycles")
        return f"{self.kind}({self.target}{label})"

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """``kind(target).parameter``."""
        return tuple(f"{self.name}.{name}" for name, _ in self.dimensions)

    @property
    def exclusive(self) -> tuple[object, ...]:
        """Effects that have it in common are shapes of one, of which a model holds one."""
        return self.kind, self.target

    @property
    def dimensions(self) -> tuple[tuple[str, str], ...]:
        """``parameters`` of this very instance."""
        return self.parameters

    @property
    def asks(self) -> frozenset[Input]:
        """``needs`` of this very instance."""
        return self.needs

    @property
    def values(self) -> tuple[float, ...]:
        """The estimate in SI units, zero for what is not stated."""
        given = self.estimate
        return tuple(_read(given[name], dimension) if name in given else 0.0 for name, dimension in self.dimensions)

    @model_validator(mode="after")
    def _estimate_fits(self) -> Effect:
        known = dict(self.dimensions)
        for name, value in self.estimate.items():
            if name not in known:
                raise ValueError(f"{self.kind} has no parameter '{name}'; its parameters: {', '.join(known)}")
            _read(value, known[name])
        return self

    def with_estimate(self, values: Sequence[float]) -> Effect:
        """The same effect with this estimate [SI]."""
        texts = {
            name: _text(value, dimension) for (name, dimension), value in zip(self.dimensions, values, strict=True)
        }
        return self.model_copy(update={"estimate": texts})


def _read(value: Any, dimension: str) -> float:
    if dimension == "ratio":
        if isinstance(value, bool) or not isinstance(value, int | float | np.floating):
            given = f"'{value}'" if isinstance(value, str) else "this"
            raise ValueError(f"{given} is no ratio; write a number such as 2e-4")
        return float(value)
    return parse_quantity(value, dimension)


def _text(value: float, dimension: str) -> Any:
    return float(value) if dimension == "ratio" else f"{value:.12g} {DIMENSIONS[dimension][0]}"


class SoleEffect(Effect):
    """An effect of which an arm has one: of its base, its payload or the instrument."""

    sole: ClassVar[str]
    """The target."""

    @property
    def target(self) -> str:
        return self.sole

    @classmethod
    def candidates(cls, case: Excitation) -> Sequence[Effect]:
        return [cls(kind=cls.model_fields["kind"].default)] if cls.needs <= case.inputs else []


class EffectOfJoint(Effect):
    """An effect of one joint, or of the link behind it."""

    types: ClassVar[tuple[str, ...]] = ("revolute",)

    joint: str = Field(description="the joint that errs")

    @property
    def target(self) -> str:
        return self.joint

    @classmethod
    def candidates(cls, case: Excitation) -> Sequence[Effect]:
        return [cls.of_joint(name) for name in case.moving(*cls.types)] if cls.needs <= case.inputs else []

    @classmethod
    def of_joint(cls, joint: str, **shape: Any) -> Effect:
        """The effect of one joint, nothing estimated yet."""
        return cls(joint=joint, **shape)

    def robot_fault(self, robot: Robot) -> str:
        types = {j.name: j.type for j in robot.joints}
        if self.joint not in types:
            return f"the robot has no joint '{self.joint}'; its joints: {', '.join(types)}"
        if types[self.joint] not in self.types:
            return f"{self.kind} is of {' and '.join(self.types)} joints, and {self.joint} is {types[self.joint]}"
        return ""


class JointEffect(EffectOfJoint):
    """An effect that adds to one joint: ``dq = Σ θ_k φ_k(q, u)``."""

    @abstractmethod
    def features(self, site: ArmState, joint: int) -> tuple[Scalar, ...]:
        """``φ_k`` of each parameter."""

    def moves(self, site: ArmState) -> tuple[Sensitivity, ...]:
        joint = site.robot.joint_names.index(self.joint)
        return tuple(Sensitivity({joint: feature}) for feature in self.features(site, joint))
