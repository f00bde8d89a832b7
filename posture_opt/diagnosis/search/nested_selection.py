"""Nested cross-validation: the effects are chosen anew in every fold, and judged by the rows that it left out.

Source: Hastie, Tibshirani, Friedman (2009), sections 7.10.2 (the choice belongs inside the folds) and 7.10.1 (the rule
of one standard error).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import islice

import numpy as np

from posture_opt.calibration.cross_validation import (
    Folds,
    HeldOut,
    LinearModel,
    judged_rows,
    linear_held_out_errors,
    positions_of,
    residual_indices,
)
from posture_opt.calibration.estimation.error_statistics import By, folds_of, groups_of
from posture_opt.calibration.estimation.fit import Fit
from posture_opt.diagnosis.scores.candidates import Candidate, LinearisedData
from posture_opt.diagnosis.scores.subset_selection import nested_subsets
from posture_opt.diagnosis.search.atoms import Dictionary
from posture_opt.diagnosis.search.matching_pursuit import Pursued, pursue_in_folds
from posture_opt.measurements.measurements import Measurements
from posture_opt.model.effects import Effect
from posture_opt.model.effects.slip import Slip
from posture_opt.numerics import Array, Codes


@dataclass(frozen=True, eq=False)
class NestedSelection:
    """The sets of every size that each fold chose from its own rows.

    Args:
        folds: the rows that each left out; ``groups`` (N,) codes of correlated rows.
        losses: (sizes, N) squared position errors [m²] of the rows left out.
    """

    linearised: LinearisedData
    folds: Folds
    groups: Codes
    sets: tuple[tuple[tuple[Effect, ...], ...], ...]
    losses: Array

    @classmethod
    def of_pursued(cls, dictionary: Dictionary, most: int, way: Folding, pursued: Iterator[Pursued]) -> NestedSelection:
        """From what each fold has pursued, the next ones of ``pursued``."""
        losses, sets = np.zeros((most + 1, len(way.groups))), []
        for left_out, found in zip(way.folds, islice(pursued, len(way.folds)), strict=True):
            own, losses[:, left_out] = _fold_path(dictionary, found.chosen, left_out, most)
            sets.append(own)
        return cls(dictionary.linearised, way.folds, way.groups, tuple(sets), losses)

    @cached_property
    def totals(self) -> Array:
        """(sizes, groups) sums of the squared errors of each group of rows [m²]."""
        codes = np.unique(self.groups, return_inverse=True)[1]
        return np.array([np.bincount(codes, loss) for loss in self.losses])

    @property
    def refuted(self) -> bool:
        """Whether rows left out are clearly worse predicted with the first effect than without any."""
        return len(self.totals) == 1 or clearly_less(self.totals[0], self.totals[1])

    def gains_nothing(self, size: int) -> bool:
        """Whether rows left out are predicted no better with so many effects than without any."""
        return float(self.totals[min(size, len(self.totals) - 1)].sum()) >= float(self.totals[0].sum())

    @cached_property
    def best(self) -> int:
        """The size, of one effect or more, that predicts rows left out best."""
        return 1 + int(np.argmin(self.totals[1:].sum(axis=1)))

    @cached_property
    def least(self) -> int:
        """The least size that predicts them as well, within one standard error of the difference."""
        best = self.totals[self.best]
        return next((size for size in range(1, self.best) if not clearly_less(best, self.totals[size])), self.best)

    def without(self, gone: Callable[[Effect], bool]) -> NestedSelection:
        """Choices without some effects: each fold fits the rest for them to be absent."""
        sets = tuple(tuple(tuple(e for e in own if not gone(e)) for own in fold) for fold in self.sets)
        return replace(self, sets=sets)

    def with_moments_of(self, effects: Sequence[Effect]) -> NestedSelection:
        """Choices with each slip at the moment of one of ``effects`` where the fold cannot tell them apart."""
        steps = [e for e in effects if isinstance(e, Slip)]
        if not steps:
            return self
        columns, block = self.linearised.sensitivities.columns, self.linearised.sensitivities.residuals.block

        def moved(own: Effect, learned: Codes) -> Effect:
            for other in steps if isinstance(own, Slip) else ():
                there = own.model_copy(update={"moment": other.moment})
                if np.array_equal(columns(own)[learned], columns(there)[learned]):
                    return there
            return own

        sets = []
        for left_out, fold in zip(self.folds, self.sets, strict=True):
            learned = residual_indices(np.setdiff1d(np.arange(len(self.groups)), left_out), block)
            sets.append(tuple(tuple(moved(e, learned) for e in own) for own in fold))
        return replace(self, sets=tuple(sets))

    def held_out(self, calibrated: Fit, size: int, shape: Array | None = None) -> HeldOut:
        """Errors of all rows by the named effects of one size, each set fitted to the rows that it was chosen from."""
        models = ((left_out, linear) for left_out, linear, *_ in self.fitted_sets(calibrated, size))
        return linear_held_out_errors(calibrated.residuals, models, shape=shape)

    def fitted_sets(
        self, calibrated: Fit, size: int, also: Sequence[Effect] = ()
    ) -> Iterator[tuple[Codes, LinearModel, tuple[Effect, ...], list[Array]]]:
        """Of each fold the rows left out, its own model, and the effects in it with their columns (m, k)."""
        for left_out, sets in zip(self.folds, self.sets, strict=True):
            own = sets[min(size, len(sets) - 1)]
            named = {(e.kind, e.target) for e in own}
            effects = (*own, *(e for e in also if (e.kind, e.target) not in named))
            columns = [self.linearised.sensitivities.columns(e) for e in effects]
            Z = np.concatenate([self.linearised.G[:, :0], *columns], axis=1)
            norms = np.linalg.norm(Z, axis=0)
            linear = LinearModel.with_columns(calibrated, Z / np.where(norms > 0, norms, 1.0))
            yield left_out, linear, effects, columns


def clearly_less(loss: Array, other: Array) -> bool:
    """Whether losses by group (G,) are less than others of the same groups by more than one standard error.

    The standard error is that of a sum of independent differences, ``√G · std``.
    """
    less = other - loss
    return bool(less.sum() > np.sqrt(len(less)) * np.std(less, ddof=1))


def _fold_path(
    dictionary: Dictionary, chosen: Sequence[Candidate], left_out: Codes, most: int
) -> tuple[tuple[tuple[Effect, ...], ...], Array]:
    """The nested sets of what a fold chose, and the squared errors (sizes, rows) of the rows that it left out."""
    linearised = dictionary.linearised
    residuals = linearised.sensitivities.residuals
    G, r = linearised.G, linearised.r
    learn = np.ones(len(r), dtype=bool)
    learn[residual_indices(left_out, residuals.block)] = False
    subsets = nested_subsets([c.Z for c in chosen], G, r, learn)
    judged = residual_indices(judged_rows(residuals, left_out), residuals.block)
    A = np.concatenate([G[judged], *(c.Z[judged] for c in chosen)], axis=1)
    losses = np.zeros((most + 1, len(left_out)))
    for size, subset in enumerate(subsets[: most + 1]):
        e = positions_of(residuals, r[judged] - A @ subset.coefficients, left_out)
        losses[size:] = np.sum(e**2, axis=1)
    named = [[c.what for i in subset.members if isinstance((c := chosen[i]).what, Effect)] for subset in subsets]
    return tuple(map(tuple, named)), losses


@dataclass(frozen=True, eq=False)
class Folding:
    """A way to leave rows out; groups: (N,) codes of rows that are correlated and left out together."""

    groups: Codes
    folds: Folds

    @classmethod
    def of(cls, data: Measurements, by: By, count: int) -> Folding:
        groups = groups_of(data, by, count)
        return cls(groups, folds_of(groups, count, by))

    @classmethod
    def usual(cls, data: Measurements, count: int = 5) -> tuple[Folding, ...]:
        """By place that was touched; else by pose, which shows the noise, and by block, which shows the rest."""
        ways: tuple[By, ...] = ("place",) if data.touches else ("pose",) if data.position is None else ("pose", "block")
        return tuple(cls.of(data, by, count) for by in ways)


@dataclass(frozen=True, eq=False)
class NestedSelections:
    """Nested selections of one dictionary in several ways, which have to agree on how many effects there are."""

    each: tuple[NestedSelection, ...]

    @classmethod
    def of(cls, dictionary: Dictionary, most: int, foldings: Sequence[Folding]) -> NestedSelections:
        """One for each way to leave rows out; the folds of all of them are pursued side by side."""
        folds = [left_out for way in foldings for left_out in way.folds]
        pursued = pursue_in_folds(dictionary, most + 10, folds)
        return cls(tuple(NestedSelection.of_pursued(dictionary, most, way, pursued) for way in foldings))

    @property
    def size(self) -> int:
        """As many effects as the first way asks for, within one standard error, and no more than improve any other."""
        if any(nested.refuted for nested in self.each):
            return 0
        return min(self.each[0].least, *(nested.best for nested in self.each))

    @property
    def explained(self) -> float:
        """Share of the squared errors of rows left out that the sets of that size explain, mean of all ways."""
        size = self.size
        return float(np.mean([1 - n.totals[size].sum() / max(n.totals[0].sum(), 1e-300) for n in self.each]))

    def clearly_better(self, other: NestedSelections) -> bool:
        """Whether rows left out are predicted better than by another, by more than a standard error in every way."""
        pairs = zip(self.each, other.each, strict=True)
        return all(clearly_less(a.totals[self.size], b.totals[other.size]) for a, b in pairs)
