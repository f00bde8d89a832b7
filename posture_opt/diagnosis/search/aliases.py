"""Lines of a joint that its values cannot distinguish: aliases, as on a grid of postures.

On values that are multiples of Δ, a line of k cycles per revolution and one of ``2π/Δ − k`` are the same column.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from posture_opt.diagnosis.scores import levels
from posture_opt.diagnosis.scores.candidates import Candidate
from posture_opt.diagnosis.scores.score_tests import ProjectedBaseline, projected_basis, scan_frequencies
from posture_opt.diagnosis.search.linearised_data import LinearisedData
from posture_opt.model.effects import CyclicError
from posture_opt.model.effects.cyclic_error import OVERSAMPLING

_MIN_ALIAS_GAIN = 0.8  # of what a line explains: between two points of the grid an alias loses less than that
_STEPS_BETWEEN_LINES = 10
_MAX_EXPLAINED = 1 - 1e-9
_MAX_ALIASES = 4  # aliases of one line, the slowest: a lattice has a dozen of them


def find_aliases(linearised: LinearisedData, chosen: Sequence[Candidate], i: int) -> tuple[Candidate, ...]:
    """The cyclic errors whose first line is elsewhere and explains as much, within `levels.RIVAL_CRITERION`.

    The gain of each frequency is compared with that of the line itself, given all other members: ``ν log(RSS / RSS')``
    within the criterion. The slowest few are listed.

    All frequencies are searched, those too that are not offered because the values of the joint do not resolve them.

    Args:
        i: which of ``chosen``; anything but a cyclic error has no aliases.
    """
    error = chosen[i].what
    if not isinstance(error, CyclicError):
        return ()
    sensitivities = linearised.sensitivities
    data = sensitivities.residuals.data
    joint = data.joint_names.index(error.joint)
    width = 2  # columns of the first line, which come first
    rest = Candidate(error, chosen[i].Z[:, width:])
    baseline = linearised.baseline([*(s for k, s in enumerate(chosen) if k != i), rest], flips=0)
    own = projected_basis(baseline, chosen[i].Z[:, :width])[0].T @ baseline.e
    q, lever = data.q[:, joint], sensitivities.joints[joint]
    cycles = CyclicError.grid(float(np.ptp(q)))
    gains = scan_frequencies(baseline, lever, q, cycles)[0]
    peaks = (gains >= np.r_[0.0, gains[:-1]]) & (gains >= np.r_[gains[1:], 0.0])
    step = float(np.diff(cycles[:2]).sum())
    apart = np.min(np.abs(cycles[:, None] - np.array(error.lines)), axis=1) > OVERSAMPLING * step
    found = []
    for k in np.flatnonzero(peaks & apart & (gains > _MIN_ALIAS_GAIN * float(own @ own))):
        near = cycles[k] + step * np.linspace(-0.5, 0.5, 2 * _STEPS_BETWEEN_LINES + 1)
        finer = scan_frequencies(baseline, lever, q, near)[0]
        if _criterion_loss(baseline, float(own @ own), float(finer.max())) <= levels.RIVAL_CRITERION:
            found.append(float(near[int(np.argmax(finer))]))
    shaped = [error.with_shape(other) for other in found[:_MAX_ALIASES]]
    return tuple(Candidate(other, sensitivities.columns(other), chosen[i].searched) for other in shaped)


def _criterion_loss(baseline: ProjectedBaseline, own: float, other: float) -> float:
    """By how much the criterion is worse with another line: ``ν log(RSS_other / RSS_own)``."""
    rest = baseline.rss[0] - np.minimum([other, own], _MAX_EXPLAINED * baseline.rss[0])
    return float(baseline.freedom * np.log(rest[0] / rest[1]))
