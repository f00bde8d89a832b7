"""Which posture each feature takes of those that it may take, so that all features succeed most likely together.

Errors that stay move all features at once: postures that err alike fail together, and succeed together. So what is best
for each feature alone is only one of the combinations that are tried; the others begin with one posture and take for
every other feature the one that is most like it, or the one that goes best with those before. Then postures are
exchanged one at a time for as long as that helps.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from posture_opt.numerics import TURN, Array, Codes, Mask

_EXCHANGED_STARTS = 2  # combinations, the best ones, in which postures are exchanged
_MAX_SWEEPS = 8


@dataclass(frozen=True)
class Branches:
    """What one feature may do at one placement.

    Args:
        Q: (B, n) postures.
        success: (B, N) probability given each draw of the errors that stay.
        log_miss: (B,) of the posture alone.
        extra: (B,) further terms of the objective.
    """

    Q: Array
    success: Array
    log_miss: Array
    extra: Array


def combination_losses(p_all: Array, log_miss: Array, extra: Array) -> Array:
    """(S,) ``log(−log P) + Σ e_k/K`` of combinations of K postures, as `combined_numbers` where errors are independent.

    Averages of draws say nothing where P is nearly 1: there it is kept within what the single probabilities allow,
    ``max_k m_k ≤ 1 − P ≤ Σ m_k``.

    Args:
        p_all: (S,) averages over the draws; ``log_miss`` and ``extra`` (S, K).
    """
    miss = np.exp(np.minimum(log_miss, -1e-9))
    least, most = miss.max(axis=1), miss.sum(axis=1)
    slight = 1e-9 * np.prod(1 - miss, axis=1)  # where no draw succeeds, products are compared
    loss = np.clip(1 - p_all, least, np.maximum(np.minimum(most, 1 - slight), least))
    return np.asarray(np.log(-np.log1p(-np.minimum(loss, 1 - 1e-300))) + extra.mean(axis=1))


def best_combination(features: Sequence[Branches], revolute: Mask) -> tuple[Codes, float]:
    """(K,) which posture each feature takes, and the loss of the combination.

    Args:
        revolute: (n,) joints for which whole turns make no difference.
    """
    starts = np.vstack([
        [int(np.argmin(f.log_miss + f.extra)) for f in features], _families(features, revolute), _greedy(features),
    ])  # fmt: skip
    starts = np.unique(starts, axis=0)
    losses = _losses(features, starts)
    chosen = np.argsort(losses, kind="stable")[:_EXCHANGED_STARTS]
    ends = [_exchanged(features, starts[s], float(losses[s])) for s in chosen]
    return min(ends, key=lambda end: end[1])


def _losses(features: Sequence[Branches], chosen: Codes) -> Array:
    """(S,) losses of the combinations ``chosen`` (S, K)."""
    product = np.ones((len(chosen), features[0].success.shape[1]))
    for feature, picks in zip(features, chosen.T, strict=True):
        product = product * feature.success[picks]
    of_each: list[Callable[[Branches], Array]] = [lambda f: f.log_miss, lambda f: f.extra]
    log_miss, extra = (
        np.column_stack([part(f)[picks] for f, picks in zip(features, chosen.T, strict=True)]) for part in of_each
    )
    return combination_losses(product.mean(axis=1), log_miss, extra)


def _families(features: Sequence[Branches], revolute: Mask) -> Codes:
    """(S, K) for each posture of each feature the ones of the others that are nearest to it: one branch for all."""
    rows = []
    for seed in features:
        columns = []
        for other in features:
            away = seed.Q[:, None] - other.Q
            away = np.where(revolute, away - TURN * np.rint(away / TURN), away)
            columns.append(np.argmin(np.sum(away**2, axis=2), axis=1))
        rows.append(np.column_stack(columns))
    return np.vstack(rows)


def _greedy(features: Sequence[Branches]) -> Codes:
    """(S, K) from each posture of the hardest feature on the ones that go best with those before, hardest first."""
    order = np.argsort([-float(f.log_miss.min()) for f in features], kind="stable")
    chosen = np.zeros((len(features[order[0]].Q), len(features)), dtype=int)
    chosen[:, order[0]] = np.arange(len(chosen))
    product = features[order[0]].success
    for k in order[1:]:
        chosen[:, k] = np.argmax(product @ features[k].success.T, axis=1)
        product = product * features[k].success[chosen[:, k]]
    return chosen


def _exchanged(features: Sequence[Branches], chosen: Codes, loss: float) -> tuple[Codes, float]:
    """A combination with its postures exchanged one at a time, for as long as that makes its loss smaller."""
    success, log_miss, extra = (
        np.array([getattr(f, name)[b] for f, b in zip(features, chosen, strict=True)])
        for name in ("success", "log_miss", "extra")
    )
    for _ in range(_MAX_SWEEPS):
        before = loss
        for k, feature in enumerate(features):
            others = np.prod(np.delete(success, k, axis=0), axis=0)
            misses, extras = (np.tile(row, (len(feature.Q), 1)) for row in (log_miss, extra))
            misses[:, k], extras[:, k] = feature.log_miss, feature.extra
            losses = combination_losses(feature.success @ others / len(others), misses, extras)
            b = int(np.argmin(losses))
            if losses[b] < loss:
                loss, chosen = float(losses[b]), np.where(np.arange(len(chosen)) == k, b, chosen)
                success[k], log_miss[k], extra[k] = feature.success[b], feature.log_miss[b], feature.extra[b]
        if loss >= before:
            break
    return chosen, loss
