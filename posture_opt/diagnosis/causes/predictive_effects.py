"""The effects that rows held out from the fit need: what is lost without each when all else is fitted again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from posture_opt.calibration.calibration import Calibration
from posture_opt.calibration.cross_validation import Folds
from posture_opt.calibration.estimation.fit import Fit
from posture_opt.calibration.estimation.linear_model import LinearModel
from posture_opt.calibration.leave_out import LeftOut, leave_out
from posture_opt.diagnosis.causes.determined_sizes import undetermined
from posture_opt.model.effects import Effect
from posture_opt.numerics import Codes, rms

_NONLINEARITY = 3e-3
"""Relative change of the RMS of all rows from which on a refit to first order is no refit: gains are stated to 1 %."""


@dataclass(frozen=True, eq=False)
class PredictiveModel:
    """An arm with effects, each of which rows held out from the fit need.

    Args:
        calibration: of the arm; ``fit`` of it with the effects, to all rows that count.
        kept: the places of these effects among those that were offered.
        folds: the rows that each round leaves out.
    """

    calibration: Calibration
    fit: Fit
    kept: tuple[int, ...]
    folds: Folds

    @classmethod
    def of(
        cls, calibration: Calibration, effects: Sequence[Effect], folds: Folds, *, determined: bool = False
    ) -> PredictiveModel:
        """Backward elimination by the RMS on held-out rows: what they are predicted no worse without goes, worst first.

        Of two effects that replace each other the worse goes, and the other is judged anew. With ``determined``, what
        has no determined size goes before.
        """
        kept = tuple(range(len(effects)))
        while True:
            fit = _fitted(calibration, [effects[i] for i in kept])
            model = cls(calibration, fit, kept, folds)
            gone = (undetermined(fit) if determined else []) or model._unneeded()
            if not gone:
                return model
            kept = tuple(i for k, i in enumerate(kept) if k not in gone)

    @cached_property
    def left_out(self) -> LeftOut:
        """Errors on held-out rows, whole and without each effect, everything else fitted again.

        To first order about the whole model; where that is too far for tangents, about a fit without the effect.
        """
        linear, columns = self._linear, self._columns
        found = leave_out(self.fit.residuals, linear, self.folds, columns)
        for i in range(len(columns)):
            if _is_far(self.fit, linear, i):
                again = _fitted(self.calibration, [effect for k, effect in enumerate(self.fit.effects) if k != i])
                found.without[i] = leave_out(again.residuals, LinearModel.of(again), self.folds, []).whole
        return found

    @cached_property
    def _linear(self) -> LinearModel:
        """The arm to first order about the fit."""
        return LinearModel.of(self.fit)

    @property
    def _columns(self) -> list[Codes]:
        """The columns of each effect in it."""
        return [np.flatnonzero(self._linear.owner == i) for i in range(len(self.fit.effects))]

    def _unneeded(self) -> list[int]:
        """The effects that held-out rows need none of, worst first: each judged without those before it."""
        gone: list[int] = []
        columns = self._columns
        if np.all(self.left_out.gains > 0):
            return gone
        held: Codes = np.zeros(0, dtype=np.intp)
        while len(gone) < len(columns):
            left = [i for i in range(len(columns)) if i not in gone]
            together = [held, *(np.union1d(held, columns[i]) for i in left)]
            now, *losses = (rms(e) for e in leave_out(self.fit.residuals, self._linear, self.folds, together).without)
            worst = int(np.argmin(losses))
            if losses[worst] > now:
                break
            gone.append(left[worst])
            held = together[1 + worst]
        return gone or [int(np.argmin(self.left_out.gains))]


def _fitted(calibration: Calibration, effects: Sequence[Effect]) -> Fit:
    """The arm with effects, fitted to all rows that count."""
    return calibration.fit_effects(calibration.residuals.take(calibration.kept_rows), effects)


def _is_far(fit: Fit, linear: LinearModel, i: int) -> bool:
    """Whether the arm refitted without an effect to first order leaves other residuals than the tangents say."""
    m = fit.residuals.measured
    x = fit.x + linear.refitted(i)
    x[fit.slices[i]] = 0.0
    expected, found = rms(linear.left_without(i)[:m]), rms(fit.residuals.whitened(x)[:m])
    return abs(found - expected) > _NONLINEARITY * expected
