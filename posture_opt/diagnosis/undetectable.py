"""What no data of the kind at hand can tell, and what these data lack to tell more."""

from __future__ import annotations

import numpy as np

from posture_opt.calibration.effect_sensitivities import case_of
from posture_opt.calibration.residuals import Residuals
from posture_opt.model.effects import CATALOGUE, EFFECTS, Evidence, Limit


def unknowable(residuals: Residuals) -> tuple[Limit, ...]:
    """Causes that leave no trace in data of this kind, whatever their size."""
    lengths = [p.name for p in residuals.parameters if p.group == "geometry" and p.unit == "m" and abs(p.nominal) > 0]
    evidence = Evidence(residuals.data.position is not None, tuple(lengths))
    return tuple(limit for kind in CATALOGUE if (limit := kind.unknowable(evidence)) is not None)


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
    excitation = case_of(residuals.data, residuals.robot)
    have = set(excitation.inputs)
    if any(np.isfinite(j.gear_ratio) for j in residuals.robot.joints):
        have.add("gear_ratio")
    missing: dict[str, list[str]] = {}
    for kind in EFFECTS:
        for lacking in sorted(kind.needs - have):
            missing.setdefault(lacking, []).append(str(kind.model_fields["kind"].default))
    return {key: (*_LACKS[key], tuple(missing[key])) for key in _LACKS if key in missing}
