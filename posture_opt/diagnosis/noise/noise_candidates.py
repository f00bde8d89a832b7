"""Tests of the noise: one joint noisier than stated, noise that grows with the range, a wrong stated σ, outliers."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from posture_opt.diagnosis.scores import levels
from posture_opt.diagnosis.scores.score_tests import p_value_of_maximum
from posture_opt.model.effects import NOISES, NoiseEffect, Pattern, Rows, StatedSigma
from posture_opt.numerics import Array, Mask
from posture_opt.validation.scatter_model import null_sets


@dataclass(frozen=True)
class NoiseCandidate:
    """A kind of noise with its likelihood ratio test.

    Args:
        spread: (N, d) shift of the rows per standard deviation of it, in units of their other scatter; ``None`` of a
            range.
        scale: (d,) of a quantity whose σ is wrong, by which its coordinates are too large; None of other noise.
    """

    kind: str
    target: str
    ratio: float
    p_value: float
    quantity: tuple[str, str]
    size: float
    std: float
    named: Callable[[], NoiseEffect]
    strength: float = math.nan
    spread: Array | None = None
    of_arm: bool = False
    scale: Array | None = None

    @property
    def who(self) -> tuple[str, str]:
        return self.kind, self.target

    @property
    def estimate(self) -> dict[str, tuple[float, float, str]]:
        name, unit = self.quantity
        return {name: (self.size, self.std, unit)}


def standardised_residuals(e: Array, leverage: Array) -> Array:
    """(N, d) standardised residuals ``(I − H_ii)^(−1/2) e_i`` of residuals (N, d) and leverages (N, d, d).

    Source: Cook, Weisberg (1982), section 2.2.
    """
    d = e.shape[1]
    values, vectors = np.linalg.eigh(np.eye(d) * (1 + 1e-9) - leverage)
    # With less than 2 % left free by a fit, a residual says nothing of the noise.
    root = np.einsum("nij,nj,nkj->nik", vectors, 1 / np.sqrt(np.maximum(values, 0.02)), vectors)
    return np.asarray(np.einsum("nij,nj->ni", root, e))


def score_uneven_noise(e: Array, rows: Rows, seed: int, draws: int = 399) -> list[NoiseCandidate]:
    """Heteroscedastic noise: every joint, and the range, as the cause of noise that is not the same everywhere.

    The null distribution, of ``draws`` data sets, turns the residuals of every repeat at random and permutes the
    repeats, so that heavy tails alone raise no alarm.

    Args:
        e: (N, d) standardised residuals.
    """
    patterns = [pattern for kind in NOISES for pattern in kind.patterns(rows)]
    if not patterns:
        return []
    found = _noise_fits(e, rows, patterns, seed, draws)
    most = np.stack([fit.drawn for fit in found]).max(axis=0)
    candidates = [fit.candidate(pattern, most) for fit, pattern in zip(found, patterns, strict=True)]
    return sorted(candidates, key=lambda s: -s.ratio)


@dataclass(frozen=True, eq=False)
class RepeatedNoise:
    """What the differences between repeats say of one kind of noise."""

    candidate: NoiseCandidate
    loss: float
    without: float = 0.0

    @property
    def refuted(self) -> bool:
        """Whether the repeats scatter by another size."""
        return self.loss > 6.63  # the 99 % quantile of χ² (Wilks 1938)

    @property
    def confirmed(self) -> bool:
        """Whether they scatter, and by that size."""
        if self.refuted:
            return False
        likelier = not self.candidate.of_arm and self.without - self.loss > 2.71  # 95 % of one side (Wilks 1938)
        return likelier or self.candidate.p_value < levels.REPEATED_NOISE_LEVEL


def score_repeats(e: Array, rows: Rows, asked: NoiseCandidate, seed: int) -> RepeatedNoise | None:
    """The likelihood ratio test of one kind of noise on contrasts (C, d) of repeats."""
    if e.size < levels.MIN_REPEAT_FREEDOM:
        return None
    patterns = (p for kind in NOISES for p in kind.patterns(rows))
    pattern = next((p for p in patterns if (p.effect.kind_name(), p.target) == asked.who), None)
    if pattern is None:
        return None
    (fit,) = _noise_fits(e, rows, [pattern], seed)
    return RepeatedNoise(fit.candidate(pattern, fit.drawn), fit.loss(pattern, asked.strength), fit.loss(pattern, 0.0))


@dataclass(frozen=True, eq=False)
class _Fit:
    """Noise of one pattern in a set of residuals, and in those of its null distribution.

    Args:
        ratio: twice the log likelihood ratio of the best size; ``drawn`` (F,) those of the null distribution.
        curve, variances: (grid,) twice the log likelihood ratio, and s², of every value of the grid.
    """

    ratio: float
    drawn: Array
    value: float
    s2: float
    curve: Array
    variances: Array

    @classmethod
    def of(cls, sets: Array, total: Array, pattern: Pattern) -> _Fit:
        """Of residuals (1 + F, N, d), the first set the one that was measured, and their squared lengths (1 + F, N)."""
        _, N, d = sets.shape
        along = pattern.along(sets)
        null = -N * d / 2 * np.log(total.sum(axis=1) / (N * d))
        likelihoods, s2 = _log_likelihoods(pattern, pattern.grid, total, along, d)
        heights, variances = likelihoods[:, 0], s2[:, 0]
        top = float(np.interp(_parabola_peak(heights.tolist()), np.arange(len(heights)), pattern.grid))
        least = _log_likelihoods(pattern, np.array([top]), total[:1], None if along is None else along[:1], d)[1]
        ratios = 2 * (likelihoods.max(axis=0) - null)
        return cls(float(ratios[0]), ratios[1:], top, float(least[0, 0]), 2 * (heights - null[0]), variances)

    def candidate(self, pattern: Pattern, most: Array) -> NoiseCandidate:
        """The noise with its p-value by the largest ratios of draws (F,)."""
        value, s2 = self.value, self.s2
        p, std = p_value_of_maximum(most, self.ratio), pattern.error(value, s2)
        named = partial(pattern.named, value, s2, std)
        spread = None if pattern.unit is None else pattern.unit * np.sqrt(pattern.inflation(value) - 1)[:, None]
        who = pattern.effect.kind_name(), pattern.target
        of_arm = pattern.effect.of_arm
        size, scale = pattern.size(value, s2), pattern.units(value)
        strength = pattern.strength(value, s2)
        return NoiseCandidate(*who, self.ratio, p, pattern.quantity, size, std, named, strength, spread, of_arm, scale)

    def loss(self, pattern: Pattern, strength: float) -> float:
        """Twice the log likelihood that noise of a strength loses against the likeliest."""
        own = [pattern.strength(value, s2) for value, s2 in zip(map(float, pattern.grid), self.variances, strict=True)]
        return float(self.curve.max() - np.interp(strength, own, self.curve))


def _noise_fits(e: Array, rows: Rows, patterns: Sequence[Pattern], seed: int, draws: int = 399) -> list[_Fit]:
    """Noise of each pattern in residuals (N, d) and in sets as chance could have them, some of 32 MB at a time."""
    rng, left, found = np.random.default_rng(seed), draws, list[list[_Fit]]()
    while left > 0:
        count = min(left, max(4_000_000 // e.size, 1))
        sets = np.concatenate([e[None], null_sets(e, rows.visits, count, rng)])
        total = np.einsum("fnd,fnd->fn", sets, sets)
        found.append([_Fit.of(sets, total, pattern) for pattern in patterns])
        left -= count
    each = zip(*found, strict=True)
    return [replace(parts[0], drawn=np.concatenate([fit.drawn for fit in parts])) for parts in each]


def _log_likelihoods(pattern: Pattern, values: Array, total: Array, along: Array | None, d: int) -> tuple[Array, Array]:
    """Log likelihoods (G, F) and likeliest s² (G, F) of noise of several sizes in F data sets."""
    N, determinants = total.shape[1], np.zeros(len(values))
    weights, along_weights = np.ones((len(values), N)), np.zeros((len(values), N))
    for i, value in enumerate(map(float, values)):
        level = pattern.level(value)
        if level is not None:
            weights[i], determinants[i] = np.exp(-level), d * float(level.sum())
        if along is not None:
            inflation = pattern.inflation(value)
            along_weights[i] = weights[i] / inflation - weights[i]
            determinants[i] += pattern.rank * np.log(inflation).sum()
    weighted = weights @ total.T
    if along is not None:
        weighted += along_weights @ along.T
    s2 = weighted / (N * d)
    return -N * d / 2 * np.log(s2) - 0.5 * determinants[:, None], s2


def _parabola_peak(values: list[float]) -> float:
    k = int(np.argmax(values))
    if not 0 < k < len(values) - 1:
        return float(k)
    left, middle, right = values[k - 1 : k + 2]
    bend = left - 2 * middle + right
    return k + (0.5 * (left - right) / bend if bend < 0 else 0.0)


def score_stated_sigma(variance: float, freedom: int, kurtosis: float, estimated: int | None = None) -> NoiseCandidate:
    """Whether the residual variance in units of the stated one is 1; long tails, by their kurtosis, widen the test.

    ``variance ~ F(2ν/(2 + κ), ν_stated)`` with the excess kurtosis κ, two-sided: a mean of squares has the variance
    ``(2 + κ)/ν``, as χ² of so many degrees of freedom over them.

    Source: Satterthwaite (1946), Biometrics Bulletin 2, 110-114.
    """
    from scipy.special import chdtr, chdtrc, fdtr, fdtrc

    effective = 2 * max(freedom, 1) / max(2 + kurtosis, 0.5)
    if estimated:
        tails = fdtr(effective, estimated, variance), fdtrc(effective, estimated, variance)
    else:
        tails = chdtr(effective, effective * variance), chdtrc(effective, effective * variance)
    factor = float(np.sqrt(variance))
    # The standard error of a logarithm of a σ: JCGM 100:2008, equation E.7, of both where the stated one has it too.
    std = factor * float(np.sqrt(1 / (2 * effective) + (1 / (2 * estimated) if estimated else 0.0)))
    ratio = effective * (variance - 1 - float(np.log(max(variance, 1e-300))))
    p, named = min(1.0, 2 * float(min(tails))), partial(StatedSigma, factor=factor)
    return NoiseCandidate(StatedSigma.kind_name(), "data", ratio, p, ("factor", "1"), factor, std, named)


def gross_errors(e: Array) -> tuple[Mask, float] | None:
    """Rows (N,) that are gross errors among residuals (N, d) of equal covariance, and the BIC of the next best law.

    Less that of a Gaussian with a few gross errors; None where a Gaussian or Student's t is the better law.
    """
    N, d = e.shape
    squares = np.einsum("nd,nd->n", e, e)
    gaussian = -N * d / 2 * (np.log(2 * np.pi * squares.mean() / d) + 1)
    mixture, rows = _mixture_fit(squares, d)
    laws = -2 * np.array([gaussian, _student_likelihood(squares, d), mixture]) + np.log(N) * np.array([1, 2, 3])
    few = 0 < rows.sum() <= max(1.0, 0.1 * N)  # the mixtures of Tukey (1960) go to 10 %
    return (rows, float(laws[:2].min() - laws[2])) if few and laws[2] < laws[:2].min() else None


def _student_likelihood(squares: Array, d: int) -> float:
    """Log likelihood of Student's t that fits squared lengths (N,) best."""
    from scipy.special import gammaln

    found = []
    for nu in np.geomspace(1.5, 60, 40):  # from tails without a variance to all but Gaussian ones
        s2 = squares.mean() / d
        for _ in range(30):  # of EM (Lange, Little, Taylor 1989): more digits than a choice by BIC needs
            weights = (nu + d) / (nu + squares / s2)
            s2 = float(np.mean(weights * squares) / d)
        value = len(squares) * (gammaln((nu + d) / 2) - gammaln(nu / 2) - d / 2 * np.log(np.pi * nu * s2))
        found.append(value - (nu + d) / 2 * float(np.log1p(squares / (nu * s2)).sum()))
    return float(max(found))


def _mixture_fit(squares: Array, d: int) -> tuple[float, Mask]:
    """EM for ``(1 − w) N(0, s²) + w N(0, (f s)²)``, f at least 4 (Dempster, Laird, Rubin 1977)."""
    s2 = float(np.median(squares)) / d
    share, wide = 0.02, max(float(squares.max()) / d, 25 * s2)
    value = -np.inf
    for _ in range(200):
        good = np.log1p(-share) - d / 2 * np.log(2 * np.pi * s2) - squares / (2 * s2)
        bad = np.log(share) - d / 2 * np.log(2 * np.pi * wide) - squares / (2 * wide)
        total = np.logaddexp(good, bad)
        weight = np.exp(bad - total)
        former, value = value, float(total.sum())
        if abs(value - former) < 1e-8 * abs(value):
            break
        share = float(np.clip(weight.mean(), 1e-6, 0.5))
        s2 = float(np.sum((1 - weight) * squares) / (d * np.sum(1 - weight)))
        wide = max(float(np.sum(weight * squares) / max(d * weight.sum(), 1e-9)), 16 * s2)
    return value, np.asarray(weight > 0.5)
