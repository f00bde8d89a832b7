"""What no data of the kind at hand can tell, and what these data lack to tell more."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from posture_opt.diagnosis.residuals import Residuals
from posture_opt.diagnosis.tangents import case_of
from posture_opt.model.effects import EFFECTS

_FEW_ROBOTS = 10


@dataclass(frozen=True)
class Limit:
    """A cause that cannot be known from these data, why, and what would tell."""

    kind: str
    target: str
    reason: str
    mend: str

    def to_json(self) -> dict[str, str]:
        """The entry of ``unknowable`` in ``diagnosis.json``."""
        return {"kind": self.kind, "target": self.target, "reason": self.reason, "mend": self.mend}


def unknowable(residuals: Residuals) -> tuple[Limit, ...]:
    """Causes that leave no trace in data of this kind, whatever their size."""
    limits = []
    if residuals.data.position is not None:
        limits.append(
            Limit(
                "instrument_scale",
                "instrument",
                "an instrument that reads all distances too long by the same share looks exactly like an arm whose "
                "lengths are all too long by that share",
                "measure a scale bar of known length with the same instrument",
            )
        )
    lengths = [p.name for p in residuals.parameters if p.group == "geometry" and p.unit == "m" and abs(p.nominal) > 0]
    if len(lengths) > 1:
        limits.append(
            Limit(
                "correlated_lengths",
                f"{lengths[0]}, {lengths[1]}",
                "whether lengths err together shows only from robot to robot: one robot has one error of each",
                f"measure {_FEW_ROBOTS} robots of the type or more, with a column 'robot'",
            )
        )
    return tuple(limits)


_LACKS = {
    "approach": ("both sides", "arrive at each joint value from both sides; columns 'JOINT.approach' state them"),
    "payload": ("payload", "measure with two payloads or more, in a column 'payload [kg]'"),
    "temperature": ("temperature", "log it as it changes, in a column 'temperature [degC]'"),
    "time": ("time", "log them in a column 'time [s]'"),
    "masses": ("masses", "state 'mass' and 'com' of every joint in the problem file"),
    "gear_ratio": ("gear ratio", "state 'gear_ratio' of every joint in the problem file"),
}


def not_looked_for(residuals: Residuals) -> dict[str, tuple[str, str, tuple[str, ...]]]:
    """Input that is lacking -> what that is, how to mend it, and the kinds of effects that need it.

    A joint that gives way is looked for without the masses of the links too: they are unknowns then.
    """
    case = case_of(residuals.data, residuals.robot)
    have = set(case.inputs)
    if any(np.isfinite(j.gear_ratio) for j in residuals.robot.joints):
        have.add("gear_ratio")
    missing: dict[str, list[str]] = {}
    for kind in EFFECTS:
        name = str(kind.model_fields["kind"].default)
        for lacking in sorted((kind.needs | ({"gear_ratio"} if name == "gear_ripple" else frozenset())) - have):
            missing.setdefault(lacking, []).append(name)
    return {key: (*_LACKS[key], tuple(missing[key])) for key in _LACKS if key in missing}
