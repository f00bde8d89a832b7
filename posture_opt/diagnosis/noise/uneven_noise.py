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
from posture_opt.numerics import Array, Codes
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
        size: (N,) its standard deviation in each row, in units of the other scatter: where to repeat; empty where no
            posture shows it more than others.
        still: whether rows of one posture that follow each other do not scatter so: they decide it if the arm left the
            posture in between, which the file does not say.
        scatters: whether repeats scatter along this joint too, by less.
    """

    effect: NoiseEffect
    p_value: float
    refuted: bool
    size: Array
    still: bool = False
    scatters: bool = False


@dataclass(frozen=True, eq=False)
class NoiseSample:
    """Residuals ``e`` (N, d) in units of their stated covariance, and the rows they are of.

    Args:
        posture: (N,) code of the posture that each is of; None where each is of one of its own.
    """

    e: Array
    rows: Rows
    posture: Codes | None = None

    def take(self, kept: Codes) -> NoiseSample:
        """Some of the rows."""
        rows = self.rows
        few = replace(
            rows,
            levers=rows.levers[:, kept],
            ranges=None if rows.ranges is None else rows.ranges[kept],
            visits=None if rows.visits is None else np.unique(rows.visits[kept], return_inverse=True)[1],
        )
        return NoiseSample(self.e[kept], few, None if self.posture is None else self.posture[kept])

    @property
    def without_farthest(self) -> NoiseSample:
        """The sample without the posture whose repeats are farthest off."""
        squares = np.einsum("nd,nd->n", self.e, self.e)
        posture = np.arange(len(self.e)) if self.posture is None else self.posture
        return self.take(np.flatnonzero(posture != np.argmax(np.bincount(posture, squares))))

    @property
    def none(self) -> NoiseSample:
        """No rows at all."""
        return self.take(np.zeros(0, dtype=np.intp))

    def scaled(self, scale: Array) -> NoiseSample:
        """With each coordinate of a row over its ``scale`` (d,)."""
        return replace(self, e=self.e / scale, rows=replace(self.rows, levers=self.rows.levers / scale))

    def without(self, spread: Array | None) -> NoiseSample:
        """In units of a covariance that a noisy joint, ``spread`` (N, d), is part of; as it is without one."""
        if spread is None or not len(self.e):
            return self
        visits = np.arange(len(self.e)) if self.rows.visits is None else self.rows.visits
        e, levers = whitened_repeats(self.e, self.rows.levers, spread[:, :, None], visits, np.ones(self.e.shape))
        return replace(self, e=e, rows=replace(self.rows, levers=levers))

    @classmethod
    def together(cls, samples: Sequence[NoiseSample]) -> NoiseSample:
        """The samples of several robots of one type, whose repeats are all different."""
        every = [sample.rows for sample in samples]
        levers = np.concatenate([rows.levers for rows in every], axis=1)
        ranges = [rows.ranges for rows in every if rows.ranges is not None]
        known = np.concatenate(ranges) if len(ranges) == len(every) else None
        sizes = [len(sample.e) for sample in samples]
        rows = replace(every[0], levers=levers, ranges=known, visits=_apart([r.visits for r in every], sizes))
        posture = _apart([sample.posture for sample in samples], sizes)
        return cls(np.concatenate([sample.e for sample in samples]), rows, posture)

    def between(self, contrasts: Contrasts) -> NoiseSample:
        """The differences between repeats alone."""
        scale = 1 / np.sqrt(contrasts.reading)
        levers = np.moveaxis(contrasts.means(np.moveaxis(self.rows.levers, 0, 2)) * scale[:, None, None], 2, 0)
        ranges = None if self.rows.ranges is None else contrasts.means(self.rows.ranges)
        rows = replace(self.rows, levers=levers, ranges=ranges, visits=contrasts.shared)
        return NoiseSample(contrasts.differences(self.e) * scale[:, None], rows, contrasts.group[contrasts.order > 0])


def _apart(codes: Sequence[Codes | None], sizes: Sequence[int]) -> Codes:
    """(N,) codes of several samples of these sizes, none of which is in two of them; None: one for each row."""
    found, first = list[Codes](), 0
    for own, size in zip(codes, sizes, strict=True):
        part = np.arange(size) if own is None else own
        found.append(first + part)
        first += int(part.max(initial=-1)) + 1
    return np.concatenate(found)


@dataclass(frozen=True, eq=False)
class _Examined:
    """A candidate of all rows with what repeats, and rows that follow each other, say of it; ``None``: too few."""

    candidate: NoiseCandidate
    repeated: RepeatedNoise | None
    read: RepeatedNoise | None

    @property
    def refuted(self) -> bool:
        """Whether repeats scatter by another size.

        Noise of the instrument is in every reading. That of a joint is not where the arm did not leave its posture.
        """
        decisive = (self.repeated,) if self.candidate.of_arm else (self.repeated, self.read)
        return any(one is not None and one.refuted for one in decisive)

    @property
    def confirmed(self) -> RepeatedNoise | None:
        """What confirms it."""
        both = (self.repeated, self.read) if self.candidate.of_arm else (self.read, self.repeated)
        return None if self.refuted else next((one for one in both if one is not None and one.confirmed), None)

    @property
    def sized(self) -> NoiseCandidate:
        """With the size that is to be believed: that of the arm's noise is in the repeats."""
        return self.confirmed.candidate if self.candidate.of_arm and self.confirmed is not None else self.candidate


