"""Nested cross-validation: the effects are chosen anew in every fold, and judged by the rows that it left out.

Source: Hastie, Tibshirani, Friedman (2009), sections 7.10.2 (the choice belongs inside the folds) and 7.10.1 (the rule
of one standard error).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from posture_opt.calibration.cross_validation import Folds, HeldOut, positions_of, predicted
from posture_opt.calibration.error_statistics import By, folds_of, groups_of
from posture_opt.calibration.fit import Fit
from posture_opt.calibration.linear_model import LinearModel
from posture_opt.diagnosis import levels
from posture_opt.diagnosis.candidates import Candidate
from posture_opt.diagnosis.dictionary import Dictionary
from posture_opt.diagnosis.matching_pursuit import nested_subsets, pursue
from posture_opt.measurements.measurements import Measurements
from posture_opt.numerics import Array, Codes


@dataclass(frozen=True, eq=False)
class NestedSelection:
    """The sets of every size that each fold chose from its own rows.

    Args:
        dictionary: what they were chosen from.
        folds: the rows that each left out; ``groups`` (N,) what hangs together.
        sets: by fold and size, from the empty set on; the last one stands for all larger sizes.
        losses: (sizes, N) squared position errors [m²] of the rows left out.
    """

    dictionary: Dictionary
    folds: Folds
    groups: Codes
    sets: tuple[tuple[tuple[Candidate, ...], ...], ...]
    losses: Array

    @classmethod
    def of(cls, dictionary: Dictionary, most: int, groups: Codes, folds: Folds) -> NestedSelection:
        """Every fold by itself, with sets of at most so many effects."""
        losses, sets = np.zeros((most + 1, len(groups))), []
        for left_out in folds:
            chosen = pursue(dictionary, levels.MOST_EFFECTS, left_out).chosen
            own, losses[:, left_out] = _path(dictionary, chosen, left_out, most)
            sets.append(own)
        return cls(dictionary, folds, groups, tuple(sets), losses)

    @cached_property
    def totals(self) -> Array:
        """(sizes, groups) sums of the squared errors of each group of rows [m²]."""
        codes = np.unique(self.groups, return_inverse=True)[1]
        return np.array([np.bincount(codes, loss) for loss in self.losses])

    @cached_property
    def size(self) -> int:
        """The least size that predicts rows left out as well as the best, within one standard error.

        The first effect has been decided by a test of its own; it is none where rows left out refute it.
        """
        if len(self.totals) == 1 or clearly_less(self.totals[0], self.totals[1]):
            return 0
        best = 1 + int(np.argmin(self.totals[1:].sum(axis=1)))
        return next((size for size in range(1, best) if not clearly_less(self.totals[best], self.totals[size])), best)

    @property
    def loss(self) -> Array:
        """(groups,) of the sets of that size [m²]."""
        return np.asarray(self.totals[self.size])

    @property
    def explained(self) -> float:
        """What the sets of that size explain of the squared errors of rows left out [m²]."""
        return float(np.sum(self.totals[0] - self.loss))

    def held_out(self, calibrated: Fit, size: int, shape: Array | None = None) -> HeldOut:
        """Errors of all rows by the named effects of one size, each set fitted to the rows that it was chosen from.

        Args:
            calibrated: the fit of the geometry alone, about which the models are linear.
            shape: see `cross_validation.held_out`.
        """
        models = []
        for left_out, sets in zip(self.folds, self.sets, strict=True):
            columns = [c.Z for c in sets[min(size, len(sets) - 1)] if c.named]
            Z = np.concatenate([self.dictionary.linearised.G[:, :0], *columns], axis=1)
            norms = np.linalg.norm(Z, axis=0)
            models.append((left_out, LinearModel.beside(calibrated, Z / np.where(norms > 0, norms, 1.0))))
        return predicted(calibrated.residuals, models, shape=shape)


def clearly_less(loss: Array, other: Array) -> bool:
    """Whether losses by group (G,) are less than others of the same groups by more than one standard error."""
    less = other - loss
    return bool(less.sum() > np.sqrt(len(less)) * np.std(less, ddof=1))


def _path(
    dictionary: Dictionary, chosen: Sequence[Candidate], left_out: Codes, most: int
) -> tuple[tuple[tuple[Candidate, ...], ...], Array]:
    """The nested sets of what a fold chose, and the squared errors (sizes, rows) of the rows that it left out."""
    linearised = dictionary.linearised
    residuals = linearised.sensitivities.residuals
    theirs = (left_out[:, None] * residuals.block + np.arange(residuals.block)).ravel()
    learn = np.setdiff1d(np.arange(len(linearised.r)), theirs)
    G, r = linearised.G, linearised.r
    subsets = nested_subsets([c.Z[learn] for c in chosen], G[learn], r[learn])
    A = np.concatenate([G[theirs], *(c.Z[theirs] for c in chosen)], axis=1)
    losses = np.zeros((most + 1, len(left_out)))
    for size, subset in enumerate(subsets[: most + 1]):
        e = positions_of(residuals, r[theirs] - A @ subset.coefficients, left_out)
        losses[size:] = np.sum(e**2, axis=1)
    return tuple(tuple(chosen[i] for i in subset.members) for subset in subsets), losses


def selection_folds(data: Measurements, count: int) -> tuple[Codes, Folds]:
    """Groups (N,) and folds by which effects are chosen: places that were touched, or blocks of the workspace."""
    by: By = "place" if data.position is None else "block"
    groups = groups_of(data, by, count)
    return groups, folds_of(groups, count, by)
