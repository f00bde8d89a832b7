"""A slip: from some moment on a joint, the base, or the tool is elsewhere."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import ClassVar, Literal

import numpy as np
from pydantic import Field

from posture_opt.errors import BadValueError
from posture_opt.model.arm_state import ArmState
from posture_opt.model.chain import Scalar, at_least
from posture_opt.model.effects.base.cause import Abscissa, FittedSizes, Input, Size, over_time
from posture_opt.model.effects.base.effect import (
    ANGLES,
    WORLD_AXES,
    Effect,
    Excitation,
    Sensitivity,
    foot,
    frame_motion,
)
from posture_opt.numerics import Array, Mask
from posture_opt.robot.robot import Robot
from posture_opt.units import Time, number

_Way = Literal["shift", "slide", "settle"]
SLIP_MOMENTS = 50  # Moments at which a slip is looked for, before those between two of them
_BASE, _TOOL = "base", "tool"
# Way of a slip of a frame -> its parameters: shifted in space, slid and turned on the floor, or shifted and tilted
_FRAME_PARAMETERS: dict[_Way, tuple[str, ...]] = {
    "shift": ("x", "y", "z"),
    "slide": ("x", "y", "yaw"),
    "settle": ("x", "y", "z", "roll", "pitch", "yaw"),
}
# What to look at where no joint slipped
_INSPECTIONS = {
    _BASE: "mounting bolts of the base; whether it, or the stand of the instrument, was knocked",
    _TOOL: "clamping of tool and reflector; whether one of them was knocked",
}
_FRAME_WORDS = {
    _BASE: "the base slipped during the measurements",
    _TOOL: "the tool or its reflector was knocked out of place during the measurements",
}


class Slip(Effect):
    """``dq = h (t ≥ t0)`` of a joint; of the base a shift, a slide on the floor, or both tilted, from ``t0`` on.

    h in rad; of the base a shift [m] and a turn [rad] about the foot of the first joint, world axes; of the tool, or of
    what is measured on it, a shift and a turn about the flange, axes of the tool.
    """

    summary: ClassVar[str] = "a step at some moment: a coupling or the base slipped, or the tool was knocked"
    phrase: ClassVar[str] = "{target} slipped during the measurements"
    measurement: ClassVar[str] = (
        "return again and again to a few postures in which arm and tool point in different directions"
    )
    inspection: ClassVar[str] = (
        "{target}: clamp screws of coupling, encoder and flanges; collisions; a belt that jumped, if it has one"
    )
    urgent: ClassVar[str] = "look for what gave way at {target}: what slipped once can slip again"
    shape: ClassVar[tuple[str, ...]] = ("moment",)
    shape_units: ClassVar[Mapping[str, str]] = {"moment": "s"}
    needs: ClassVar[frozenset[Input]] = frozenset({"time"})
    family: ClassVar[Literal["named", "steps", "periodic"]] = "steps"
    for_planning: ClassVar[bool] = False
    most_in_session: ClassVar[int | None] = 1

    kind: Literal["slip"] = "slip"
    of: str = Field(description="a joint, base, or tool")
    moment: Time = Field(description="t0, since the first measurement")
    way: _Way = Field(
        "shift", description="of base or tool: shifted in space, slid and turned on the floor, or shifted and tilted"
    )

    @property
    def target(self) -> str:
        """The joint, ``base`` or ``tool``."""
        return self.of

    @property
    def _of_frame(self) -> bool:
        """Whether a frame slipped, and no joint."""
        return self.of in _FRAME_WORDS

    @property
    def dimensions(self) -> tuple[tuple[str, str], ...]:
        """``step`` [rad] of a joint; of base and tool the coordinates and angles of its way."""
        if not self._of_frame:
            return (("step", "angle"),)
        return tuple((name, "angle" if name in ANGLES else "length") for name in _FRAME_PARAMETERS[self.way])

    @property
    def name(self) -> str:
        """``slip(TARGET at MOMENT s)``: a joint may slip several times."""
        return f"{self.kind}({self.target} at {self.moment:.6g} s)"

    @property
    def moved_joint(self) -> str:
        """The joint; none where base or tool slipped."""
        return "" if self._of_frame else self.of

    @property
    def words(self) -> str:
        return _FRAME_WORDS.get(self.of, "") or super().words

    def inspect(self, robot: Robot) -> str:
        return _INSPECTIONS.get(self.of, self.inspection).format(target=self.of)

    @property
    def smooth_shape(self) -> str:
        """None: any moment between two rows gives the same column."""
        return ""

    def shape_steps(self, state: ArmState) -> Array:
        """(k,) moments [s] half way between rows, about this one, with enough rows on either side."""
        times = np.unique(np.asarray(state.inputs.time, dtype=float))
        step = float(np.ptp(times)) / SLIP_MOMENTS
        near = (times[:-1] < self.moment + step) & (times[1:] > self.moment - step)
        between = ((times[:-1] + times[1:]) / 2)[near]
        return np.asarray(between[well_covered(between, state.inputs.time)])

    def abscissa(self, state: ArmState, timed: bool = True) -> Abscissa:
        """Time [min], or the row."""
        return over_time(state, timed)

    def sizes(self, estimate: FittedSizes) -> tuple[Size, ...]:
        """The step, and the moment [min] or the row at which it happened; of the tool the length of its shift first."""
        moment, _ = estimate.entry("moment")
        row = Size("at", f"row {math.ceil(moment) + 1}", ", as no times are logged")
        timed = Size("at", f"{number(moment / 60)} min after the first row")
        length = (estimate.shift_length(),) if self.of == _TOOL else ()
        return (*length, *super().sizes(estimate), timed if estimate.timed else row)

    def headline(self, estimate: FittedSizes) -> str:
        return "" if self.of == _BASE else super().headline(estimate)

    def sensitivities(self, state: ArmState) -> tuple[Sensitivity, ...]:
        """A unit step of the joint from ``moment`` on; of the base a shift or a turn about its foot for each parameter,
        of the tool about the flange."""
        after = at_least(state.inputs.time, self.moment)
        if not self._of_frame:
            return (Sensitivity({state.robot.joint_names.index(self.of): after}),)
        axes, about = WORLD_AXES, foot(state)
        if self.of == _TOOL:
            axes, about = state.walk.columns, state.frames[-1].position
        return frame_motion(state, _FRAME_PARAMETERS[self.way], axes, about, after)

    @classmethod
    def candidates(cls, case: Excitation) -> Sequence[Effect]:
        """Every moving revolute joint, the base in each way, and the tool, at each of `SLIP_MOMENTS` that rows cover on
        both sides. Whether the tool turned is asked where data can show it."""
        if not cls.needs <= case.inputs or case.duration <= 0:
            return []
        moments = case.duration * (np.arange(SLIP_MOMENTS) + 0.5) / SLIP_MOMENTS
        moments = moments[well_covered(moments, case.times)]
        joints = [cls(of=name, moment="0 s") for name in case.moving("revolute")]
        bases = [cls(of=_BASE, moment="0 s", way=way) for way in _FRAME_PARAMETERS]
        ways: tuple[_Way, ...] = ("shift", "settle") if case.oriented else ("shift",)
        tools = [cls(of=_TOOL, moment="0 s", way=way) for way in ways]
        return [one.model_copy(update={"moment": t}) for one in (*joints, *bases, *tools) for t in moments.tolist()]

    def check_robot(self, robot: Robot) -> None:
        """Refuse a target that the robot lacks."""
        if self.of not in (*_FRAME_WORDS, *robot.joint_names):
            raise BadValueError(f"the robot has no joint '{self.of}'", "write base, tool or one of its joints")


def well_covered(moments: Array, times: Scalar) -> Mask:
    """Which moments (k,) [s] have enough rows of the ``times`` (N,) [s] on either side; all, where nothing is
    measured."""
    rows = np.sort(np.asarray(times, dtype=float))
    if not len(rows):
        return np.ones(len(moments), dtype=bool)
    before = np.searchsorted(rows, moments, side="left")
    # Rows before a slip and as many behind it: a few rows that are off are outliers, or where the arm was.
    # One part in so many of the rows is enough where they are few.
    return np.asarray(np.minimum(before, len(rows) - before) >= min(10, len(rows) // 4))
