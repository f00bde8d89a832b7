"""The residuals of a calibrated arm to first order, ready for a search, and the directions of its free frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from posture_opt.calibration.assumptions.instrument import position_sigma
from posture_opt.calibration.calibration import Calibration
from posture_opt.calibration.estimation.effect_sensitivities import EffectSensitivities, case_of
from posture_opt.calibration.estimation.least_squares import triangular_factor
from posture_opt.diagnosis.scores.candidates import Candidate, Lines, lines_of_joints
from posture_opt.diagnosis.scores.score_tests import ProjectedBaseline
from posture_opt.model.effects import Excitation
from posture_opt.numerics import Array, Codes


@dataclass(frozen=True, eq=False)
class LinearisedData:
    """The residuals of a calibrated arm with the sensitivities that could explain them: ``r ≈ G x + Z θ + noise``.

    Args:
        sensitivities: what one unit of any effect does to every residual.
        excitation: what the data can show of effects.
        r: (m,) whitened residuals [1].
        G: (m, k) columns of the geometry that the data determine.
        groups: (m,) the pose of every residual, whose signs are flipped together.
        flips: draws of the null distribution, from ``seed``.
        count: the number of residuals; more than m if `reduced`.
        instrument: σ of a measured coordinate as stated, in σ of the residuals; infinite where none is stated.
    """

    sensitivities: EffectSensitivities
    excitation: Excitation
    r: Array
    G: Array
    groups: Codes
    flips: int = 299
    seed: int = 0
    count: int = 0
    instrument: float = np.inf

    @cached_property
    def lines(self) -> tuple[Lines, ...]:
        """The lines of each revolute joint that its values resolve."""
        return lines_of_joints(self.excitation, self.sensitivities.residuals.data)

    def baseline(self, chosen: Sequence[Candidate] = (), flips: int | None = None) -> ProjectedBaseline:
        """The geometry and the chosen candidates projected off the residuals."""
        columns = np.concatenate([self.G, *(s.Z for s in chosen)], axis=1)
        flips = self.flips if flips is None else flips
        return ProjectedBaseline.of(self.r, columns, self.groups, flips, self.seed, self.count)

    def reduced(self, members: Sequence[Candidate]) -> tuple[LinearisedData, list[Candidate]]:
        """The same data and members in coordinates of the space that geometry and members span.

        One more coordinate represents all that lies outside; what members are worth given each other is the same.
        """
        columns = np.concatenate([self.G, *(s.Z for s in members)], axis=1)
        R = triangular_factor(np.concatenate([columns, self.r[:, None]], axis=1))
        r, R = R[:, -1], R[:, :-1]
        edges = np.cumsum([self.G.shape[1], *(s.Z.shape[1] for s in members)])
        parts = [replace(s, Z=R[:, a:b]) for s, a, b in zip(members, edges[:-1], edges[1:], strict=True)]
        groups = np.zeros(len(r), dtype=np.intp)
        count = self.count or len(self.r)
        return replace(self, r=r, G=R[:, : self.G.shape[1]], groups=groups, flips=0, count=count), parts


def linearise_calibration(calibration: Calibration, flips: int = 299, seed: int = 0) -> LinearisedData:
    """The residuals of a calibrated arm, without its outliers, about its estimate.

    Args:
        flips: draws of the null distribution; seed: of their signs.
    """
    kept = calibration.kept_rows
    residuals = calibration.residuals.take(kept)
    r, J = residuals.residuals_and_jacobian(calibration.x)
    sensitivities = EffectSensitivities(residuals, calibration.x)
    poses = np.repeat(np.unique(residuals.data.pose, return_inverse=True)[1], residuals.block)
    apart = len(poses) + np.arange(len(residuals.distances))  # no two known distances err together
    groups = np.unique(np.concatenate([poses, apart]), return_inverse=True)[1]
    G = J @ calibration.identifiability.directions
    stated = position_sigma(calibration.request.problem, residuals.data)
    excitation = case_of(residuals.data, residuals.robot)
    return LinearisedData(
        sensitivities, excitation, r, G, groups, flips, seed,
        instrument=stated / residuals.sigma if stated else np.inf,
    )  # fmt: skip


def tool_points(linearised: LinearisedData) -> Array:
    """(N, 3) tool points of the rows [m], world frame."""
    n = len(linearised.sensitivities.residuals.data)
    return np.stack(
        [np.broadcast_to(np.asarray(v, dtype=float), (n,)) for v in linearised.sensitivities.walk.position], axis=1
    )
