"""What may have changed on a calibrated arm: a frame, the zero of a joint, a link, its backlash or its compliance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from posture_opt.calibration.estimation.effect_sensitivities import case_of
from posture_opt.calibration.estimation.parameters import Parameter, effect_parameters
from posture_opt.measurements.measurements import Measurements
from posture_opt.model.effects import Backlash, Effect, JointCompliance
from posture_opt.robot.robot import Factor, Robot

_SHARES = {"tool_frame": 0.30, "base_frame": 0.20, "joint_offset": 0.20, "link": 0.15}
"""Probability of each kind, given that one thing changed: tools are knocked and exchanged more often than links bend.

An assumption and no count. A factor of two in it moves a verdict only where the data say next to nothing.
"""
_EFFECTS: tuple[tuple[type[Effect], float], ...] = ((Backlash, 0.075), (JointCompliance, 0.075))
"""Effects that joints come to have, with the probability of their kind."""
FRAME_PARTS = ("x", "y", "z", "roll", "pitch", "yaw")
_LENGTHS = ("a", "d", "x", "y", "z")


def change_name(kind: str, target: str) -> str:
    """The name of a change: "zero of elbow", "twist elbow.alpha"."""
    part = "length" if target.rpartition(".")[2] in _LENGTHS else "twist"
    names = {
        "tool_frame": "tool",
        "base_frame": "base",
        "joint_offset": f"zero of {target}",
        "link": f"{part} {target}",
    }
    return names.get(kind, f"{kind.replace('_', ' ')} of {target}")


@dataclass(frozen=True)
class PossibleChange:
    """One thing that may have changed, and the parameters that would deviate from the file then.

    Args:
        kind: ``tool_frame``, ``base_frame``, ``joint_offset``, ``link``, ``backlash`` or ``joint_compliance``.
        target: ``tool``, ``base``, the joint, or the parameter of the link, a length or a twist: ``elbow.a``.
        share: probability of the kind, given that one thing changed.
        parameters: (p,) what deviates.
        effect: whose parameters they are; None of geometry.
        alike: further targets that act as this one does in the rows.
    """

    kind: str
    target: str
    share: float
    parameters: tuple[Parameter, ...]
    effect: Effect | None = None
    alike: tuple[str, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """(p,) names of the parameters in the arm."""
        return tuple(p.source for p in self.parameters)

    @property
    def forms(self) -> tuple[tuple[int, ...], ...]:
        """Places of the parameters that deviate, in each form of the change.

        A frame shifts; or it slides on what it stands on, along x and y and turned about z; or it shifts and turns.
        """
        every = tuple(range(len(self.parameters)))
        return ((0, 1, 2), (0, 1, 5), every) if len(every) == len(FRAME_PARTS) else (every,)


def possible_changes(robot: Robot, data: Measurements) -> tuple[PossibleChange, ...]:
    """Everything that may have changed, whether or not these rows can show it, from the tool to effects of joints.

    A frame that is free in the file is no candidate: it is found from every file of data again.
    """
    found = [_geometric(f"{name}_frame", name, _frame(robot, name)) for name in ("tool", "base")]
    free = {"base": robot.base_free, "tool": robot.tool_free}
    found = [change for change in found if not free[change.target]]
    driven = set(robot.driven)
    for joint, index in zip(robot.joint_names, robot.driven, strict=True):
        factor = robot.factors[index]
        if factor.parameter:
            found.append(_geometric("joint_offset", joint, (_parameter(factor, "geometry"),)))
    for index, factor in enumerate(robot.factors):
        owner = factor.parameter.rpartition(".")[0]
        if owner in robot.joint_names and index not in driven:
            found.append(_geometric("link", factor.parameter, (_parameter(factor, "geometry"),)))
    case = case_of(data, robot)
    for kind, share in _EFFECTS:
        found += [
            PossibleChange(e.kind, e.target, share, tuple(effect_parameters(e)), e) for e in kind.candidates(case)
        ]
    return tuple(found)


def _geometric(kind: str, target: str, parameters: tuple[Parameter, ...]) -> PossibleChange:
    """A change of the geometry, with the share of its kind."""
    return PossibleChange(kind, target, _SHARES[kind], parameters)


def _frame(robot: Robot, name: str) -> tuple[Parameter, ...]:
    """The six parameters of a frame, its shift first."""
    known = robot.parameters
    return tuple(_parameter(known[f"{name}.{part}"], name) for part in FRAME_PARTS if f"{name}.{part}" in known)


def _parameter(factor: Factor, group: str) -> Parameter:
    """The deviation of one factor, in all rows."""
    unit = "rad" if factor.kind == "rotate" else "m"
    return Parameter(factor.parameter, group, unit, factor.nominal, factor.parameter)


def effects_of(changes: Sequence[PossibleChange]) -> list[Effect]:
    """The effects among the changes."""
    return [change.effect for change in changes if change.effect is not None]
