"""The arm that another one touches: what its problem file says, and where its tool is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from pydantic import Field, PrivateAttr

from posture_opt.model.arm import Arm
from posture_opt.model.chain import Vector, Walk, factor_values, walk
from posture_opt.model.fitted_geometry import geometry_behind_first_joint
from posture_opt.numerics import Array, stacked_rows
from posture_opt.robot.robot import Robot
from posture_opt.spec import Spec
from posture_opt.units import Length

_TOOL_POINT = ("tool.x", "tool.y", "tool.z")


@dataclass(frozen=True, eq=False)
class SecondArm:
    """An arm whose tool point is ``m(q; p)`` in the world of its own file, with parameters p that may be unknown.

    Args:
        arm: of its file; sigmas: stated standard deviations of its parameters [rad or m]; held: whether its geometry
            is known.
    """

    arm: Arm
    sigmas: Mapping[str, float]
    held: bool

    @property
    def robot(self) -> Robot:
        """The arm without its effects."""
        return self.arm.robot

    @property
    def columns(self) -> dict[str, str]:
        """Joint -> dimension of its column."""
        return {joint.name: "angle" if joint.type == "revolute" else "length" for joint in self.robot.joints}

    @cached_property
    def geometry(self) -> tuple[str, ...]:
        """The unknown parameters of its geometry; none where it is held."""
        return () if self.held else geometry_behind_first_joint(self.robot)

    @cached_property
    def unknowns(self) -> tuple[str, ...]:
        """All its unknown parameters: the geometry, and the tool point where that is free or has a stated σ."""
        return (*self.geometry, *(n for n in _TOOL_POINT if self.robot.tool_free or self.sigmas.get(n, 0.0) > 0))

    @cached_property
    def nominal(self) -> Array:
        """(u,) the values of these in its file [rad or m]."""
        return np.array([self.robot.parameters[name].nominal for name in self.unknowns])

    def unit(self, name: str) -> str:
        """SI unit of a parameter."""
        return "rad" if self.robot.parameters[name].kind == "rotate" else "m"

    def sigma(self, name: str) -> float:
        """What is stated of a parameter beforehand; 0 where nothing is, or where its frame is free."""
        return 0.0 if name in _TOOL_POINT and self.robot.tool_free else self.sigmas.get(name, 0.0)

    def walk(self, q: Array, values: Array) -> Walk:
        """The chain at postures q (N, n) with parameters ``values`` (N, u) or (u,)."""
        moved = (values - self.nominal).T
        return self.arm.reach(list(q.T), dict(zip(self.unknowns, moved, strict=True))).walk

    def points(self, q: Array, values: Array) -> Array:
        """(N, 3) tool points in the world of its file [m]."""
        return stacked_rows(self.walk(q, values).position, len(q))

    def shifts(self, q: Array, values: Array) -> list[Vector]:
        """Shift of the tool point by a unit of each unknown, three of (N,) each."""
        moved = dict(zip(self.unknowns, (values - self.nominal).T, strict=True))
        return [v for v, _ in self.arm.twists(self.unknowns, list(q.T), self.walk(q, values), moved)]

    @cached_property
    def base(self) -> Array:
        """(4, 4) of its base in the world of its file."""
        reached = walk(self.robot.base, factor_values(self.robot.base, []))
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = np.array(reached.columns, dtype=float).T, np.array(reached.position, dtype=float)
        return T


class PairSpec(Spec):
    """What is known of the second arm, whose joints are in the same row."""

    problem: str = Field(min_length=1, description="problem file of the second arm", examples=["right.yaml"])
    held: bool = Field(False, description="true: its geometry is known, as after a calibration")
    distance: Length = Field(
        0.0, ge=0, description="of both tool points at every touch, as the sum of the radii of two balls"
    )

    _found: SecondArm | None = PrivateAttr(None)

    @property
    def is_read(self) -> bool:
        """Whether the file of the second arm could be read."""
        return self._found is not None

    @property
    def found(self) -> SecondArm:
        """What the file of the second arm says."""
        assert self._found is not None, "the problem reads it"
        return self._found

    def with_arm(self, arm: Arm, sigmas: Mapping[str, float]) -> PairSpec:
        """The section with the arm of its file and the stated standard deviations of its parameters [rad or m]."""
        copy = self.model_copy()
        copy._found = SecondArm(arm, sigmas, self.held)
        return copy
