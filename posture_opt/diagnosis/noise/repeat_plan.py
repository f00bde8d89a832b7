"""Which measured postures to repeat, so that scatter of a joint can be distinguished from structure without a name."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from posture_opt.diagnosis.noise.uneven_noise import UnevenErrors
from posture_opt.diagnosis.scores import levels
from posture_opt.measurements.measurements import Measurements
from posture_opt.numerics import Codes, Json


@dataclass(frozen=True, eq=False)
class RepeatPlan:
    """Postures to measure several times each, the arm leaving them in between.

    Args:
        errors: what the repeats would show to be scatter, or would not.
        rows: one measured row of each posture; ``times`` each of them.
    """

    errors: UnevenErrors
    rows: Measurements
    times: int

    @property
    def target(self) -> str:
        """The joint in question."""
        return self.errors.effect.target

    def to_json(self) -> dict[str, Json]:
        """An entry of ``unexplained.repeat`` in ``diagnosis.json``: lines of the file, and postures [rad, m]."""
        names = self.rows.joint_names
        postures = [dict(zip(names, map(float, q), strict=True)) for q in self.rows.q]
        return {"target": self.target, "times": self.times, "lines": self.rows.line.tolist(), "postures": postures}


def plan_repeats(data: Measurements, groups: Codes, uneven: Sequence[UnevenErrors]) -> tuple[RepeatPlan, ...]:
    """For every joint that errors grow with, and that repeats say nothing of, the postures where it would show most.

    Args:
        data: the rows of ``uneven``; ``groups`` (N,) those that repeat one posture already.
        uneven: errors that look like noise of a joint; those that repeats refute already need no more of them.
    """
    plans: list[RepeatPlan] = []
    if data.position is None:  # whoever leads an arm into sockets by hand does not come back to a posture
        return ()
    for errors in uneven:
        # Rows of one posture are there already: whether the arm left it in between decides, and not more of them.
        if errors.refuted or errors.still or not len(errors.size):
            continue
        order = np.argsort(-errors.size, kind="stable")
        first = np.sort(np.unique(groups[order], return_index=True)[1])[: levels.REPEATED_POSTURES]
        plans.append(RepeatPlan(errors, data.take(order[first]), levels.REPEATS))
    return tuple(plans)
