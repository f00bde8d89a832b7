"""Coupling: one joint moves a little when another does."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar, Literal

from pydantic import Field

from posture_opt.errors import BadValueError
from posture_opt.model.arm_state import ArmState
from posture_opt.model.chain import Scalar
from posture_opt.model.effects.base.cause import Abscissa, Size, over_joint
from posture_opt.model.effects.base.effect import Effect, Excitation
from posture_opt.model.effects.base.joint_effect import JointEffect
from posture_opt.model.effects.base.plausible_range import PlausibleRange
from posture_opt.numerics import TURN
from posture_opt.robot.robot import Robot
from posture_opt.units import plus_minus


class JointCoupling(JointEffect):
    """``dq_B = c q_A``: joint B (``joint``) follows joint A (``follows``) with the ratio c [rad/rad].

    With ``into: slide`` joint B is prismatic and c is in m/rad: a ball-screw spline, as of a SCARA, lifts as it turns.
    """

    summary: ClassVar[str] = "the joint follows another one by a small ratio (cross-coupling)"
    measurement: ClassVar[str] = "move both joints of the coupling over wide ranges, one at a time"
    inspection: ClassVar[str] = (
        "belts, cables, gears that drive {joint} and pass {follows}, and the coupling ratio in the controller; where "
        "none does, measure both joints one by one"
    )
    rivals: ClassVar[Mapping[str, str]] = {"joint_scale": measurement}
    parameters: ClassVar[tuple[tuple[str, str], ...]] = (("ratio", "ratio"),)

    kind: Literal["joint_coupling"] = "joint_coupling"
    into: Literal["joint", "slide"] = Field("joint", description="whether the joint that follows turns or slides")
    follows: str = Field(description="the joint A that drives it")

    @property
    def target(self) -> str:
        """``A->B``."""
        return f"{self.follows}->{self.joint}"

    @property
    def dimensions(self) -> tuple[tuple[str, str], ...]:
        """The ratio [rad/rad], into a slide [m/rad]."""
        return self.parameters if self.into == "joint" else (("ratio", "length per angle"),)

    @property
    def title(self) -> str:
        """The kind as it is read."""
        return super().title if self.into == "joint" else "coupling into a slide"

    @property
    def words(self) -> str:
        if self.into == "slide":
            return f"{self.joint} slides as {self.follows} turns (coupling into a slide)"
        return f"{self.joint} is coupled to {self.follows}"

    def size(self, name: str, dimension: str, value: float, std: float) -> Size:
        """The ratio; into a slide also per revolution, as the lead of a screw is stated."""
        known = super().size(name, dimension, value, std)
        if self.into == "joint":
            return known
        return Size(known.label, known.text, f" ({plus_minus(value, std, 1e3 * TURN, 'mm')} per revolution)")

    def inspect(self, robot: Robot) -> str:
        if self.into == "slide":
            return (
                f"ball-screw spline of {self.joint}: nuts and belts of screw and spline; in the controller, how the "
                f"slide is corrected for {self.follows}"
            )
        return self.inspection.format(follows=self.follows, joint=self.joint)

    def features(self, state: ArmState, joint: int) -> tuple[Scalar, ...]:
        """(q_A,) [rad], the value of the joint that it follows."""
        return (state.q[state.robot.joint_names.index(self.follows)],)

    def plausible(self, robot: Robot) -> PlausibleRange | None:
        """Any ratio between neighbours and within the wrist, the last three joints, whose shafts run in each other.
        None elsewhere."""
        names = robot.joint_names
        ends = sorted((names.index(self.joint), names.index(self.follows)))
        # Joints of a wrist, whose motors may sit behind all of them.
        if ends[1] - ends[0] == 1 or ends[0] >= robot.n - 3:
            return None
        between = " and ".join(names[ends[0] + 1 : ends[1]])
        needs = f"a shaft, belt or cable from {self.follows} to {self.joint} that passes {between}"
        return PlausibleRange(0.0, 0.0, "ratio", needs, "Craig, Introduction to Robotics, section 3.7")

    def carried(self, robot: Robot, q: Sequence[Scalar]) -> Mapping[int, Scalar]:
        """``c q_A`` [rad] of a ratio above 0.5; nothing below, where loads hardly change."""
        ratio = self.values[0] if self.into == "joint" else 0.0
        names = robot.joint_names
        # Ratio from which a joint is carried along as a whole: no slack or bearing does that, but a gear or a
        # controller does.
        return {names.index(self.joint): ratio * q[names.index(self.follows)]} if abs(ratio) > 0.5 else {}

    def abscissa(self, state: ArmState, timed: bool = True) -> Abscissa:
        """The value of the joint that it follows [deg]."""
        return over_joint(state, state.robot.joint_names.index(self.follows))

    @classmethod
    def candidates(cls, case: Excitation) -> Sequence[Effect]:
        names = case.moving("revolute")
        slides = [cls(joint=b, follows=a, into="slide") for a in names for b in case.moving("prismatic")]
        return [*(cls(joint=b, follows=a) for a in names for b in names if a != b), *slides]

    def check_robot(self, robot: Robot) -> None:
        """Refuse joints that the robot lacks."""
        if self.follows not in robot.joint_names:
            raise BadValueError(
                f"the robot has no joint '{self.follows}'", f"its joints: {', '.join(robot.joint_names)}"
            )
        types = {joint.name: joint.type for joint in robot.joints}
        if types[self.follows] != "revolute":
            raise BadValueError(f"{self.follows} slides: only turning joints are followed")
        slides = types.get(self.joint) == "prismatic"
        if self.joint in types and slides != (self.into == "slide"):
            which = "slides" if slides else "turns"
            raise BadValueError(f"{self.joint} {which}", f"write into: {'slide' if slides else 'joint'}")
        if not slides:
            super().check_robot(robot)
