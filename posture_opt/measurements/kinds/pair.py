"""Two arms whose tools touch: the second one by its problem file, the joints of both in a row."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import ClassVar

import numpy as np
from pydantic import Field, PrivateAttr

from posture_opt.errors import BadValueError, listed
from posture_opt.measurements.kinds.kind import Kind, Seen, Slots, Vector, dot, stacked
from posture_opt.measurements.rotations import FRAME_UNKNOWNS, FreeFrame, described_pose, rigid
from posture_opt.model.arm import Arm
from posture_opt.model.chain import Walk, factor_values, walk
from posture_opt.numerics import Array, Json, Mask, stacked_rows
from posture_opt.robot.corrections import geometry_behind_first_joint
from posture_opt.robot.robot import Robot
from posture_opt.spec import Spec
from posture_opt.units import Length

_TOOL_POINT = ("tool.x", "tool.y", "tool.z")


@dataclass(frozen=True, eq=False)
class SecondArm:
    """An arm whose tool point is ``m(q; p)`` in the world of its own file, with parameters p that may be unknown."""

    arm: Arm  # of its file
    sigmas: Mapping[str, float]  # stated standard deviations of its parameters [rad or m]
    held: bool  # whether its geometry is known

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
        return rigid(np.array(reached.columns, dtype=float).T, np.array(reached.position, dtype=float))


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


@dataclass(frozen=True, eq=False)
class PairContact(Kind):
    """``0 = p − T m(q₂)``, or ``0 = |p − T m(q₂)| − d``: the tool points of two arms meet, or are d apart.

    T is the frame of the second arm in the world of the first, unknown; m its tool point in that frame, with its own
    unknown parameters unless it is held. A reading is the joints q₂. Of both bases only the pose of one in the other is
    determined. Source: Stepanova et al. (2022), self-contact of two arms.
    """

    kind: ClassVar[str] = "pair"
    noun: ClassVar[str] = "touches of two arms"
    sigma_key: ClassVar[str] = "pair"
    settings: ClassVar[str] = "pairs"
    example: ClassVar[str] = "the joints of a second arm (data.pairs) for two arms that touch"
    contact: ClassVar[bool] = True
    error_words: ClassVar[str] = "distance of the tools"
    remedy: ClassVar[str] = (
        "add one known length: hold the arm that is calibrated (held: true), or give a link its measured value"
    )

    frame: FreeFrame = field(default_factory=FreeFrame)  # T, about the one that suits both nominal arms
    width: int = 6  # type: ignore[misc]
    axis_names: tuple[str, ...] = ("x", "y", "z")  # type: ignore[misc]
    blind_spot: str = ""  # type: ignore[misc]

    @classmethod
    def of(cls, data: object, names: Sequence[str], seconds: Sequence[str] = ()) -> PairContact:
        stated: Mapping[str, PairSpec] = data.pairs  # type: ignore[attr-defined]
        if len(stated) > 1:
            hint = "a file has touches with one of them: keep it"
            raise BadValueError(f"several second arms: {listed(stated)}", hint)
        spec = next(iter(stated.values()))
        axes = ("along the line of the tools",) if spec.distance else ("x", "y", "z")
        blind = "" if spec.held else "two arms that touch give no scale: both grow together"
        return cls(stated=stated, names=names, width=6 + len(spec.found.unknowns), axis_names=axes, blind_spot=blind)

    @classmethod
    def columns_in(cls, data: object) -> Mapping[str, str]:
        stated: Mapping[str, PairSpec] = getattr(data, cls.settings)
        read = {name: spec.found.columns for name, spec in stated.items() if spec.is_read}
        return {f"{name}.{joint}": dimension for name, own in read.items() for joint, dimension in own.items()}

    @property
    def read_columns(self) -> Mapping[str, str]:
        return {f"{self.second_name}.{joint}": d for joint, d in self.second.columns.items()}

    @property
    def second_name(self) -> str:
        """What the file calls the second arm."""
        return next(iter(self.stated))

    @property
    def spec(self) -> PairSpec:
        """What the file says of the second arm."""
        found: PairSpec = self.stated[self.second_name]
        return found

    @property
    def second(self) -> SecondArm:
        """The second arm."""
        return self.spec.found

    @property
    def second_arms(self) -> Mapping[str, SecondArm]:
        return {self.second_name: self.second}

    @property
    def fixes_size(self) -> bool:
        return self.spec.held

    def places(self, names: Sequence[str]) -> Sequence[str]:
        return (self.second_name,)

    @property
    def place_noun(self) -> str:
        return "the second arm"

    def prepared(self, seen: Seen, moving: Mask, up: Array) -> PairContact:
        """The frame of the second arm in which both nominal arms meet best."""
        points = stacked(seen.position, len(seen.place))
        there = self.second.points(_joints(self, seen), self.second.nominal)
        return replace(self, frame=FreeFrame.fitted(points, there))

    def unknowns(self, place: str) -> tuple[tuple[str, str], ...]:
        return (*FRAME_UNKNOWNS, *((name, self.second.unit(name)) for name in self.second.unknowns))

    def parameter(self, place: str, name: str) -> str:
        own = f"base.{name}" if name in dict(FRAME_UNKNOWNS) else name
        return f"{self.second_name}.{own}"

    def group(self, place: str, name: str) -> str:
        return "second_arm" if name in self.second.geometry else "place"

    def nominal(self, place: str, name: str) -> float:
        return float(self.second.nominal[self.second.unknowns.index(name)]) if name in self.second.unknowns else 0.0

    def prior_sigma(self, place: str, name: str) -> float:
        return self.second.sigma(name) if name in self.second.unknowns else 0.0

    def start(self, seen: Seen, places: int) -> Array:
        return np.tile(np.r_[np.zeros(6), self.second.nominal], (places, 1))

    def error(self, seen: Seen) -> Slots:
        """``p − T m``, or its length less d."""
        apart, length = _apart(self, seen)
        return (length - self.spec.distance,) if self.spec.distance else tuple(apart)

    def slope(self, seen: Seen, shift: Vector, turn: Vector) -> Slots:
        return self._along(seen, shift)

    def unknown_slope(self, seen: Seen, axis: int) -> Slots:
        """``−∂(T m)`` by the frame or a parameter of the second arm."""
        if axis < 6:
            moved = self.frame.slope(seen.values, _there(self, seen), axis)
        else:
            own = stacked(_shifts(self, seen)[axis - 6], len(seen.place))
            moved = tuple(self.frame.rotated(seen.values, own).T)
        return self._along(seen, [-m for m in moved])

    def aspect(self, seen: Seen) -> Array:
        walked = self.second.walk(_joints(self, seen), _own(self, seen))
        axis = self.frame.rotated(seen.values, stacked(walked.columns[2], len(seen.place)))
        return np.asarray(dot(seen.columns[2], axis.T))[:, None]

    def expected(self, seen: Seen) -> Array:
        return seen.reading

    def described(self, place: str, values: Array) -> dict[str, Json]:
        """Pose of the second arm's base in the world of the first, and its tool point where free [m, rad]."""
        found = described_pose(self.frame.pose(values) @ self.second.base)
        own = zip(self.second.unknowns, values[6:], strict=False)
        return found | {name: float(value) for name, value in own if name not in self.second.geometry}

    def _along(self, seen: Seen, shift: Vector) -> Slots:
        """What a change of ``p − T m`` does to a reading."""
        if not self.spec.distance:
            return tuple(shift)
        apart, length = _apart(self, seen)
        return (dot(apart, shift) / np.maximum(length, 1e-9),)


@lru_cache(maxsize=4)
def _there(kind: PairContact, seen: Seen) -> Array:
    """(N, 3) tool points of the second arm in its own frame."""
    return kind.second.points(_joints(kind, seen), _own(kind, seen))


@lru_cache(maxsize=4)
def _apart(kind: PairContact, seen: Seen) -> tuple[list[Array], Array]:
    """``p − T m``, three of (N,), and its length (N,) [m]."""
    there = kind.frame.placed(seen.values, _there(kind, seen))
    apart = [np.asarray(seen.position[a] - there[:, a]) for a in range(3)]
    return apart, np.sqrt(dot(apart, apart))


@lru_cache(maxsize=4)
def _shifts(kind: PairContact, seen: Seen) -> Sequence[Vector]:
    return kind.second.shifts(_joints(kind, seen), _own(kind, seen))


def _joints(kind: PairContact, seen: Seen) -> Array:
    """(N, n) of the second arm; beside other instruments, rows may be wider."""
    return seen.reading[:, : kind.second.robot.n]


def _own(kind: PairContact, seen: Seen) -> Array:
    """(N, u) parameters of the second arm."""
    return seen.values[:, 6 : 6 + len(kind.second.unknowns)]
