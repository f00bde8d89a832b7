"""What no data of the kind at hand can tell, and what these data lack to tell more."""

from __future__ import annotations

import numpy as np

from posture_opt.calibration.effect_sensitivities import case_of
from posture_opt.calibration.residuals import Residuals
from posture_opt.model.effects import CATALOGUE, EFFECTS, INPUTS, Evidence, Limit


def unknowable(residuals: Residuals) -> tuple[Limit, ...]:
    """Causes that leave no trace in data of this kind, whatever their size."""
    lengths = [p.name for p in residuals.parameters if p.group == "geometry" and p.unit == "m" and abs(p.nominal) > 0]
    evidence = Evidence(residuals.data.position is not None, tuple(lengths))
    return tuple(limit for kind in CATALOGUE if (limit := kind.unknowable(evidence)) is not None)


def not_looked_for(residuals: Residuals) -> dict[str, tuple[str, str, tuple[str, ...]]]:
    """Input that is lacking -> what that is, how to mend it, and the kinds of effects that need it.

    A compliant joint is looked for without the masses of the links too: they are unknowns then.
    """
    excitation = case_of(residuals.data, residuals.robot)
    have = set(excitation.inputs)
    if any(np.isfinite(j.gear_ratio) for j in residuals.robot.joints):
        have.add("gear_ratio")
    missing: dict[str, list[str]] = {}
    for kind in EFFECTS:
        for lacking in sorted(kind.needs - have):
            missing.setdefault(lacking, []).append(kind.kind_name())
    return {key: (needed.words, needed.mend, tuple(missing[key])) for key, needed in INPUTS.items() if key in missing}
