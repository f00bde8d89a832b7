"""Noise that is larger at some postures than at others: what all rows raise, and what repeats make of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from posture_opt.diagnosis.noise.noise_candidates import (
    NoiseCandidate,
    RepeatedNoise,
    score_repeats,
    score_uneven_noise,
)
from posture_opt.diagnosis.scores import levels
from posture_opt.encoding import Encoded, encoded
from posture_opt.measurements.measurements import Measurements
from posture_opt.measurements.repeats import Contrasts
from posture_opt.model.effects import Cause, NoiseEffect, Rows
from posture_opt.numerics import Array, Codes
from posture_opt.validation.scatter_model import whitened_repeats


@dataclass(frozen=True)
class NoiseCause:
    """A kind of noise that is named, with its size; estimate: name -> (value, standard error, SI unit)."""

    effect: NoiseEffect
    estimate: Mapping[str, tuple[float, float, str]]
    p_value: float
    confounded_with: tuple[Cause, ...] = ()


@dataclass(frozen=True, eq=False)
class UnevenErrors:
    """Errors that grow as one kind of noise would have it, and that repeats do not show to be scatter.

    Args:
        size: (N,) its standard deviation in each row, in units of the other scatter: where to repeat; empty where no
            posture shows it more than others.
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

    def beside(self, candidate: NoiseCandidate) -> NoiseSample:
        """`without` the noise of a joint; as it is beside noise that has no direction."""
        names = self.rows.robot.joint_names
        along = candidate.size * self.rows.levers[names.index(candidate.target)] if candidate.of_arm else None
        return self.without(along)

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
    """A candidate of all rows with what repeats, and rows of one posture that follow each other, say of it.

    Args:
        refuted: whether repeats scatter by another size; ``confirmed`` the candidate as what confirms it has it.
        still: whether only rows that follow each other are enough to say anything.
        rivals: what explains the rows nearly as well.
    """

    candidate: NoiseCandidate
    refuted: bool = False
    confirmed: NoiseCandidate | None = None
    still: bool = False
    rivals: Sequence[NoiseCandidate] = ()

    @classmethod
    def of(cls, candidate: NoiseCandidate, repeats: NoiseSample, readings: NoiseSample, seed: int) -> _Examined:
        """Noise of the instrument is in every reading; that of a joint is not where the arm stayed in its posture."""
        repeated, read = (_shown(candidate, sample, seed) for sample in (repeats, readings))
        refuted = any(
            one is not None and one.refuted for one in ((repeated,) if candidate.of_arm else (repeated, read))
        )
        both = (repeated, read) if candidate.of_arm else (read, repeated)
        sure = (one.candidate for one in both if one is not None and one.confirmed and not refuted)
        return cls(candidate, refuted, next(sure, None), repeated is None and read is not None)

    @property
    def sized(self) -> NoiseCandidate:
        """With the size that is to be believed: that of the arm's noise is in the repeats."""
        return self.confirmed if self.candidate.of_arm and self.confirmed is not None else self.candidate


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
    """
    readings = everything.none if readings is None else readings
    repeats, readings = _in_equal_units(repeats, seed), _in_equal_units(readings, seed)
    named: list[_Examined] = []
    uneven: list[UnevenErrors] = []
    taken: set[tuple[str, str]] = set()
    everything, candidates = _scored(everything, seed)
    while candidates and candidates[0].p_value < (levels.FURTHER_NOISE_LEVEL if taken else level):
        examined = [_Examined.of(s, repeats, readings, seed) for s in (candidates[0], *_close_rivals(candidates))]
        first = examined[0]
        competing = examined if first.refuted else examined[:1]
        found = next((one for one in competing if one.confirmed is not None), None)
        if found is not None:
            first = found
            found = replace(found, rivals=[s.candidate for s in examined if s is not first])
            readings = _in_equal_units(readings.beside(found.sized), seed)
        else:
            found = _scatter_of_repeats(first.candidate, repeats, seed) if first.refuted else None
            worst, still = first.candidate, first.still
            size = np.zeros(0) if worst.spread is None else np.linalg.norm(worst.spread, axis=1)
            effect, part = worst.named(), found is not None
            uneven.append(UnevenErrors(effect, worst.p_value, first.refuted, size, still, part))
        if found is not None:
            named.append(found)
            repeats = _in_equal_units(repeats.beside(found.sized), seed)
        taken.add(first.candidate.who)
        if first.candidate.spread is None or len(taken) == len(everything.rows.levers):
            break
        everything, scores = _scored(everything.without(first.candidate.spread), seed)
        candidates = [s for s in scores if s.who not in taken]
    causes = []
    for one in named:
        others = tuple(rival.named() for rival in one.rivals if rival.who not in taken)
        causes.append(NoiseCause(one.sized.named(), one.sized.estimate, one.candidate.p_value, others))
    return causes, uneven


def _scatter_of_repeats(candidate: NoiseCandidate, repeats: NoiseSample, seed: int) -> _Examined | None:
    """The part of a joint's errors that is scatter, where repeats have it and by less; with its rivals there.

    None where another joint scatters more between repeats, none does, or it is less than a tenth of the variance.
    """
    found = _most_scattering(candidate, repeats, seed)
    if not found or found[0].size < 0.3 * candidate.size:
        return None
    rest = repeats.without_farthest
    if rest.e.size >= levels.MIN_REPEAT_FREEDOM and not _most_scattering(candidate, rest, seed):
        return None
    return _Examined(found[0], confirmed=found[0], rivals=_close_rivals(found))


def _most_scattering(candidate: NoiseCandidate, repeats: NoiseSample, seed: int) -> list[NoiseCandidate]:
    found = [s for s in score_uneven_noise(repeats.e, repeats.rows, seed) if s.of_arm] if candidate.of_arm else []
    first = found and found[0].who == candidate.who and found[0].p_value < levels.REPEATED_NOISE_LEVEL
    return found if first else []


def _scored(sample: NoiseSample, seed: int) -> tuple[NoiseSample, list[NoiseCandidate]]:
    """A sample in units in which its quantities scatter alike, and the candidates there.

    An orientation whose σ is stated too small looks like noise of every joint that turns it; it is taken away first.
    """
    found = score_uneven_noise(sample.e, sample.rows, seed)
    if found and found[0].scale is not None and found[0].p_value < levels.NOISE_LEVEL:
        sample = sample.scaled(found[0].scale)
        found = score_uneven_noise(sample.e, sample.rows, seed)
    return sample, [candidate for candidate in found if candidate.scale is None]


def _in_equal_units(sample: NoiseSample, seed: int) -> NoiseSample:
    few = not sample.rows.turned or sample.e.size < levels.MIN_REPEAT_FREEDOM
    return sample if few else _scored(sample, seed)[0]


def _shown(candidate: NoiseCandidate, sample: NoiseSample, seed: int) -> RepeatedNoise | None:
    """What contrasts say of a candidate. A joint that scatters at one posture alone does not: a repeat is wrong."""
    found = score_repeats(sample.e, sample.rows, candidate, seed)
    if found is None or not candidate.of_arm or not found.confirmed:
        return found
    rest = sample.without_farthest
    others = score_repeats(rest.e, rest.rows, candidate, seed)
    return found if others is None or others.confirmed else others


def _close_rivals(candidates: Sequence[NoiseCandidate]) -> list[NoiseCandidate]:
    least = max(candidates[0].ratio - levels.RIVAL_CRITERION, 0.0)
    return [s for s in candidates[1:] if s.ratio > least]


@dataclass(frozen=True, eq=False)
class RepeatPlan(Encoded):
    """Postures to measure several times each, the arm leaving them in between."""

    errors: UnevenErrors
    rows: Measurements
    times: int

    @property
    def target(self) -> str:
        return self.errors.effect.target

    def fields_json(self) -> dict[str, object]:
        """An entry of ``unexplained.repeat`` in ``diagnosis.json``: lines of the file, and postures [rad, m]."""
        postures = [dict(zip(self.rows.joint_names, q, strict=True)) for q in self.rows.q]
        return {**encoded(self, "target times lines=rows.line"), "postures": postures}


def plan_repeats(data: Measurements, groups: Codes, uneven: Sequence[UnevenErrors]) -> tuple[RepeatPlan, ...]:
    """For every joint that errors grow with, and that repeats say nothing of, the postures where it would show most.

    Args:
        data: the rows of ``uneven``; ``groups`` (N,) those that repeat one posture already.
    """
    plans: list[RepeatPlan] = []
    if data.position is None:  # whoever leads an arm into sockets by hand does not come back to a posture
        return ()
    for errors in uneven:
        # Rows of one posture are there already: whether the arm left it in between decides, and not more of them.
        if errors.refuted or errors.still or not len(errors.size):
            continue
        order = np.argsort(-errors.size, kind="stable")
        first = np.sort(np.unique(groups[order], return_index=True)[1])[:5]
        plans.append(RepeatPlan(errors, data.take(order[first]), 5))
    return tuple(plans)
