"""The residuals of a calibration in a report: their covariance, and whether they are normally distributed."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from posture_opt.report.text.blocks import Block
from posture_opt.report.text.words import REGIONS, line_words
from posture_opt.statements.notation import count, lengths, percent

if TYPE_CHECKING:
    from posture_opt.validation.assessment import Assessment

_NORMAL_TAIL = 0.0027  # of normal numbers lie beyond three standard deviations
_SIGNIFICANCE_LEVEL = 0.05  # probability of a share that says something


def scatter_block(found: Assessment) -> Block:
    """The second rule: the second moment of the residuals is their vector uncertainty.

    ``C = (1/l) Σ Δx Δxᵀ`` over l rows; the 95 % region has the semi-axes ``k sqrt(eigenvalue)``, where k allows for C
    being estimated from few poses. Residuals whose mean is not zero add systematic errors to C.
    """
    left = found.residual_scatter
    if left is None:
        return Block(
            "Residual scatter",
            ("The residuals are zero." if not found.calibrated.coordinate else "Too few poses for a 95 % region.",),
        )
    ellipse = left.ellipse
    along = ", ".join(line_words(np.pad(a, (0, 3 - len(a)))) for a in ellipse.axes.T[::-1][: ellipse.rank])
    half = lengths([float(s) for s in (left.factor * ellipse.semi_axes)[::-1][: ellipse.rank]])
    if len(found.axes) < 3:
        along = ", ".join(_in_plane(found, a) for a in ellipse.axes.T[::-1][: ellipse.rank])
    names = found.calibration.request.data.kind.axis_names
    if len(names) < 3:  # numbers of a reading that are no coordinates
        along = f"the errors {', '.join(names)}"
    poses = "" if left.dof == left.samples else f" in {count(left.dof, 'pose')}"
    texts = [
        f"C = (1/l) Σ Δx Δxᵀ over l = {left.samples} rows{poses} is the vector uncertainty of the calibrated model.",
        f"Its {REGIONS[ellipse.rank]} has the semi-axes {half} along {along}: {left.factor:.3f} standard deviations "
        f"for this number of samples ({ellipse.factor(0.95):.3f} if the covariance were known exactly). "
        f"{percent(left.inside)} of the rows lie inside.",
    ]
    if not found.calibrated.zero:
        texts.append("As the mean is not zero everywhere, C contains systematic errors besides scatter.")
    return Block("Residual scatter", tuple(texts), "residual_region" if len(found.axes) > 1 else "")


def _in_plane(found: Assessment, axis: np.ndarray) -> str:
    """The axis of a region in the measured plane, in words of the world's axes."""
    wide = np.zeros(3)
    wide[list(found.axes)] = axis
    return line_words(wide)


def shape_block(found: Assessment) -> Block:
    """Whether the residuals are normally distributed.

    Compared is the share of coordinates beyond three standard deviations with 0.27 %. "More frequent" needs a Poisson
    probability below 5 %: ``P(N ≥ n | λ = 0.0027 · coordinates) = gammainc(n, λ)``.
    """
    from scipy.special import gammainc

    share, coordinates = found.calibrated.beyond3, found.rows * len(found.axes)
    beyond = round(share * coordinates)
    chance = float(gammainc(beyond, coordinates * _NORMAL_TAIL)) if beyond else 1.0  # of so many among normal ones
    if chance < _SIGNIFICANCE_LEVEL:
        verdict = "large errors are more frequent than normal"
    elif share > _NORMAL_TAIL:
        verdict = "the difference is not significant"
    else:
        verdict = "large errors are no more frequent than normal"
    text = (
        f"{percent(share)} of the coordinates lie beyond three standard deviations; of a normal distribution "
        f"{percent(_NORMAL_TAIL)} would: {verdict}."
    )
    return Block("Distribution of the residuals", (text,), "residual_shape")