def find_uneven_noise(
    everything: NoiseSample,
    repeats: NoiseSample,
    seed: int,
    level: float = levels.NOISE_LEVEL,
    readings: NoiseSample | None = None,
) -> tuple[list[NoiseCause], list[UnevenErrors]]:
    """The joints, or the range, along which noise is larger than elsewhere; and errors that only look like that.

    Noise is named where repeats scatter so, that of a joint by the size that they have. Where they refute the best
    candidate, a rival may replace it. Each is whitened, as if it were stated, before the next test at a stricter level.

    Args:
        everything: all rows; ``repeats`` their contrasts.
        readings: contrasts of rows of one posture that follow each other: scatter of a joint in them is the joint's,
            its absence says nothing, as the arm may not have left the posture.
    """
    readings = everything.none if readings is None else readings
    repeats, readings = _in_equal_units(repeats, seed), _in_equal_units(readings, seed)
    named: list[tuple[_Examined, list[NoiseCandidate]]] = []
    uneven: list[UnevenErrors] = []
    taken: set[tuple[str, str]] = set()
    everything, candidates = _scored(everything, seed)
    while candidates and candidates[0].p_value < (levels.FURTHER_NOISE_LEVEL if taken else level):
        first, rivals = candidates[0], _close_rivals(candidates)
        examined = [_examined(s, repeats, readings, seed) for s in (first, *rivals)]
        competing = examined if examined[0].refuted else examined[:1]
        chosen = next((one for one in competing if one.confirmed is not None), None)
        if chosen is None:
            still = examined[0].repeated is None and examined[0].read is not None
            part = _scatter_of_repeats(first, repeats, seed) if examined[0].refuted else None
            uneven.append(
                UnevenErrors(
                    first.named(), first.p_value, examined[0].refuted, _spread_lengths(first), still, part is not None
                )
            )
            if part is not None:
                named.append(part)
                repeats = _in_equal_units(repeats.without(spread_by(part[0].sized, repeats)), seed)
        else:
            first = chosen.candidate
            named.append((chosen, [s.candidate for s in examined if s is not chosen]))
            repeats = _in_equal_units(repeats.without(spread_by(chosen.sized, repeats)), seed)
            readings = _in_equal_units(readings.without(spread_by(chosen.sized, readings)), seed)
        taken.add(first.who)
        if first.spread is None or len(taken) == len(everything.rows.levers):
            break
        everything, scores = _scored(everything.without(first.spread), seed)
        candidates = [s for s in scores if s.who not in taken]
    return [_noise_cause(one, rivals, taken) for one, rivals in named], uneven


def _scatter_of_repeats(
    candidate: NoiseCandidate, repeats: NoiseSample, seed: int
) -> tuple[_Examined, list[NoiseCandidate]] | None:
    """The part of a joint's errors that is scatter, where repeats have it and by less; with its rivals there.

    None where another joint scatters more between repeats, none does, or it is a small part.
    """
    found = _most_scattering(candidate, repeats, seed)
    if not found or found[0].size < levels.MIN_SCATTER_SHARE * candidate.size:
        return None
    rest = repeats.without_farthest
    if rest.e.size >= levels.MIN_REPEAT_FREEDOM and not _most_scattering(candidate, rest, seed):
        return None
    return _Examined(found[0], RepeatedNoise(found[0], 0.0), None), _close_rivals(found)


def _most_scattering(candidate: NoiseCandidate, repeats: NoiseSample, seed: int) -> list[NoiseCandidate]:
    """The joints as noise of repeats, that of the candidate first; none where it is not, or not clearly."""
    found = [s for s in score_uneven_noise(repeats.e, repeats.rows, seed) if s.of_arm] if candidate.of_arm else []
    first = found and found[0].who == candidate.who and found[0].p_value < levels.REPEATED_NOISE_LEVEL
    return found if first else []


def _scored(sample: NoiseSample, seed: int) -> tuple[NoiseSample, list[NoiseCandidate]]:
    """A sample in units in which its quantities scatter alike, and the candidates there.

    An orientation whose σ is stated too small looks like noise of every joint that turns it. Where that explains more
    than any joint does, it is taken away first; whether the stated σ is wrong is judged elsewhere.
    """
    found = score_uneven_noise(sample.e, sample.rows, seed)
    if found and found[0].scale is not None and found[0].p_value < levels.NOISE_LEVEL:
        sample = sample.scaled(found[0].scale)
        found = score_uneven_noise(sample.e, sample.rows, seed)
    return sample, [candidate for candidate in found if candidate.scale is None]


def _in_equal_units(sample: NoiseSample, seed: int) -> NoiseSample:
    """A sample of contrasts in units in which its quantities scatter alike."""
    few = not sample.rows.turned or sample.e.size < levels.MIN_REPEAT_FREEDOM
    return sample if few else _scored(sample, seed)[0]


def _examined(candidate: NoiseCandidate, repeats: NoiseSample, readings: NoiseSample, seed: int) -> _Examined:
    """A candidate with what both kinds of contrasts say of it."""
    return _Examined(candidate, *(_shown(candidate, sample, seed) for sample in (repeats, readings)))


def _shown(candidate: NoiseCandidate, sample: NoiseSample, seed: int) -> RepeatedNoise | None:
    """What contrasts say of a candidate. A joint that scatters at one posture alone does not: a repeat is wrong."""
    found = score_repeats(sample.e, sample.rows, candidate, seed)
    if found is None or not candidate.of_arm or not found.confirmed:
        return found
    rest = sample.without_farthest
    others = score_repeats(rest.e, rest.rows, candidate, seed)
    return found if others is None or others.confirmed else others


def spread_by(candidate: NoiseCandidate, sample: NoiseSample) -> Array | None:
    """(N, d) spread of a sample's rows by the noise of a joint; None of noise that has no direction."""
    if not candidate.of_arm:
        return None
    names = sample.rows.robot.joint_names
    return np.asarray(candidate.size * sample.rows.levers[names.index(candidate.target)])


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
