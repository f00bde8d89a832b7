"""``Sources``: which model parameters are uncertain, by how much, and how they are correlated; their names in reports.

The tool errs relative to the feature. With the errors e of the tool point, t and φ of the workpiece, a shift and a
small turn about its origin, and f of the feature itself, that is ``e − t − φ × l − f``, l the lever from the origin to
the feature. The workpiece's error is one draw for all its features, that of a feature a new draw at each.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated

import numpy as np
from pydantic import Field, model_validator

from posture_opt.errors import BadValueError, InputError, Issue
from posture_opt.model.arm import Arm, Twist
from posture_opt.model.arm_state import REFERENCE_TEMPERATURE
from posture_opt.model.chain import ZERO, Vector, cross
from posture_opt.numerics import Array
from posture_opt.spec import Spec
from posture_opt.statements.notation import stated_sigma
from posture_opt.units import Angle, Length, shown

_EIGENVALUE_ROUNDING = 1e-9  # of a matrix of correlations, per row: what float arithmetic leaves of a zero


@dataclass(frozen=True, eq=False)
class Sources:
    """Named Gaussian errors of model parameters with mean zero and one covariance matrix."""

    names: tuple[str, ...] = ()  # (k,) names of model parameters, JOINT.PARAMETER
    covariance: Array = field(default_factory=lambda: np.zeros((0, 0)))  # (k, k), SI units: rad², m², rad m
    notes: tuple[str, ...] = ()  # sentences for the report on where the numbers come from
    # (k, k) the part of the covariance that is drawn anew at every repeat; the rest is what is not known of errors that
    # stay. Where it is left out, no part
    scatter: Array = field(default_factory=lambda: np.zeros((0, 0)))
    details: tuple[str, ...] = ()  # those of the notes that a report of one screen leaves out
    assumed: bool = False  # whether nothing was stated, so that the repeatability of the data sheet stands for it

    def __post_init__(self) -> None:
        """Makes both matrices read-only arrays of the right size."""
        size = (len(self.names),) * 2
        for name in ("covariance", "scatter"):
            matrix = np.array(getattr(self, name), dtype=float)
            if name == "scatter" and not matrix.size:
                matrix = np.zeros(size)
            assert matrix.shape == size, "the covariance has a row for each name"
            matrix.setflags(write=False)
            object.__setattr__(self, name, matrix)

    @classmethod
    def independent(cls, sigma: Mapping[str, float], notes: Sequence[str] = ()) -> Sources:
        """Sources without correlation from standard deviations [rad or m]."""
        return cls(tuple(sigma), np.diag(np.square(list(sigma.values()))), tuple(notes))

    @classmethod
    def scattering(cls, sigma: Mapping[str, float], notes: Sequence[str] = ()) -> Sources:
        """Sources without correlation that are drawn anew at every repeat, from standard deviations [rad or m]."""
        found = cls.independent(sigma, notes)
        return cls(found.names, found.covariance, found.notes, found.covariance)

    @property
    def constant(self) -> Array:
        """(k, k) covariance of what is not known of the errors that stay from repeat to repeat."""
        return self.covariance - self.scatter

    @property
    def sigma(self) -> Array:
        """(k,) standard deviations [rad or m]."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @property
    def correlated(self) -> bool:
        """Whether any two sources vary together."""
        return bool(np.any(self.covariance[~np.eye(len(self.names), dtype=bool)]))

    @property
    def empty(self) -> bool:
        return not self.names

    def same_as(self, other: Sources) -> bool:
        """Whether both state the same errors."""
        mine, theirs = ((one.covariance, one.scatter) for one in (self, other))
        return self.names == other.names and all(map(np.array_equal, mine, theirs))

    def without(self, names: Sequence[str]) -> Sources:
        """The sources but for some names, with their covariance and scatter."""
        kept = [k for k, name in enumerate(self.names) if name not in names]
        at = np.ix_(kept, kept)
        names = tuple(self.names[k] for k in kept)
        return replace(self, names=names, covariance=self.covariance[at], scatter=self.scatter[at])

    def joined(self, other: Sources) -> Sources:
        """Both sets of sources, the two independent of each other."""
        twice = sorted(set(self.names) & set(other.names))
        if twice:
            raise InputError(Issue(f"the error of {', '.join(twice)} is stated twice", hint="state it once"))
        return self.plus(other)

    def plus(self, other: Sources) -> Sources:
        """The sum of both errors, independent of each other: covariances add up where both name a parameter."""
        names = tuple(dict.fromkeys((*self.names, *other.names)))
        covariance, scatter = np.zeros((2, len(names), len(names)))
        for part in (self, other):
            at = np.ix_(*[[names.index(name) for name in part.names]] * 2)
            covariance[at] += part.covariance
            scatter[at] += part.scatter
        notes, details = (*self.notes, *other.notes), (*self.details, *other.details)
        return Sources(names, covariance, notes, scatter, details, self.assumed or other.assumed)


