"""The inputs that the effects of an arm depend on, as far as a task states them or leaves them open."""

from __future__ import annotations

from posture_opt.model.arm import Arm
from posture_opt.model.arm_state import REFERENCE_TEMPERATURE


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
