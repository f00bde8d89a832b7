"""``Effect``: what moves the tool point beyond the geometry, by parameters that are zero in the nominal model."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, Literal

import numpy as np
from pydantic import ConfigDict, Field, model_validator

from posture_opt.errors import BadValueError
from posture_opt.model.arm_state import ArmState
from posture_opt.model.chain import ZERO, Scalar, Vector, cross, scale, subtract
from posture_opt.model.effects.base.cause import Abscissa, CatalogueEntry, FittedSizes, Input, Quantity, Size
from posture_opt.model.effects.base.multiples import RotatingPart
from posture_opt.model.effects.base.plausible_range import PlausibleRange
from posture_opt.numerics import Array
from posture_opt.robot.robot import Robot
from posture_opt.units import DIMENSIONS, parse_quantity, shown

NOT_NEGATIVE = (0.0, math.inf)  # Limits of a parameter [SI] that yields along a load: with the other sign it does not
# Factor to either side of a point on a geometric grid of shapes, between which the best shape is searched
_SHAPE_NEIGHBOUR = 1.6


@dataclass(frozen=True)
class Sensitivity:
    """What one unit of a parameter does: it adds to joints and lengths, and shifts and turns the tool."""

    joints: Mapping[int, Scalar] = field(default_factory=dict)  # joint index -> increment of the joint value [rad or m]
    lengths: Mapping[str, Scalar] = field(default_factory=dict)  # name of a model parameter -> increment [rad or m]
    # shift (3,) of the tool point [m] and small rotation (3,) of the tool [rad], (v, ω), world axes
    twist: tuple[Vector, Vector] = (ZERO, ZERO)

    @property
    def of_joints(self) -> bool:
        """Whether it adds to joint values and to nothing else."""
        return not self.lengths and all(v is ZERO for v in self.twist)

    def scaled(self, factor: Scalar) -> Sensitivity:
        """What ``factor`` units do; a twist that is exactly zero stays so."""
        shift, turn = (v if v is ZERO else scale(factor, v) for v in self.twist)
        joints = {joint: factor * size for joint, size in self.joints.items()}
        return Sensitivity(joints, {name: factor * size for name, size in self.lengths.items()}, (shift, turn))


@dataclass(frozen=True)
class Excitation:
    """What measurements, or a problem, can show of effects."""

    robot: Robot  # whose joints they are
    inputs: frozenset[Input]  # those that are known and vary: approach, payload, temperature, time
    span: tuple[float, ...]  # (n,) range of each joint in the data [rad or m]
    duration: float = 0.0  # of the measurements [s]
    times: tuple[float, ...] = ()  # (N,) of the rows [s]; empty where nothing is measured
    # whether a turn of the tool about its point shows: orientations, or several targets, are measured
    oriented: bool = False
    contact: bool = False  # whether the tool touches what is measured, and no instrument looks at it

    def moving(self, *types: str) -> tuple[str, ...]:
        """Names of the joints of these types that move in the data."""
        return tuple(
            j.name for j, span in zip(self.robot.joints, self.span, strict=True) if j.type in types and span > 1e-6
        )


def _schema_of_estimate(schema: dict[str, Any], cls: type[Any]) -> None:
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

    model_config: ClassVar[ConfigDict] = ConfigDict(json_schema_extra=_schema_of_estimate)

    parameters: ClassVar[tuple[tuple[str, str], ...]]  # Name and dimension of each linear parameter
    shape: ClassVar[tuple[str, ...]] = ()  # Fields that enter in another way than linearly, found by a search
    # Whose share of the error level a diagnosis tests it with: what comes in many shapes is kept by itself
    family: ClassVar[Literal["named", "steps", "periodic"]] = "named"
    # What its parameters can be [SI]; of several, where each of them has the same limits
    limits: ClassVar[tuple[float, float]] = (-math.inf, math.inf)
    # RMS over the rows of a shift that it can make, in σ of the instrument as stated
    largest_shift: ClassVar[float] = math.inf
    flexible: ClassVar[bool] = False  # Whether it takes any smooth shape, and so stands for effects of other kinds too
    for_planning: ClassVar[bool] = True  # Whether a task can be planned with it; what changes with time cannot be
    # Whether it is a slow curve over its joint, of which several together can imitate any other
    slow: ClassVar[bool] = False
    # How many of the kind one session can have; None where nothing limits them
    most_in_session: ClassVar[int | None] = None
    relative_shape: ClassVar[bool] = True  # Whether errors of the shape are shares of it; else they are in its own unit

    estimate: dict[str, Quantity] = Field({}, description="parameter: value with its unit")
    covariance: str | None = Field(None, min_length=1, description="CSV file with the covariance of the estimate")
    size_undetermined: bool | None = Field(
        None, description="the estimate holds together with the rest of the file, and is no size of the cause by itself"
    )

    @abstractmethod
    def sensitivities(self, state: ArmState) -> tuple[Sensitivity, ...]:
        """The effect of one unit [SI] of each parameter at a posture, in the order of ``parameters``."""

    @classmethod
    @abstractmethod
    def candidates(cls, case: Excitation) -> Sequence[Effect]: ...

    @classmethod
    def unknown_loads(cls, case: Excitation) -> Iterator[tuple[Effect, tuple[str, ...]]]:
        """Instances for an arm without stated masses, each with the frames at which its masses may be."""
        yield from ()

    def carried(self, robot: Robot, q: Sequence[Scalar]) -> Mapping[int, Scalar]:
        """Joint index -> how far joints are off ``q`` (n,) by its estimate, if loads change by it [rad]."""
        return {}

    @property
    def valid_between(self) -> tuple[float, float] | None:
        """Values of its joint [rad] beyond which it is unknown; None if it is known everywhere."""
        return None

    @property
    def unmeasured_size(self) -> float:
        """Standard deviation [rad] of its joint beyond these values."""
        return 0.0

    def unknown_beyond(self, joint: int, outside: Scalar) -> Sensitivity:
        """One standard deviation of it as an increment [rad], times 1 ``outside`` of its range, else 0."""
        return Sensitivity({joint: self.unmeasured_size * outside})

    def measured_over(self, low: float, high: float) -> Effect:
        """Found from values of its joint between ``low`` and ``high`` [rad]."""
        return self

    def also_measured(self, other: Effect) -> Effect:
        """Known in its own range and in that of another finding."""
        return self

    def known_everywhere(self) -> Effect:
        """Without a range, as it is fitted."""
        return self

    def acts(self, state: ArmState) -> bool:
        """Whether it can do anything in these postures; False leaves it out of a diagnosis."""
        return True

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """``kind(target).parameter`` of each parameter, unique in an arm."""
        return tuple(f"{self.name}.{name}" for name, _ in self.dimensions)

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
        """The estimate in SI units, in the order of `dimensions`; zero for a parameter that is not stated."""
        given = self.estimate
        return tuple(
            _read_parameter(given[name], dimension) if name in given else 0.0 for name, dimension in self.dimensions
        )

    @property
    def smooth_shape(self) -> str:
        """The field that is fitted with the parameters, or an empty text."""
        return self.shape[0] if self.shape else ""

    def bracket(self, span: float) -> tuple[float, float]:
        """Bounds of a better smooth shape [SI] about a point of the grid; ``span`` of its joint in the data [rad]."""
        value = float(getattr(self, self.smooth_shape))
        return value / _SHAPE_NEIGHBOUR, value * _SHAPE_NEIGHBOUR

    def shape_steps(self, state: ArmState) -> Array:
        """(k,) neighbouring shapes that differ in the data, of an effect that depends on its shape in steps."""
        return np.zeros(0)

    def with_shape(self, value: float) -> Effect:
        return self.model_copy(update={self.shape[0]: value})

    def reshaped(self, deviation: float) -> Effect:
        """With its smooth shape off by ``deviation``: of its logarithm if errors are relative, else [SI]."""
        value = float(getattr(self, self.smooth_shape))
        return self.with_shape(value * math.exp(deviation) if self.relative_shape else value + deviation)

    def shape_deviation(self, known: Effect) -> float:
        """The inverse of `reshaped`, from the shape of ``known``."""
        one, other = (float(getattr(effect, self.smooth_shape)) for effect in (known, self))
        return math.log(other / one) if self.relative_shape else other - one

    def abscissa(self, state: ArmState, timed: bool = True) -> Abscissa | None:
        """The axis of its curve over the rows, or None if it depends on several things at once."""
        return None

    def plausible(self, robot: Robot) -> PlausibleRange | None:
        """The sizes that arms can have, by published figures."""
        return None

    def plausible_size(self, estimate: FittedSizes) -> tuple[float, float]:
        """The size [SI] that `plausible` bounds, with its standard error: its first parameter."""
        return estimate.entry(self.dimensions[0][0])

    def rotating_parts(self, robot: Robot) -> tuple[RotatingPart, ...]:
        """Parts of its joint that turn as often as it repeats."""
        return ()

    @property
    def less_likely(self) -> bool:
        """Whether it needs more evidence, as its rival is the usual cause."""
        return False

    @property
    def unstated_loads(self) -> bool:
        """Whether its parameters stand for unstated loads, so that none of them is its size."""
        return False

    def sizes(self, estimate: FittedSizes) -> tuple[Size, ...]:
        dimensions = dict(self.dimensions)
        found = [self.size(n, dimensions[n], *estimate.entry(n)) for n in dimensions if n in estimate.values]
        return tuple(found)

    def size(self, name: str, dimension: str, value: float, std: float) -> Size:
        """One parameter, estimate and standard error [SI]."""
        return Size(name.replace("_", " "), shown(value, dimension, std))

    @property
    def stated_size(self) -> str:
        """The first size that the entry states."""
        if self.size_undetermined:
            return "(size undetermined)"
        values = {n: (v, math.nan, "") for (n, _), v in zip(self.dimensions, self.values, strict=True)}
        values |= {n: (float(getattr(self, n)), math.nan, "") for n in self.shape}
        estimate = FittedSizes(values)
        if not self.headline(estimate):
            return f"({len(self.dimensions)} coefficients)"
        return str(self.sizes(estimate)[0])

    @model_validator(mode="after")
    def _estimate_fits(self) -> Effect:
        known = dict(self.dimensions)
        for name, value in self.estimate.items():
            if name not in known:
                raise BadValueError(f"{self.kind} has no parameter '{name}'", f"its parameters: {', '.join(known)}")
            _read_parameter(value, known[name])
        return self

    @property
    def size_parts(self) -> tuple[slice, ...]:
        """Slices of the parameters that have a size each."""
        return (slice(0, len(self.dimensions)),)

    def of_parts(self, parts: Sequence[int]) -> Effect:
        """The effect of some of its parts alone, its estimate with it."""
        return self

    def without_parts(self, parts: Sequence[int]) -> Effect | None:
        others = [i for i in range(len(self.size_parts)) if i not in parts]
        return self.of_parts(others) if others else None

    def with_estimate(self, values: Sequence[float]) -> Effect:
        """With this estimate [SI] in the order of `dimensions`, written with twelve digits."""
        texts = {
            name: float(value) if dimension == "ratio" else f"{value:.12g} {DIMENSIONS[dimension][0]}"
            for (name, dimension), value in zip(self.dimensions, values, strict=True)
        }
        return self.model_copy(update={"estimate": texts})


def _read_parameter(value: object, dimension: str) -> float:
    if dimension == "ratio":
        if isinstance(value, bool) or not isinstance(value, int | float | np.floating):
            given = f"'{value}'" if isinstance(value, str) else "this"
            raise BadValueError(f"{given} is no ratio", "write a number such as 2e-4")
        return float(value)
    return parse_quantity(value, dimension)


class SoleEffect(Effect):
    """An effect of which an arm has one: of its base, its payload or the instrument."""

    sole: ClassVar[str]  # The target

    @property
    def target(self) -> str:
        """The class variable ``sole``."""
        return self.sole

    @classmethod
    def candidates(cls, case: Excitation) -> Sequence[Effect]:
        return [cls(kind=cls.model_fields["kind"].default)] if cls.needs <= case.inputs else []


# Parameters about the x, y and z axis [rad]: the world's of the base, its own of the tool
ANGLES = ("roll", "pitch", "yaw")
WORLD_AXES: tuple[Vector, ...] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


def foot(state: ArmState) -> Vector:
    """(3,) where the axis of the first joint passes the base [m], world."""
    return state.walk.screws[len(state.robot.base)].origin


def frame_motion(
    state: ArmState, names: Sequence[str], axes: Sequence[Vector], about: Vector, size: Scalar
) -> tuple[Sensitivity, ...]:
    """The tool point per unit of ``names`` (x, y, z [m], roll, pitch, yaw [rad]): a frame that moves along and about
    ``axes`` through the point ``about`` (3,) [m], world, times ``size``."""
    vectors, lever = [scale(size, axis) for axis in axes], subtract(state.tool, about)
    units = dict(zip("xyz", (Sensitivity(twist=(v, ZERO)) for v in vectors), strict=True))
    units |= {name: Sensitivity(twist=(cross(v, lever), v)) for name, v in zip(ANGLES, vectors, strict=True)}
    return tuple(units[name] for name in names)
