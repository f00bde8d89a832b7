"""Noise that is larger at some postures than at others: what all rows raise, and what repeats make of it.

Errors that grow with a joint are its scatter, or a shape that the model lacks: residuals alone cannot say. Only
repeats of a posture can, where the model errs alike and all that differs is scatter.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from posture_opt.diagnosis.noise.noise_candidates import (
    NoiseCandidate,
    RepeatedNoise,
    score_repeats,
    score_uneven_noise,
)
from posture_opt.diagnosis.scores import levels
from posture_opt.measurements.repeats import Contrasts
from posture_opt.model.effects import Cause, NoiseEffect, Rows
from posture_opt.numerics import Array
from posture_opt.validation.scatter_model import whitened_repeats


@dataclass(frozen=True)
class NoiseCause:
    """A kind of noise that is named, with its size.

    Args:
        effect: as in a problem file.
        estimate: name -> (value, standard error, SI unit).
        p_value: family-wise, of errors of all rows so uneven.
        confounded_with: kinds of noise that explain the rows nearly as well.
    """

    effect: NoiseEffect
    estimate: Mapping[str, tuple[float, float, str]]
    p_value: float
    confounded_with: tuple[Cause, ...] = ()


@dataclass(frozen=True, eq=False)
class UnevenErrors:
    """Errors that grow as one kind of noise would have it, and that repeats do not show to be scatter.

    Args:
        effect: the noise that they look like.
        p_value: family-wise, of errors of all rows so uneven.
        refuted: whether repeats scatter by another size; else there are too few of them to decide.
        size: (N,) its standard deviation in each row, in units of the other scatter: where to repeat.
    """

    effect: NoiseEffect
    p_value: float
    refuted: bool
    size: Array


@dataclass(frozen=True, eq=False)
class NoiseSample:
    """Residuals ``e`` (N, d) in units of their stated covariance, and the rows they are of."""

    e: Array
    rows: Rows

    def without(self, spread: Array | None) -> NoiseSample:
        """In units of a covariance that a noisy joint, ``spread`` (N, d), is part of; as it is without one."""
        if spread is None:
            return self
        visits = np.arange(len(self.e)) if self.rows.visits is None else self.rows.visits
        e, levers = whitened_repeats(self.e, self.rows.levers, spread[:, :, None], visits, np.ones(self.e.shape))
        return NoiseSample(e, replace(self.rows, levers=levers))

    @classmethod
    def together(cls, samples: Sequence[NoiseSample]) -> NoiseSample:
        """The samples of several robots of one type, whose repeats are all different."""
        every = [sample.rows for sample in samples]
        levers = np.concatenate([rows.levers for rows in every], axis=1)
        ranges = [rows.ranges for rows in every if rows.ranges is not None]
        known = np.concatenate(ranges) if len(ranges) == len(every) else None
        visits, first = [], 0
        for sample in samples:
            own = np.arange(len(sample.e)) if sample.rows.visits is None else sample.rows.visits
            visits.append(first + own)
            first += int(own.max(initial=-1)) + 1
        rows = replace(every[0], levers=levers, ranges=known, visits=np.concatenate(visits))
        return cls(np.concatenate([sample.e for sample in samples]), rows)

    def between(self, contrasts: Contrasts) -> NoiseSample:
        """The differences between repeats alone."""
        scale = 1 / np.sqrt(contrasts.reading)
        levers = np.moveaxis(contrasts.means(np.moveaxis(self.rows.levers, 0, 2)) * scale[:, None, None], 2, 0)
        ranges = None if self.rows.ranges is None else contrasts.means(self.rows.ranges)
        rows = replace(self.rows, levers=levers, ranges=ranges, visits=contrasts.shared)
        return NoiseSample(contrasts.differences(self.e) * scale[:, None], rows)


@dataclass(frozen=True, eq=False)
class _Examined:
    """A candidate of all rows with what repeats say of it; ``None`` where they are too few."""

    candidate: NoiseCandidate
    repeated: RepeatedNoise | None

    @property
    def refuted(self) -> bool:
        """Whether repeats scatter by another size."""
        return self.repeated is not None and self.repeated.refuted

    @property
    def allowed(self) -> bool:
        """Noise of the arm has to be confirmed by repeats; that of the instrument is kept until they refute it."""
        if self.candidate.of_arm:
            return self.repeated is not None and self.repeated.confirmed
        return not self.refuted

    @property
    def sized(self) -> NoiseCandidate:
        """With the size that is to be believed: of the arm's noise that of the repeats."""
        return self.repeated.candidate if self.candidate.of_arm and self.repeated is not None else self.candidate


def find_uneven_noise(
    everything: NoiseSample, repeats: NoiseSample, seed: int, level: float = levels.NOISE_LEVEL
) -> tuple[list[NoiseCause], list[UnevenErrors]]:
    """The joints, or the range, along which noise is larger than elsewhere; and errors that only look like that.

    A joint is named where repeats scatter so, by the size that they have; noise that grows with the range is the
    instrument's and named unless repeats refute it. Where they refute the best candidate, a rival may replace it.
    Each is whitened, as if it were stated, before the next test at a stricter level.

    Args:
        everything: all rows; ``repeats`` their contrasts.
    """
    named: list[tuple[_Examined, list[NoiseCandidate]]] = []
    uneven: list[UnevenErrors] = []
    taken: set[tuple[str, str]] = set()
    candidates = score_uneven_noise(everything.e, everything.rows, seed)
    while candidates and candidates[0].p_value < (levels.FURTHER_NOISE_LEVEL if taken else level):
        first, rivals = candidates[0], _close_rivals(candidates)
        examined = [_Examined(s, score_repeats(repeats.e, repeats.rows, s, seed)) for s in (first, *rivals)]
        competing = examined if examined[0].refuted else examined[:1]
        chosen = next((one for one in competing if one.allowed), None)
        if chosen is None:
            uneven.append(UnevenErrors(first.named(), first.p_value, examined[0].refuted, _spread_lengths(first)))
        else:
            first = chosen.candidate
            named.append((chosen, [s.candidate for s in examined if s is not chosen]))
            repeats = repeats.without(chosen.sized.spread)
        taken.add(first.who)
        if first.spread is None or len(taken) == len(everything.rows.levers):
            break
        everything = everything.without(first.spread)
        scores = score_uneven_noise(everything.e, everything.rows, seed)
        candidates = [s for s in scores if s.who not in taken]
    return [_noise_cause(one, rivals, taken) for one, rivals in named], uneven


def _close_rivals(candidates: Sequence[NoiseCandidate]) -> list[NoiseCandidate]:
    """Those that explain the rows nearly as well as the first."""
    least = max(candidates[0].ratio - levels.RIVAL_CRITERION, 0.0)
    return [s for s in candidates[1:] if s.ratio > least]


def _noise_cause(one: _Examined, rivals: Sequence[NoiseCandidate], taken: Collection[tuple[str, str]]) -> NoiseCause:
    """An examined candidate as a cause, with those rivals that are not named themselves."""
    others = tuple(rival.named() for rival in rivals if rival.who not in taken)
    return NoiseCause(one.sized.named(), one.sized.estimate, one.candidate.p_value, others)


def _spread_lengths(candidate: NoiseCandidate) -> Array:
    """How far (N,) noise along one direction spreads each row; empty where it has no direction."""
    return np.zeros(0) if candidate.spread is None else np.asarray(np.linalg.norm(candidate.spread, axis=1))