def covariance_issues(names: Sequence[str], covariance: Array) -> list[Issue]:
    """What keeps a symmetric matrix from being a covariance: negative variances or impossible correlations. A matrix is
    a covariance exactly if it is positive semidefinite. The test is made on the matrix of correlations, which has no
    units: in the covariance itself a few rad² would drown in m², or the reverse."""
    variance = np.diag(covariance)
    negative = [name for name, v in zip(names, variance, strict=True) if v < 0]
    if negative:
        return [Issue(f"negative variance of {', '.join(negative)}", hint="a variance is 0 or greater")]
    sigma = np.sqrt(variance)
    far = [
        f"{name} is {s:.4g}" for name, s in zip(names, sigma, strict=True) if s > 1e5
    ]  # a unit or an exponent is wrong
    if far:
        return [Issue(f"not plausible: the σ of {', '.join(far)}", hint="in m or rad; are unit and exponent right?")]
    idle = sigma == 0
    for i, j in np.argwhere((covariance != 0) & idle[:, None]):
        return [Issue(f"{names[i]} has variance 0 but covaries with {names[j]}", hint="state its variance")]
    correlation = covariance[~idle][:, ~idle] / np.outer(sigma[~idle], sigma[~idle])
    beyond = np.argwhere(np.triu(np.abs(correlation) > 1 + _EIGENVALUE_ROUNDING, 1))
    varying = [name for name, still in zip(names, idle, strict=True) if not still]
    if len(beyond):
        hint = "a correlation lies between -1 and 1"
        texts = [f"the correlation of {varying[i]} and {varying[j]} is {correlation[i, j]:.6g}" for i, j in beyond]
        return [Issue(text, hint=hint) for text in texts]
    return _definiteness_issues(varying, correlation)


def _definiteness_issues(names: Sequence[str], correlation: Array) -> list[Issue]:
    """The issue about a matrix of correlations (k, k) with a negative eigenvalue, and the sources that cause it."""
    if not len(names):
        return []
    values, vectors = np.linalg.eigh(correlation)
    if values[0] >= -_EIGENVALUE_ROUNDING * len(names):
        return []
    # The eigenvector says which combination of errors would have a negative variance.
    weights = np.abs(vectors[:, 0])
    involved = [name for name, w in zip(names, weights, strict=True) if w > 0.1 * weights.max()]
    message = (
        f"not positive semidefinite: the correlations of {', '.join(involved)} contradict each other "
        f"(smallest eigenvalue of the correlation matrix {values[0]:.4g})"
    )
    return [Issue(message, hint="no random errors have such correlations; make them smaller until it is 0 or greater")]


# What is stated of workpiece and features, by the keys of the section uncertainty
POSITION, ANGLE, FEATURE = "workpiece.position", "workpiece.angle", "feature.position"
# Each error has three independent coordinates of one standard deviation; they are sources with these ends
COORDINATES = "xyz"


class WorkpieceErrors(Spec):
    """Standard deviations of where a workpiece stands: one draw for all its features, independent in each coordinate.

    A feature at the lever l from the workpiece's origin has the covariance ``s² I + a² (|l|² I − l lᵀ)`` of it.
    """

    position: Annotated[Length, Field(ge=0)] = Field(
        0.0, description="of each coordinate of its origin", examples=["0.05 mm"]
    )
    # Turns enter to first order: at 5 deg the variance that they cause is right to 2 %.
    angle: Annotated[Angle, Field(ge=0, le=math.radians(5.0))] = Field(
        0.0, description="of each small turn, about x, y and z through its origin", examples=["0.02 deg"]
    )

    @model_validator(mode="after")
    def _says_something(self) -> WorkpieceErrors:
        if not self.model_fields_set:
            raise BadValueError("neither position nor angle is stated", "write workpiece: {position: 0.05 mm}")
        return self


class FeatureErrors(Spec):
    """Standard deviation of where a feature is in its workpiece: a new draw for each feature."""

    position: Annotated[Length, Field(ge=0)] = Field(description="of each coordinate", examples=["0.02 mm"])


def workpiece_sources(workpiece: WorkpieceErrors | None, feature: FeatureErrors | None) -> Sources:
    """The stated errors as sources, one for each coordinate; what is zero or not stated is left out."""
    shared: dict[str, float] = {}
    if workpiece is not None:
        shared = _isotropic(POSITION, workpiece.position) | _isotropic(ANGLE, workpiece.angle)
    own = {} if feature is None else _isotropic(FEATURE, feature.position)
    return Sources.independent(shared).plus(Sources.scattering(own))


