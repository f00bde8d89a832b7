"""Errors of the workpiece and of its features: no part of the arm, but of every task that is done at them.

The tool errs relative to the feature. With the errors e of the tool point, t and φ of the workpiece, a shift and a
small turn about its origin, and f of the feature itself, that is ``e − t − φ × l − f``, l the lever from the origin to
the feature. The workpiece's error is one draw for all its features, that of a feature a new draw at each.
"""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import Field, model_validator

from posture_opt.errors import BadValueError
from posture_opt.model.arm import Twist
from posture_opt.model.chain import ZERO, Vector, cross
from posture_opt.spec import Spec
from posture_opt.uncertainty.sources.sources import Sources
from posture_opt.units import Angle, Length

POSITION, ANGLE, FEATURE = "workpiece.position", "workpiece.angle", "feature.position"
"""What is stated of workpiece and features, by the keys of the section ``uncertainty``."""
COORDINATES = "xyz"
"""Each error has three independent coordinates of one standard deviation; they are sources with these ends."""
_MAX_ANGLE = math.radians(5.0)
"""Turns enter to first order: at 5 deg the variance that they cause is right to 2 %."""


class WorkpieceErrors(Spec):
    """Standard deviations of where a workpiece stands: one draw for all its features, independent in each coordinate.

    A feature at the lever l from the workpiece's origin has the covariance ``s² I + a² (|l|² I − l lᵀ)`` of it.
    """

    position: Annotated[Length, Field(ge=0)] = Field(
        0.0, description="of each coordinate of its origin", examples=["0.05 mm"]
    )
    angle: Annotated[Angle, Field(ge=0, le=_MAX_ANGLE)] = Field(
        0.0, description="of each small turn, about x, y and z through its origin", examples=["0.02 deg"]
    )

    @model_validator(mode="after")
    def _says_something(self) -> WorkpieceErrors:
        """The section as it is, unless it states nothing."""
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
    """The three coordinates of an error with their standard deviation; none where that is zero."""
    return {f"{stated}.{c}": sigma for c in COORDINATES} if sigma > 0 else {}


def stated_name(name: str) -> str:
    """What the file calls a source: ``workpiece.angle`` for each of its coordinates; any other by its own name."""
    stated, _, coordinate = name.rpartition(".")
    return stated if stated in (POSITION, ANGLE, FEATURE) and coordinate in COORDINATES else name


def of_workpiece(name: str) -> bool:
    """Whether a source is one of the workpiece or of its features."""
    return stated_name(name) != name


def relative_twist(name: str, lever: Vector) -> Twist:
    """Shift and small rotation of the tool relative to the feature, per unit of an error of workpiece or feature.

    Args:
        name: of the source.
        lever: (3,) from the workpiece's origin to the point of the tool [m], world.
    """
    k = COORDINATES.index(name[-1])
    away: Vector = (-float(k == 0), -float(k == 1), -float(k == 2))
    return (cross(away, lever), away) if stated_name(name) == ANGLE else (away, ZERO)
