"""Whether a cause of the size that was found can be real: its range by what is published, and what it would take."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from posture_opt.calibration.estimation.fit import Fit
from posture_opt.diagnosis.causes.causes import Finding
from posture_opt.diagnosis.causes.determined_sizes import places_of_parts, turn_about_mean, turns_of
from posture_opt.model.effects import Effect, FittedSizes
from posture_opt.model.effects.base.gravity_load import GravityLoaded
from posture_opt.model.effects.base.multiples import resolution
from posture_opt.robot.robot import Robot

_MANY_IN_SESSION = "{count} of them in one session, where more than {most} is rare: rather something moves all the time"
"""What it would take for a cause that comes once to have come several times."""


_AGAINST_LOAD = "gravity compensation, in the controller or by springs, that does too much: it rises against its load"
"""What it would take for a part that moves against gravity under unknown loads to be compliant."""


@dataclass(frozen=True)
class FittedEffects:
    """What a fit says of its effects, with the arm that they act on.

    Args:
        robot: the arm, with gravity as the data have it.
    """

    model: Fit
    robot: Robot

    def sizes(self, finding: Finding) -> FittedSizes:
        """What the fit says of a finding: estimate, covariance of its parameters, and the turn of its joint."""
        model, place = self.model, finding.place
        if place is None:
            return FittedSizes(finding.estimate)
        part = places_of_parts(model, place, finding.stated_parts)
        own = [k - model.slices[place].start for k in part]
        turned = turns_of(model, place)[:, :, own] @ model.x[part]
        if len(turned) > 1:  # the parts of a tilt vary one by one
            turned = np.linalg.norm(turned, axis=0)
        turn = float(turned.min()), float(turned.max())
        rms = turn_about_mean(model, place, finding.stated_parts)
        return FittedSizes(finding.estimate, model.covariance[np.ix_(part, part)], turn, rms, *self._range(finding))

    def _range(self, finding: Finding) -> tuple[float, float]:
        """Range of the joint that a finding moves in the data [rad], and the resolution of frequencies there.

        0 where it moves none or several.
        """
        data = self.model.residuals.data
        if finding.cause.moved_joint not in data.joint_names:
            return 0.0, 0.0
        q = data.q[:, data.joint_names.index(finding.cause.moved_joint)]
        return float(np.ptp(q)), resolution(q)


def with_plausibility(findings: Sequence[Finding], fitted: FittedEffects) -> list[Finding]:
    """The findings, those that are effects with their range, what they would need beyond it, and the parts that repeat.

    A cause beyond its range has competed with all others and stays: the data look like it.
    """
    seen: Counter[str] = Counter()
    found = []
    for finding in findings:
        effect = finding.effect
        if effect is None:
            found.append(finding)
            continue
        seen[effect.kind] += 1
        robot = fitted.robot
        found.append(
            replace(
                finding,
                plausible_range=effect.plausible(robot),
                would_need=_would_need(effect, finding, fitted, seen[effect.kind]),
                parts=effect.rotating_parts(robot),
                fitted=fitted.sizes(finding),
            )
        )
    return found


def _would_need(effect: Effect, finding: Finding, fitted: FittedEffects, rank: int) -> str:
    """What would have to be true for a finding to be the cause that it looks like; empty where it can be.

    Args:
        rank: which of its kind it is, the largest contribution first.
    """
    most = effect.most_in_session
    if most is not None and rank > most:
        return _MANY_IN_SESSION.format(count=rank, most=most)
    known = effect.plausible(fitted.robot)
    if known is None or not finding.determined:
        return ""
    if isinstance(effect, GravityLoaded) and effect.unstated_loads:
        assert finding.place is not None
        if np.all(fitted.model.x[fitted.model.slices[finding.place]] < 0):
            return _AGAINST_LOAD
    value, std = effect.plausible_size(fitted.sizes(finding))
    return "" if known.holds(value, std) else known.would_need(value)
