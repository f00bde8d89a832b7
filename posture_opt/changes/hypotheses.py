"""Unchanged, one change, two, or nothing of this sort: how probable new rows make each, and how large a change."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from posture_opt.changes.new_rows import (
    NOISE_LEVELS,
    NOISE_SPREAD,
    Estimate,
    GaussianRows,
    NewRows,
    SizedChange,
    log_gains,
    log_normalised,
    log_sum,
)
from posture_opt.experiments.possible_changes import PossibleChange, change_name
from posture_opt.numerics import Array, Codes

# Sizes of a change: 0.06 to 64 mm of motion of the tool, of a joint the same in mrad.
SIZES_M = np.asarray(1e-3 * 2.0 ** np.arange(-4, 7), dtype=float)


@dataclass(frozen=True, eq=False)
class Form:
    """A change by some parameters of it, ``θ = W t``, in units of 1 m of root mean square motion of the tool.

    Args:
        columns: (p,) places of its parameters among those of the rows.
        W: (p, q); rows of zeros for those that do not deviate.
        lever: motion of the tool [m] per m or rad of the size, by which sizes are stated: of a turning joint its root
            mean square lever, else 1.
    """

    change: PossibleChange
    columns: Codes
    W: Array
    lever: float

    @property
    def sizes(self) -> Array:
        """(S,) root mean square motion of the tool by each size [m]."""
        return SIZES_M * self.lever

    @classmethod
    def of(cls, rows: NewRows, change: PossibleChange) -> list[Form]:
        """The forms of a change that move the tool at all."""
        found: list[Form] = []
        motion = rows.motion(change)
        for deviating in change.forms:
            values, vectors = np.linalg.eigh(motion[np.ix_(deviating, deviating)])
            kept = values > 1e-9 * np.trace(motion)  # less is no motion
            if kept.sum() > (found[0].W.shape[1] if found else 0) or kept.all():
                W = np.zeros((len(motion), int(kept.sum())))
                W[list(deviating)] = vectors[:, kept] / np.sqrt(values[kept])
                angle = len(change.parameters) == 1 and change.parameters[0].unit == "rad"
                lever = math.sqrt(float(motion[0, 0])) if angle else 1.0
                found.append(cls(change, np.array(rows.columns(change)), W, lever))
        return found


# Before the new rows: an arm is checked after an incident, and is most often found as it was.
PRIOR = {"unchanged": 0.6, "one": 0.3, "two": 0.07, "unexplained": 0.03, "gross": 0.03}
# Up to 0.25 mm or mrad all sizes are alike probable, above in inverse proportion: large ones are rare.
LOG_SIZES = log_normalised(-np.log(np.maximum(SIZES_M / 0.25e-3, 1.0)))
LOG_LEVELS = log_normalised(-0.5 * (np.log(NOISE_LEVELS) / NOISE_SPREAD) ** 2)
# Noise over what is stated where the rows err in a way that no change makes.
_UNEXPLAINED_LEVELS = np.asarray(2.0 ** np.arange(1, 9), dtype=float)


@dataclass(frozen=True, eq=False)
class Hypotheses:
    """Every model of what happened, with its log evidence on the new rows.

    Args:
        own: (C,) the rows of each change, linearised about its estimate where that is large, and as ``gaussian``.
    """

    rows: NewRows
    gaussian: GaussianRows
    forms: tuple[tuple[Form, ...], ...]
    own: tuple[tuple[NewRows, GaussianRows], ...]

    @classmethod
    def of(cls, rows: NewRows) -> Hypotheses:
        gaussian = GaussianRows.of(rows.r, rows.P, rows.A)
        forms = tuple(form for form in (tuple(Form.of(rows, change)) for change in rows.moving) if form)
        found = cls(rows, gaussian, forms, ((rows, gaussian),) * len(forms))
        for _ in range(5):
            closer = tuple(found._closer(index) for index in range(len(forms)))
            if closer == found.own:
                break
            found = cls(rows, gaussian, forms, closer)
        return found

    def _closer(self, index: int) -> tuple[NewRows, GaussianRows]:
        """The rows linearised about the estimate of a change; as they are, where the tangent serves there."""
        own, _ = self.own[index]
        x = self.rows.x.copy()
        x[self.rows.columns(self.changes[index])] += self._estimate(index).mean
        tangent = own.r + own.A @ (x - self.rows.x)
        if np.max(np.abs(own.errors_at(x) - tangent)) < 0.3:  # standard deviations of a row
            return self.own[index]
        own = self.rows.about(x)
        return own, GaussianRows.of(own.r, own.P, own.A)

    @property
    def changes(self) -> tuple[PossibleChange, ...]:
        """(C,) what may have changed."""
        return tuple(forms[0].change for forms in self.forms)

    @cached_property
    def weights(self) -> Array:
        """(C,) probability of each change where one thing changed: that of its kind, shared by all of the kind."""
        kinds = [change.kind for change in self.changes]
        shares = np.array([change.share / kinds.count(change.kind) for change in self.changes])
        return np.asarray(shares / shares.sum())

    def sized(self, index: int, form: Form, level: int) -> SizedChange:
        """One form of a change at the noise level of an index."""
        G, b = self.own[index][1].normal[level]
        return SizedChange(form.W.T @ G[np.ix_(form.columns, form.columns)] @ form.W, form.W.T @ b[form.columns])

    @cached_property
    def tables(self) -> list[Array]:
        """Of each change (F, L, S) its log evidence by form, noise level and size, their prior included."""
        found = []
        for index, forms in enumerate(self.forms):
            each = [[self.sized(index, f, k).spectrum for k in range(len(NOISE_LEVELS))] for f in forms]
            gains = [[log_gains(v, z, f.sizes) for v, _, z in own] for own, f in zip(each, forms, strict=True)]
            prior = self.own[index][1].densities + LOG_LEVELS - np.log(len(forms))
            found.append(np.array(gains) + prior[None, :, None] + LOG_SIZES)
        return found

    @cached_property
    def log_singles(self) -> Array:
        """(C,) log evidence of each change."""
        return np.array([log_sum(table) for table in self.tables])

    @cached_property
    def _likeliest(self) -> tuple[int, int]:
        best = int(np.argmax(self.log_singles + np.log(self.weights)))
        return best, int(np.argmax([log_sum(self.tables[best][:, k]) for k in range(len(NOISE_LEVELS))]))

    @cached_property
    def log_pairs(self) -> dict[tuple[int, int], float]:
        """Log evidence of two changes at one noise level, as at all: the six likeliest with every other one."""
        if not self.forms:
            return {}
        order = np.argsort(-(self.log_singles + np.log(self.weights)), kind="stable")[:6].tolist()
        pairs = {(min(a, b), max(a, b)) for a in order for b in range(len(self.forms)) if a != b}
        best, level = self._likeliest
        ratio = self.log_singles[best] - log_sum(self.tables[best][:, level])
        found = {}
        for pair in sorted(pairs):
            _, _, _, gains, rows = self._pair(*pair)
            found[pair] = log_sum(gains) + float(rows.densities[level] + LOG_LEVELS[level] + ratio)
        return found

    def _pair(self, a: int, b: int) -> tuple[Array, Array, Array, Array, GaussianRows]:
        """Normal equations H (p, p) and h (p,) of two changes by the widest form of each, at the likeliest noise level.

        Then prior standard deviations (S, p) on every other size of the grid, the gain (S,) of each pair of sizes with
        their prior, and the rows: linearised as for the likelier one.
        """
        first, second = self.forms[a][-1], self.forms[b][-1]
        rows = self.own[a if self.log_singles[a] > self.log_singles[b] else b][1]
        G, h = rows.normal[self._likeliest[1]]
        at, (p, q) = np.concatenate([first.columns, second.columns]), (first.W.shape[1], second.W.shape[1])
        W = np.zeros((len(at), p + q))
        W[: len(first.columns), :p], W[len(first.columns) :, p:] = first.W, second.W
        H, h = W.T @ G[np.ix_(at, at)] @ W, W.T @ h[at]
        sizes = [form.sizes[::2] / form.W.shape[1] ** 0.5 for form in (first, second)]
        d = np.repeat(np.array([(s, t) for s in sizes[0] for t in sizes[1]]), (p, q), axis=1)
        share = log_normalised(LOG_SIZES[::2])
        M, u = np.eye(p + q) + d[:, :, None] * H * d[:, None, :], d * h
        fit = np.sum(u * np.linalg.solve(M, u[:, :, None])[:, :, 0], axis=1)
        return H, h, d, 0.5 * (fit - np.linalg.slogdet(M)[1]) + np.add.outer(share, share).ravel(), rows

    @cached_property
    def _logs(self) -> Array:
        """(2 + C + pairs,) log of prior times evidence: unchanged, unexplained, one change each, two each."""
        pairs = self.log_pairs
        shares = {pair: 2 * self.weights[pair[0]] * self.weights[pair[1]] for pair in pairs}
        unexplained = self.gaussian.log_densities(_UNEXPLAINED_LEVELS)
        return np.concatenate([
            [np.log(PRIOR["unchanged"]) + log_sum(self.gaussian.densities + LOG_LEVELS)],
            [np.log(PRIOR["unexplained"]) + log_sum(unexplained) - np.log(len(unexplained))],
            np.log(PRIOR["one"]) + np.log(self.weights) + self.log_singles,
            [np.log(PRIOR["two"]) + np.log(shares[pair]) + pairs[pair] for pair in pairs],
        ])  # fmt: skip

    @property
    def log_evidence(self) -> float:
        """``log p(r)`` of the whitened rows over all models."""
        dimension = self.gaussian.freedom + len(self.gaussian.r)
        return log_sum(self._logs) - 0.5 * dimension * math.log(2 * math.pi)

    @cached_property
    def probabilities(self) -> Probabilities:
        p, count = np.exp(self._logs - log_sum(self._logs)), len(self.forms)
        two = dict(zip(self.log_pairs, p[2 + count :].tolist(), strict=True))
        return Probabilities(float(p[0]), float(p[1]), p[2 : 2 + count], two)

    def estimates(self, together: Sequence[int] = ()) -> list[Estimate]:
        """(C,) what the parameters of each change deviate by: alone, or two with one another where two are named."""
        found = [self._estimate(index) for index in range(len(self.forms))]
        if len(together) == 2:
            a, b = together
            found[a], found[b] = self._pair_estimate(a, b)
        return found

    def _estimate(self, index: int) -> Estimate:
        table = self.tables[index]
        weights = np.exp(table - log_sum(table))
        parts, shares = [], []
        for f, k, s in np.argwhere(weights > 1e-6):
            form = self.forms[index][f]
            parts.append(self.sized(index, form, int(k)).estimate(float(form.sizes[s])).of(form.W))
            shares.append(weights[f, k, s])
        return Estimate.mixture(parts, np.array(shares) / np.sum(shares))

    def _pair_estimate(self, a: int, b: int) -> tuple[Estimate, Estimate]:
        """The estimates of two changes with one another, at the likeliest noise level and the likeliest sizes."""
        first, second = self.forms[a][-1], self.forms[b][-1]
        H, h, sizes, gains, _ = self._pair(a, b)
        covariance = np.asarray(np.linalg.inv(H + np.diag(sizes[int(np.argmax(gains))] ** -2.0)))
        mean, p = covariance @ h, first.W.shape[1]
        one, other = Estimate(mean[:p], covariance[:p, :p]), Estimate(mean[p:], covariance[p:, p:])
        return one.of(first.W), other.of(second.W)

    def expected_preference(self, one: int, other: int) -> float:
        """Log Bayes factor by which rows are expected to prefer a change, of its estimated size, to another one."""
        theta = self._estimate(one).mean
        at = self.forms[one][-1].columns
        return self._expected_gain(one, at, theta) - self._expected_gain(other, at, theta)

    def _expected_gain(self, index: int, at: Codes, theta: Array) -> float:
        """Expected log evidence of a change over no change, where the parameters ``at`` (p,) deviate by theta."""
        level = self._likeliest[1]
        G, _ = self.own[index][1].normal[level]
        gains = []
        for form in self.forms[index]:
            values, V, _ = self.sized(index, form, level).spectrum
            z = V.T @ form.W.T @ G[np.ix_(form.columns, at)] @ theta
            gains.append(log_gains(values, np.sqrt(z**2 + values), form.sizes) + LOG_SIZES)
        return log_sum(np.array(gains)) - math.log(len(gains))

    def power(self, index: int, shift: float, draws: Array) -> float:
        """Probability that a change of this root mean square motion [m] is detected, in its least visible direction.

        Args:
            draws: (n, 6) of standard normal numbers.
        """
        form = self.forms[index][0]
        values = self.sized(index, form, len(NOISE_LEVELS) // 2).spectrum[0]
        z = draws[:, : len(values)] * np.sqrt(values)
        z[:, 0] += values[0] * shift
        gains = log_gains(values, z, form.sizes) + LOG_SIZES
        top = gains.max(axis=1)
        log_factor = top + np.log(np.sum(np.exp(gains - top[:, None]), axis=1)) - np.log(len(self.forms[index]))
        log_prior = np.log(PRIOR["one"] * self.weights[index] / PRIOR["unchanged"])
        return float(np.mean(log_factor + log_prior > 0))


@dataclass(frozen=True, eq=False)
class Probabilities:
    """Of every model after the new rows; they sum to one.

    Args:
        singles: (C,) of each change alone; ``pairs`` of two together.
    """

    unchanged: float
    unexplained: float
    singles: Array
    pairs: dict[tuple[int, int], float]

    @property
    def one(self) -> float:
        return float(np.sum(self.singles))

    @property
    def several(self) -> float:
        """More than one thing changed, or something that is no change of those that are listed."""
        return float(sum(self.pairs.values())) + self.unexplained

    @property
    def involved(self) -> Array:
        """(C,) share of each change in the probability that something changed, two together with half of it each."""
        found = self.singles.copy()
        for (a, b), p in self.pairs.items():
            found[[a, b]] += p / 2
        total = float(np.sum(found))
        return found * (1 - self.unchanged) / total if total else found


# Probability of being detected from which on a change counts as visible.
POWER = 0.9
# The motion of the tool whose probability of being detected is reported [m].
REFERENCE_M = 0.1e-3


@dataclass(frozen=True)
class Visibility:
    """What can be seen of one possible change, in the direction in which least is seen.

    Args:
        shift: the motion of the tool [m] that is detected with a probability of 90 %; infinite where none is.
        size, unit: the same as a deviation of the parameter [SI]; NaN for frames, where it is the shift.
    """

    kind: str
    target: str
    power: float
    shift: float
    size: float
    unit: str

    @property
    def name(self) -> str:
        return change_name(self.kind, self.target)

    @property
    def seen(self) -> bool:
        """Whether there is a size from which on the change is detected: a turn of half a revolution is none."""
        return not (self.unit == "rad" and math.pi < self.size < math.inf)


def visibilities(models: Hypotheses) -> tuple[Visibility, ...]:
    draws, found = np.random.default_rng(0).standard_normal((400, 6)), []
    for index, change in enumerate(models.changes):
        shift, single = _visible_motion(models, index, draws), len(change.parameters) == 1
        size = shift * abs(float(models.forms[index][0].W[0, 0])) if single else math.nan
        unit = change.parameters[0].unit if single else "m"
        power = models.power(index, REFERENCE_M, draws)
        found.append(Visibility(change.kind, change.target, power, shift, size, unit))
    return tuple(found)


def _visible_motion(models: Hypotheses, index: int, draws: Array) -> float:
    """The motion [m] from 0.01 to 50 mm that is detected with the probability `POWER`; infinite where none is."""
    low, high = 1e-5, 0.05
    if models.power(index, high, draws) < POWER:
        return math.inf
    for _ in range(9):
        middle = math.sqrt(low * high)
        low, high = (low, middle) if models.power(index, middle, draws) >= POWER else (middle, high)
    return math.sqrt(low * high)
