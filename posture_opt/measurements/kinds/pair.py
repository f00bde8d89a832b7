"""Two arms whose tools touch, with the joints of both in a row."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import ClassVar

import numpy as np

from posture_opt.errors import BadValueError, listed
from posture_opt.measurements.kinds.free_frame import FRAME_UNKNOWNS, FreeFrame, described_pose
from posture_opt.measurements.kinds.kind import Kind, Seen, Slots, Vector, dot, stacked
from posture_opt.measurements.kinds.second_arm import PairSpec, SecondArm
from posture_opt.numerics import Array, Codes, Json, Mask

_FRAME = len(FRAME_UNKNOWNS)
_LEAST_M = 1e-9
"""A distance below which no direction is left."""
_NO_SCALE = "two arms that touch give no scale: both grow together"
_REMEDY = "add one known length: hold the arm that is calibrated (held: true), or give a link its measured value"


@dataclass(frozen=True, eq=False)
class PairContact(Kind):
    """``0 = p − T m(q₂)``, or ``0 = |p − T m(q₂)| − d``: the tool points of two arms meet, or are d apart.

    T is the frame of the second arm in the world of the first, unknown; m its tool point in that frame, with its own
    unknown parameters unless it is held. A reading is the joints q₂. Of both bases only the pose of one in the other is
    determined. Source: Stepanova et al. (2022), self-contact of two arms.

    Args:
        frame: T, about the one that suits both nominal arms.
    """

    kind: ClassVar[str] = "pair"
    noun: ClassVar[str] = "touches of two arms"
    sigma_key: ClassVar[str] = "pair"
    settings: ClassVar[str] = "pairs"
    example: ClassVar[str] = "the joints of a second arm (data.pairs) for two arms that touch"
    contact: ClassVar[bool] = True
    error_words: ClassVar[str] = "distance of the tools"
    remedy: ClassVar[str] = _REMEDY

    frame: FreeFrame = field(default_factory=FreeFrame)
    width: int = 6  # type: ignore[misc]
    axis_names: tuple[str, ...] = ("x", "y", "z")  # type: ignore[misc]
    blind_spot: str = ""  # type: ignore[misc]

    @classmethod
    def of(cls, data: object, names: Sequence[str], seconds: Sequence[str] = ()) -> PairContact:
        """The touches with the one second arm of which the section ``data`` says something.

        Raises:
            BadValueError: several second arms.
        """
        stated: Mapping[str, PairSpec] = data.pairs  # type: ignore[attr-defined]
        if len(stated) > 1:
            raise BadValueError(
                f"several second arms: {listed(stated)}", "a file has touches with one of them: keep it"
            )
        spec = next(iter(stated.values()))
        axes = ("along the line of the tools",) if spec.distance else ("x", "y", "z")
        width, blind = _FRAME + len(spec.found.unknowns), "" if spec.held else _NO_SCALE
        return cls(stated=stated, names=names, width=width, axis_names=axes, blind_spot=blind)

    @classmethod
    def columns_in(cls, data: object) -> Mapping[str, str]:
        """``ARM.JOINT`` of the second arm."""
        stated: Mapping[str, PairSpec] = getattr(data, cls.settings)
        read = {name: spec.found.columns for name, spec in stated.items() if spec.is_read}
        return {f"{name}.{joint}": dimension for name, own in read.items() for joint, dimension in own.items()}

    @property
    def read_columns(self) -> Mapping[str, str]:
        """``ARM.JOINT`` of the second arm."""
        return {f"{next(iter(self.stated))}.{joint}": d for joint, d in self.second.columns.items()}

    @property
    def spec(self) -> PairSpec:
        """What the file says of the second arm."""
        found: PairSpec = next(iter(self.stated.values()))
        return found

    @property
    def second(self) -> SecondArm:
        """The second arm."""
        return self.spec.found

    @property
    def second_arms(self) -> Mapping[str, SecondArm]:
        """The one second arm."""
        return {next(iter(self.stated)): self.second}

    @property
    def fixes_size(self) -> bool:
        """Whether the second arm has known lengths."""
        return self.spec.held

    def places(self, names: Sequence[str]) -> Sequence[str]:
        """The second arm."""
        return (next(iter(self.stated)),)

    @property
    def place_noun(self) -> str:
        """What moves along with the first arm."""
        return "the second arm"

    def axes(self, measured: Mask) -> Codes:
        """Three coordinates where the tool points meet, one where they are apart."""
        return np.arange(len(self.axis_names))

    def prepared(self, seen: Seen, moving: Mask, up: Array) -> PairContact:
        """The frame of the second arm in which both nominal arms meet best."""
        points = stacked(seen.position, len(seen.place))
        there = self.second.points(_joints(self, seen), self.second.nominal)
        return replace(self, frame=FreeFrame.fitted(points, there))

    def unknowns(self, place: str) -> tuple[tuple[str, str], ...]:
        """The pose of the second arm, then its own parameters."""
        return (*FRAME_UNKNOWNS, *((name, self.second.unit(name)) for name in self.second.unknowns))

    def parameter(self, place: str, name: str) -> str:
        """``right.base.x``, ``right.elbow.a``."""
        own = f"base.{name}" if (name, "m") in FRAME_UNKNOWNS or (name, "rad") in FRAME_UNKNOWNS else name
        return f"{next(iter(self.stated))}.{own}"

    def group(self, place: str, name: str) -> str:
        """The geometry of the second arm stays where it is measured again; its pose and its tool may not."""
        return "second_arm" if name in self.second.geometry else "place"

    def nominal(self, place: str, name: str) -> float:
        """Of parameters of the second arm, what its file says."""
        return float(self.second.nominal[self.second.unknowns.index(name)]) if name in self.second.unknowns else 0.0

    def prior_sigma(self, place: str, name: str) -> float:
        """What the file of the second arm states."""
        return self.second.sigma(name) if name in self.second.unknowns else 0.0

    def start(self, seen: Seen, places: int) -> Array:
        """The reference frame, and the second arm as its file says."""
        return np.tile(np.r_[np.zeros(_FRAME), self.second.nominal], (places, 1))

    def error(self, seen: Seen) -> Slots:
        """``p − T m``, or its length less d."""
        apart, length = _apart(self, seen)
        return (length - self.spec.distance,) if self.spec.distance else tuple(apart)

    def slope(self, seen: Seen, shift: Vector, turn: Vector) -> Slots:
        """The shift itself, or its part along the line of the tools."""
        return self._along(seen, shift)

    def unknown_slope(self, seen: Seen, axis: int) -> Slots:
        """``−∂(T m)`` by the frame or a parameter of the second arm."""
        if axis < _FRAME:
            moved = self.frame.slope(seen.values, _there(self, seen), axis)
        else:
            own = stacked(_shifts(self, seen)[axis - _FRAME], len(seen.place))
            moved = tuple(self.frame.rotated(seen.values, own).T)
        return self._along(seen, [-m for m in moved])

    def aspect(self, seen: Seen) -> Array:
        """Cosine between the z axes of both tools: how they face each other."""
        walked = self.second.walk(_joints(self, seen), _own(self, seen))
        axis = self.frame.rotated(seen.values, stacked(walked.columns[2], len(seen.place)))
        return np.asarray(dot(seen.columns[2], axis.T))[:, None]

    def expected(self, seen: Seen) -> Array:
        """The joints of the second arm, as they are."""
        return seen.reading

    def described(self, place: str, values: Array) -> dict[str, Json]:
        """Pose of the base of the second arm in the world of the first, and its tool point where that is free [m, rad].

        Its geometry is among the parameters of the calibration.
        """
        found = described_pose(self.frame.pose(values) @ self.second.base)
        own = zip(self.second.unknowns, values[_FRAME:], strict=False)
        return found | {name: float(value) for name, value in own if name not in self.second.geometry}

    def _along(self, seen: Seen, shift: Vector) -> Slots:
        """What a change of ``p − T m`` does to a reading."""
        if not self.spec.distance:
            return tuple(shift)
        apart, length = _apart(self, seen)
        return (dot(apart, shift) / np.maximum(length, _LEAST_M),)


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
    """Shifts of the second tool point by its parameters, in its own frame."""
    return kind.second.shifts(_joints(kind, seen), _own(kind, seen))


def _joints(kind: PairContact, seen: Seen) -> Array:
    """(N, n) of the second arm; beside other instruments, rows may be wider."""
    return seen.reading[:, : kind.second.robot.n]


def _own(kind: PairContact, seen: Seen) -> Array:
    """(N, u) parameters of the second arm."""
    return seen.values[:, _FRAME : _FRAME + len(kind.second.unknowns)]
