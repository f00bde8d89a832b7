"""A tool point that is elsewhere on rows with a payload: another nest, gripper or reflector."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar, Literal

from posture_opt.model.arm_state import ArmState
from posture_opt.model.chain import ZERO, at_least, scale
from posture_opt.model.effects.base.cause import FittedSizes, Input, Size
from posture_opt.model.effects.base.effect import Sensitivity, SoleEffect


class ToolShift(SoleEffect):
    """``dp = R_tool v`` on rows with a payload, v (3,) [m] in the axes of the tool: alike under every payload."""

    summary: ClassVar[str] = "the tool point is elsewhere on rows with a payload, as on another nest"
    phrase: ClassVar[str] = "the tool point is elsewhere on rows with a payload"
    measurement: ClassVar[str] = "measure under two payloads on the same nest, or name the nests in a column 'target'"
    inspection: ClassVar[str] = "how the reflector was mounted with the payload and without"
    rivals: ClassVar[Mapping[str, str]] = dict.fromkeys(
        ("slip", "payload_error", "joint_compliance"),
        "return to the unloaded tool: a knocked one stays where it is, and a deflection depends on the posture",
    )
    sole: ClassVar[str] = "tool"
    parameters: ClassVar[tuple[tuple[str, str], ...]] = (("x", "length"), ("y", "length"), ("z", "length"))
    needs: ClassVar[frozenset[Input]] = frozenset({"payload"})

    kind: Literal["tool_shift"] = "tool_shift"

    def sizes(self, estimate: FittedSizes) -> tuple[Size, ...]:
        """The length of the shift, then its parts."""
        return (estimate.shift_length(), *super().sizes(estimate))

    def sensitivities(self, state: ArmState) -> tuple[Sensitivity, ...]:
        """A shift along each axis of the tool, on rows with a payload."""
        loaded = at_least(state.inputs.payload, 1e-6)  # kg: from here on a row carries a payload
        return tuple(Sensitivity(twist=(scale(loaded, axis), ZERO)) for axis in state.walk.columns)
