"""Lines of a joint that its values cannot tell apart: aliases, as on a grid of postures."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from posture_opt.diagnosis import levels
from posture_opt.diagnosis.candidates import Candidate
from posture_opt.diagnosis.linearised_data import LinearisedData
from posture_opt.diagnosis.score_tests import projected_basis, scan_frequencies
from posture_opt.model.effects import CyclicError
from posture_opt.model.effects.cyclic_error import OVERSAMPLING

_LISTED = 4  # aliases of one line: a lattice has a dozen of them


def aliases(linearised: LinearisedData, chosen: Sequence[Candidate], i: int) -> tuple[Candidate, ...]:
    """The cyclic errors whose first line stands elsewhere and explains as much, within `levels.RIVAL_CRITERION`.

    All frequencies are searched, those too that are not offered because the values of the joint do not resolve them.
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
    cycles = CyclicError.grid(float(np.ptp(data.q[:, joint])))
    gains = scan_frequencies(baseline, sensitivities.joints[joint], data.q[:, joint], cycles)[0]
    rss, m = float(baseline.rss[0]), baseline.freedom
    lost = -m * (np.log1p(-min(float(own @ own) / rss, 1 - 1e-9)) - np.log1p(-np.minimum(gains / rss, 1 - 1e-9)))
    peaks = (gains >= np.r_[0.0, gains[:-1]]) & (gains >= np.r_[gains[1:], 0.0])
    apart = np.min(np.abs(cycles[:, None] - np.array(error.lines)), axis=1) > OVERSAMPLING * np.diff(cycles[:2]).sum()
    found = np.flatnonzero(peaks & apart & (lost <= levels.RIVAL_CRITERION))
    best = found[np.argsort(lost[found])][:_LISTED]
    shaped = [error.with_shape(float(cycles[k])) for k in best]
    return tuple(Candidate(other, sensitivities.columns(other), chosen[i].searched) for other in shaped)