def _isotropic(stated: str, sigma: float) -> dict[str, float]:
    return {f"{stated}.{c}": sigma for c in COORDINATES} if sigma > 0 else {}


def stated_name(name: str) -> str:
    """What the file calls a source: ``workpiece.angle`` for each of its coordinates; any other by its own name."""
    stated, _, coordinate = name.rpartition(".")
    return stated if stated in (POSITION, ANGLE, FEATURE) and coordinate in COORDINATES else name


def of_workpiece(name: str) -> bool:
    """Whether a source is one of the workpiece or of its features."""
    return stated_name(name) != name


def relative_twist(name: str, lever: Vector) -> Twist:
    """Shift and small rotation of the tool relative to the feature, per unit of an error of workpiece or feature. name:
    of the source; lever: (3,) from the workpiece's origin to the point of the tool [m], world."""
    k = COORDINATES.index(name[-1])
    away: Vector = (-float(k == 0), -float(k == 1), -float(k == 2))
    return (cross(away, lever), away) if stated_name(name) == ANGLE else (away, ZERO)


_PARAMETERS = {
    "theta": "angle",
    "d": "offset",
    "a": "link length",
    "alpha": "twist",
    "beta": "tilt",
    **{name: f"frame, {name}" for name in ("x", "y", "z", "roll", "pitch", "yaw")},
}
_OF_WORKPIECE = {POSITION: "workpiece position", ANGLE: "workpiece angle", FEATURE: "feature position"}


def source_words(name: str, arm: Arm) -> str:
    """A named source of error in words: ``joint1.theta`` is the joint1 angle."""
    if said := _OF_WORKPIECE.get(name) or _source_of_effect(name, arm):
        return said
    owner, _, parameter = name.rpartition(".")
    prismatic = any(joint.name == owner and joint.type == "prismatic" for joint in arm.robot.joints)
    if prismatic and parameter == "d":
        return f"{owner} travel"
    if owner in ("base", "tool"):
        return f"{owner} {parameter}"
    return f"{owner} {_PARAMETERS[parameter]}" if owner and parameter in _PARAMETERS else name


def source_size(name: str, sigma: float, arm: Arm) -> str:
    """The standard deviation of a source with its unit."""
    if said := _spread_of_effect(name, sigma, arm):
        return said
    if name in _OF_WORKPIECE:
        return stated_sigma(sigma, "rad" if name == ANGLE else "m")
    factor = arm.robot.parameters.get(name)
    return stated_sigma(sigma, "m" if factor is not None and factor.kind == "translate" else "rad")


def _source_of_effect(name: str, arm: Arm) -> str:
    """A parameter of an effect, or a side that is not known, as a source of error; empty for other sources."""
    if name in arm.unknown_sides:
        return f"{name.removesuffix('.side')} side of approach"
    for found in arm.measured_ranges:
        if name == found.name:
            return f"{found.effect.target} {found.effect.title} beyond its measured range"
    for effect in arm.effects:
        if name in effect.parameter_names:
            parameter = name.removeprefix(f"{effect.name}.")
            what = effect.title if len(effect.dimensions) == 1 else f"{effect.title}, {parameter}"
            return f"{effect.target} {what}"
    return ""


def _spread_of_effect(name: str, sigma: float, arm: Arm) -> str:
    """The standard deviation of a parameter of an effect with its unit; empty for other sources."""
    if name in arm.unknown_sides:
        return "either side"
    for found in arm.measured_ranges:
        if name == found.name:
            return shown(sigma * found.effect.unmeasured_size, "angle")
    dimension = arm.dimensions.get(name)
    return "" if dimension is None else shown(sigma, dimension)


def conditions(arm: Arm) -> tuple[str, ...]:
    """Payload, sides of approach, temperature and time, each where an effect of the arm needs it."""
    asked = {need for effect in arm.effects for need in (*effect.asks, *effect.needs)}
    inputs, texts = arm.inputs, []
    if asked & {"masses", "payload"}:
        texts.append(f"a payload of {inputs.payload:.6g} kg")
    for joint in dict.fromkeys(e.target for e in arm.effects if "approach" in e.needs):
        if joint in inputs.stated:
            sense = "increasing" if inputs.side(arm.robot.joint_names.index(joint)) > 0 else "decreasing"
            texts.append(f"{joint} arriving with {sense} values")
        else:
            texts.append(f"{joint} approached from either side")
    if "temperature" in asked:
        texts.append(f"{REFERENCE_TEMPERATURE + inputs.temperature:.6g} degC")
    if "time" in asked:
        texts.append(f"{inputs.time:.6g} s after the first measurement")
    return tuple(texts)
