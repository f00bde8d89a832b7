"""Unchanged, one change, two, or nothing of this sort: how probable new rows make each, and how large a change.

Each model is Gaussian and linear; sizes and the noise level have grids, over which its evidence is a sum. The prior
is sparse: one change is likelier than two.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from posture_opt.changes.forms import SIZES_M, Form
from posture_opt.changes.gaussian_evidence import (
    NOISE_LEVELS,
    NOISE_SPREAD,
    Estimate,
    GaussianRows,
    SizedChange,
    log_gains,
    log_sum,
)
from posture_opt.changes.new_rows import NewRows
from posture_opt.experiments.possible_changes import PossibleChange
from posture_opt.numerics import Array, Codes

PRIOR = {"unchanged": 0.6, "one": 0.3, "two": 0.07, "unexplained": 0.03, "gross": 0.03}
"""Before the new rows: an arm is checked after an incident, and is most often found as it was."""
_USUAL_M = 0.25e-3
_LOG_SIZES = -np.log(np.maximum(SIZES_M / _USUAL_M, 1.0))
LOG_SIZES = np.asarray(_LOG_SIZES - log_sum(_LOG_SIZES))
"""Up to 0.25 mm or mrad all sizes are alike probable, above in inverse proportion: large ones are rare."""
_LOG_LEVELS = -0.5 * (np.log(NOISE_LEVELS) / NOISE_SPREAD) ** 2
LOG_LEVELS = _LOG_LEVELS - log_sum(_LOG_LEVELS)
_UNEXPLAINED_LEVELS = 2.0 ** np.arange(1, 9)
"""Noise over what is stated where the rows err in a way that no change makes."""
_PAIRED = 6  # likeliest single changes that are tried with every other one
_TANGENT_ERROR = 0.3
"""Standard deviations of a row by which a tangent may miss before the rows are linearised about the estimate."""
_MAX_STEPS = 5
_MIN_WEIGHT = 1e-6  # of a part of an estimate


@dataclass(frozen=True, eq=False)
class Hypotheses:
    """Every model of what happened, with its log evidence on the new rows.

    Args:
        rows: linearised; ``gaussian`` the same in coordinates in which their covariance is diagonal.
        forms: of each change that moves the tool.
        own: (C,) the rows of each change, linearised about its estimate where that is large, and as ``gaussian``.
    """

    rows: NewRows
    gaussian: GaussianRows
    forms: tuple[tuple[Form, ...], ...]
    own: tuple[tuple[NewRows, GaussianRows], ...]

    @classmethod
    def of(cls, rows: NewRows) -> Hypotheses:
        """From rows and what may have changed on them."""
        gaussian = GaussianRows.of(rows.r, rows.P, rows.A)
        forms = tuple(form for form in (tuple(Form.of(rows, change)) for change in rows.moving) if form)
        found = cls(rows, gaussian, forms, ((rows, gaussian),) * len(forms))
        for _ in range(_MAX_STEPS):
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
        if np.max(np.abs(own.errors_at(x) - tangent)) < _TANGENT_ERROR:
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
            gains = [[self.sized(index, f, k).log_gains(f.sizes) for k in range(len(NOISE_LEVELS))] for f in forms]
            prior = self.own[index][1].densities + LOG_LEVELS - np.log(len(forms))
            found.append(np.array(gains) + prior[None, :, None] + LOG_SIZES)
        return found

    @cached_property
    def log_singles(self) -> Array:
        """(C,) log evidence of each change."""
        return np.array([log_sum(table) for table in self.tables])

    @cached_property
    def _likeliest(self) -> tuple[int, int]:
        """The likeliest single change, and the noise level at which it is."""
        best = int(np.argmax(self.log_singles + np.log(self.weights)))
        return best, int(np.argmax([log_sum(self.tables[best][:, k]) for k in range(len(NOISE_LEVELS))]))

    @cached_property
    def log_pairs(self) -> dict[tuple[int, int], float]:
        """Log evidence of two changes together: the likeliest ones with every other one."""
        if not self.forms:
            return {}
        order = np.argsort(-(self.log_singles + np.log(self.weights)), kind="stable")[:_PAIRED].tolist()
        pairs = {(min(a, b), max(a, b)) for a in order for b in range(len(self.forms)) if a != b}
        return {pair: self._log_pair(*pair) for pair in sorted(pairs)}

    def _log_pair(self, a: int, b: int) -> float:
        """Log evidence of two changes by the widest form of each, at one noise level, as that of all levels."""
        first, second = self.forms[a][-1], self.forms[b][-1]
        _, gains = _pair_gains(*self._pair_equations(a, b), first, second)
        best, level = self._likeliest
        ratio = self.log_singles[best] - log_sum(self.tables[best][:, level])
        density = self._both(a, b).densities[level] + LOG_LEVELS[level] + ratio
        return log_sum(gains) + float(density)

    def _both(self, a: int, b: int) -> GaussianRows:
        """The rows for two changes together: linearised as for the likelier one."""
        return self.own[a if self.log_singles[a] > self.log_singles[b] else b][1]

    def _pair_equations(self, a: int, b: int) -> tuple[Array, Array]:
        """The normal equations of two changes, by the widest form of each, at the likeliest noise level."""
        first, second = self.forms[a][-1], self.forms[b][-1]
        G, h = self._both(a, b).normal[self._likeliest[1]]
        at = np.concatenate([first.columns, second.columns])
        W = np.zeros((len(at), first.W.shape[1] + second.W.shape[1]))
        W[: len(first.columns), : first.W.shape[1]] = first.W
        W[len(first.columns) :, first.W.shape[1] :] = second.W
        return W.T @ G[np.ix_(at, at)] @ W, W.T @ h[at]

    @cached_property
    def _logs(self) -> Array:
        """(2 + C + pairs,) log of prior times evidence: unchanged, unexplained, one change each, two each."""
        pairs = self.log_pairs
        shares = {pair: 2 * self.weights[pair[0]] * self.weights[pair[1]] for pair in pairs}
        unexplained = [self.gaussian.log_density(level) for level in _UNEXPLAINED_LEVELS]
        return np.concatenate([
            [np.log(PRIOR["unchanged"]) + log_sum(self.gaussian.densities + LOG_LEVELS)],
            [np.log(PRIOR["unexplained"]) + log_sum(np.array(unexplained)) - np.log(len(unexplained))],
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
        """Of all models after the rows, by Bayes' rule."""
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
        """The estimate of one change alone, over all forms, noise levels and sizes."""
        table = self.tables[index]
        weights = np.exp(table - log_sum(table))
        parts, shares = [], []
        for f, k, s in np.argwhere(weights > _MIN_WEIGHT):
            form = self.forms[index][f]
            parts.append(self._of_parameters(form, self.sized(index, form, int(k)).estimate(float(form.sizes[s]))))
            shares.append(weights[f, k, s])
        return Estimate.mixture(parts, np.array(shares) / np.sum(shares))

    @staticmethod
    def _of_parameters(form: Form, t: Estimate) -> Estimate:
        """An estimate of t as one of all parameters of the change."""
        return Estimate(form.W @ t.mean, form.W @ t.covariance @ form.W.T)

    def _pair_estimate(self, a: int, b: int) -> tuple[Estimate, Estimate]:
        """The estimates of two changes with one another, at the likeliest noise level and the likeliest sizes."""
        first, second = self.forms[a][-1], self.forms[b][-1]
        H, h = self._pair_equations(a, b)
        sizes, gains = _pair_gains(H, h, first, second)
        d = sizes[int(np.argmax(gains))]
        covariance = np.asarray(np.linalg.inv(H + np.diag(d**-2)), dtype=float)
        mean, p = covariance @ h, first.W.shape[1]
        return (
            self._of_parameters(first, Estimate(mean[:p], covariance[:p, :p])),
            self._of_parameters(second, Estimate(mean[p:], covariance[p:, p:])),
        )

    def expected_preference(self, one: int, other: int) -> float:
        """Log Bayes factor by which rows are expected to prefer a change, of its estimated size, to another one.

        At the likeliest noise level; expected over the noise of rows in which the first change is made.
        """
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

        It is detected where it becomes likelier than no change.

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
        unchanged: nothing changed; ``unexplained`` the rows err in a way that no change makes.
        singles: (C,) of each change alone; ``pairs`` of two together.
    """

    unchanged: float
    unexplained: float
    singles: Array
    pairs: dict[tuple[int, int], float]

    @property
    def one(self) -> float:
        """Exactly one thing changed."""
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


def _pair_gains(H: Array, h: Array, first: Form, second: Form) -> tuple[Array, Array]:
    """Prior standard deviations (S, p) of two changes on the grid of their sizes, and the gain (S,) of each pair of
    sizes, their prior included; every other size of the grid.

    Args:
        H: (p, p) and h (p,) normal equations of both.
    """
    p, q = first.W.shape[1], second.W.shape[1]
    a, b = (form.sizes[::2] / form.W.shape[1] ** 0.5 for form in (first, second))
    d = np.repeat(np.array([(s, t) for s in a for t in b]), (p, q), axis=1)
    share = LOG_SIZES[::2] - log_sum(LOG_SIZES[::2])
    M = np.eye(p + q) + d[:, :, None] * H * d[:, None, :]
    u = d * h
    fit = np.sum(u * np.linalg.solve(M, u[:, :, None])[:, :, 0], axis=1)
    return d, 0.5 * (fit - np.linalg.slogdet(M)[1]) + np.add.outer(share, share).ravel()
