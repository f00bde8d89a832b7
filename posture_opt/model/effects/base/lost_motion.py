"""Lost motion: joints that come to rest elsewhere by the direction from which they arrived."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from posture_opt.model.arm_state import ArmState
from posture_opt.model.chain import Scalar
from posture_opt.model.effects.base.catalogue_entry import Input
from posture_opt.model.effects.base.cause import FittedSizes
from posture_opt.model.effects.base.joint_effect import JointEffect
from posture_opt.robot.robot import Robot

REVERSED = "reversed"
"""The first word of a label where the joint goes beyond its command."""


class LostMotion(JointEffect):
    """``dq = −θ s φ``: s = +1 where the joint value was increasing on arrival, −1 where it was decreasing; φ ≥ 0.

    A positive size θ is lost motion: the joint stops short of its command, as play, elastic wind-up and friction make
    it. A negative one goes beyond the command: what a controller that compensates friction by too much does, and what
    an encoder before the gear reads while the arm is moved by hand, as the link leads then. Data show either, so both
    signs are searched. Where s is not known it is 0.

    Source: ISO 230-2:2014, 3.10 (reversal value): the difference between the means of both directions of approach.
    """

    beyond: ClassVar[str] = (
        "{target} goes beyond its command, as with friction compensation, or an encoder before the gear of an arm that "
        "is moved by hand"
    )
    """What is wrong where the size is negative, in one clause."""
    beyond_inspection: ClassVar[str] = (
        "if motors drove {target}: its friction or backlash compensation in the controller, and nothing is tightened; "
        "if it was moved by hand, and its encoder is before the gear: play or stretch of gear, belt or cable"
    )
    """What to look at where the size is negative."""
    needs: ClassVar[frozenset[Input]] = frozenset({"approach"})

    def lag(self, state: ArmState, joint: int) -> Scalar:
        """−s: the direction in which the joint is off its command where it stops short; 0 where it is not known."""
        return -state.inputs.side(joint)

    def worded(self, estimate: FittedSizes) -> str:
        """The cause in one clause, by the sign of its size.

        Args:
            estimate: values and standard errors of its parameter.
        """
        return self.beyond.format(target=self.target) if self.leads(estimate) else self.words

    def labelled(self, estimate: FittedSizes) -> str:
        """Kind and joint; reversed where it goes beyond its command: what is done about play would be wrong."""
        return f"{REVERSED} {self.label}" if self.leads(estimate) else self.label

    def inspect_fitted(self, robot: Robot, estimate: FittedSizes) -> str:
        """What to look at, by the sign of its size."""
        if self.leads(estimate):
            return self.beyond_inspection.format(target=self.target)
        return self.inspect(robot)

    def leads(self, estimate: FittedSizes) -> bool:
        """Whether the joint goes beyond its command."""
        ((name, _),) = self.parameters
        values: Mapping[str, tuple[float, float, str]] = estimate.values
        return name in values and values[name][0] < 0
