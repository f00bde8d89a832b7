"""The forms that a change takes: which of its parameters deviate, in units of the motion of the tool."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from posture_opt.changes.new_rows import NewRows
from posture_opt.experiments.possible_changes import PossibleChange
from posture_opt.numerics import Array, Codes

SIZES_M = np.asarray(1e-3 * 2.0 ** np.arange(-4, 7), dtype=float)
"""Sizes of a change: 0.06 to 64 mm of motion of the tool, of a joint the same in mrad."""
_MIN_MOTION_SHARE = 1e-9  # of the largest mean square motion of a change: less is none


@dataclass(frozen=True, eq=False)
class Form:
    """A change by some parameters of it, ``θ = W t``, in units of 1 m of root mean square motion of the tool.

    Args:
        columns: (p,) places of its parameters among those of the rows.
        W: (p, q); rows of zeros for those that do not deviate.
        lever: motion of the tool [m] per m or rad of the size, by which sizes are stated: of a turning joint its root
            mean square lever, else 1.
    """

    change: PossibleChange
    columns: Codes
    W: Array
    lever: float

    @property
    def sizes(self) -> Array:
        """(S,) root mean square motion of the tool by each size [m]."""
        return SIZES_M * self.lever

    @classmethod
    def of(cls, rows: NewRows, change: PossibleChange) -> list[Form]:
        """The forms of a change that move the tool at all."""
        found: list[Form] = []
        motion = rows.motion(change)
        for deviating in change.forms:
            values, vectors = np.linalg.eigh(motion[np.ix_(deviating, deviating)])
            kept = values > _MIN_MOTION_SHARE * np.trace(motion)
            if kept.sum() > (found[0].W.shape[1] if found else 0) or kept.all():
                W = np.zeros((len(motion), int(kept.sum())))
                W[list(deviating)] = vectors[:, kept] / np.sqrt(values[kept])
                angle = len(change.parameters) == 1 and change.parameters[0].unit == "rad"
                lever = math.sqrt(float(motion[0, 0])) if angle else 1.0
                found.append(cls(change, np.array(rows.columns(change)), W, lever))
        return found
