"""What could replace the members of a set: rivals by the criterion, aliases of lines, and what is not refuted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from posture_opt.diagnosis.scores import levels
from posture_opt.diagnosis.scores.candidates import Candidate, LinearisedData, ScoredCandidate
from posture_opt.diagnosis.scores.score_tests import ProjectedBaseline, projected_basis, scan_frequencies
from posture_opt.diagnosis.scores.subset_selection import Chosen, Pool, close_alternatives
from posture_opt.diagnosis.search.selection_criterion import (
    beyond_instrument,
    candidate_pool,
    implausible_members,
    merged_candidates,
)
from posture_opt.model.effects import CyclicError, Effect
from posture_opt.model.effects.cyclic_error import OVERSAMPLING
from posture_opt.numerics import Array, Codes

Rivals = tuple[tuple[Candidate, ...], ...]


def find_rivals(
    linearised: LinearisedData,
    baseline: ProjectedBaseline,
    shortlisted: Sequence[Candidate],
    chosen: Sequence[Candidate],
) -> Rivals:
    """For each chosen candidate those that explain as much in its place, and the aliases of its first line.

    As much is within `levels.RIVAL_CRITERION`, also were parameters charged less; of a persistent effect those of the
    session at its price, and vice versa, as that decides what is delivered; and names that alone explain as much as all
    members together.
    """
    if not chosen:
        return ()
    every = merged_candidates(shortlisted, chosen)
    pool = candidate_pool(baseline, every)
    place = {str(s.what): i for i, s in enumerate(every)}
    members = tuple(sorted(place[str(s.what)] for s in chosen))
    few = pool.columns.sizes <= levels.LARGE_GROUP_SIZE
    named, persistent = (np.array([getattr(s, name) for s in every]) for name in ("named", "persistent"))
    # A parameter at 2 in place of log m (Akaike 1974): data have not refuted what only costs more.
    less = np.where(named & few, (np.log(pool.freedom) - 2.0) * pool.columns.sizes, 0.0)
    unlikely = np.array([levels.CHOICE_PENALTY * s.what.less_likely for s in every])
    lenient = replace(pool, penalty=pool.penalty - np.maximum(less, 0.0) - unlikely)
    criterion = pool.criterion(members)
    alone = pool.additions(()) if len(members) > 1 else []
    for_all = [(value - criterion, only[0]) for value, only in alone if named[only[0]]]
    for_all = [one for one in for_all if one[0] <= levels.RIVAL_CRITERION]
    found = []
    for i, s in enumerate(chosen):
        member = place[str(s.what)]
        other = named & few & (persistent != persistent[member])
        cheap = replace(pool, penalty=np.where(other, np.minimum(pool.penalty, pool.penalty[member]), pool.penalty))
        close = close_alternatives((pool, lenient, cheap), members, member, levels.RIVAL_CRITERION)
        own = _best_shapes(pool, every, member, [k for _, k in sorted([*close, *for_all])])
        found.append((*own, *find_aliases(linearised, chosen, i)))
    return tuple(found)


def _best_shapes(pool: Pool, every: Sequence[Candidate], member: int, others: Chosen | list[int]) -> list[Candidate]:
    found: dict[object, Candidate] = {}
    for k in others:
        if pool.alike(member, k) > levels.MIN_RIVAL_COSINE and every[k].key != every[member].key:
            found.setdefault(every[k].what.exclusive, every[k])
    found.pop(every[member].what.exclusive, None)
    return list(found.values())


def find_aliases(linearised: LinearisedData, chosen: Sequence[Candidate], i: int) -> tuple[Candidate, ...]:
    """Cyclic errors whose first line is elsewhere and explains as much: ``ν log(RSS / RSS')`` within the criterion.

    On values that are multiples of Δ, a line of k cycles per revolution and one of ``2π/Δ − k`` are the same column.
    All frequencies are searched, those too that the values of the joint do not resolve; the four slowest are listed.
    """
    error = chosen[i].what
    if not isinstance(error, CyclicError):
        return ()
    sensitivities = linearised.sensitivities
    data = sensitivities.residuals.data
    joint = data.joint_names.index(error.joint)
    first, rest = chosen[i].Z[:, :2], Candidate(error, chosen[i].Z[:, 2:])  # the first line, and the others
    baseline = linearised.baseline([*(s for k, s in enumerate(chosen) if k != i), rest], flips=0)
    own = float(np.sum((projected_basis(baseline, first)[0].T @ baseline.e) ** 2))
    q, lever = data.q[:, joint], sensitivities.joints[joint]
    cycles = CyclicError.grid(float(np.ptp(q)))
    gains = scan_frequencies(baseline, lever, q, cycles)[0]
    peaks = (gains >= np.r_[0.0, gains[:-1]]) & (gains >= np.r_[gains[1:], 0.0])
    step = float(np.diff(cycles[:2]).sum())
    apart = np.min(np.abs(cycles[:, None] - np.array(error.lines)), axis=1) > OVERSAMPLING * step
    found, total = [], float(baseline.rss[0])
    for k in np.flatnonzero(peaks & apart & (gains > 0.8 * own)):  # between two points of the grid it loses less
        near = cycles[k] + step * np.linspace(-0.5, 0.5, 21)
        finer = scan_frequencies(baseline, lever, q, near)[0]
        left = total - np.minimum([float(finer.max()), own], (1 - 1e-9) * total)
        if baseline.freedom * np.log(left[0] / left[1]) <= levels.RIVAL_CRITERION:
            found.append(error.with_shape(float(near[int(np.argmax(finer))])))
    return tuple(Candidate(other, sensitivities.columns(other), chosen[i].searched) for other in found[:4])


def unrefuted_rivals(
    linearised: LinearisedData,
    chosen: Sequence[Candidate],
    rivals: Rivals,
    scored: Sequence[ScoredCandidate],
    groups: Codes,
) -> dict[int, tuple[Effect, ...]]:
    """By its place among the chosen, further rivals of a named effect, which the data do not refute.

    The criterion takes residuals for independent noise; where structure is left, neighbours err alike, and what a rival
    loses in one part of the workspace says little of the others.

    Source: Vuong (1989), the likelihood ratio of models of which neither holds the other, both perhaps wrong; its
    variance from blocks of rows, within which residuals may be correlated (Cameron, Gelbach, Miller 2011).

    Args:
        groups: (N,) blocks of rows.
    """
    asked = [i for i, s in enumerate(chosen) if s.named and not isinstance(s.what, CyclicError)]
    others = _named_others(linearised, chosen, scored)
    if not asked or not others:
        return {}
    comparison = _Comparison.of(linearised, chosen, groups)
    apart = [other.Z - comparison.Q @ (comparison.Q.T @ other.Z) for other in others]
    found = {}
    for i in asked:
        have = {s.what.exclusive for s in rivals[i]}
        new = [(o, Z) for o, Z in zip(others, apart, strict=True) if o.what.exclusive not in have]
        likely = [other for other, Z in new if comparison.unrefuted(i, other.Z, Z)]
        swapped = ((s, [*chosen[:i], s, *chosen[i + 1 :]]) for s in likely)
        possible = (
            s.what
            for s, own in swapped
            if all(o is not s for o in (*beyond_instrument(linearised, own), *implausible_members(linearised, own)))
        )
        found[i] = tuple(what for what in possible if isinstance(what, Effect))
    return found


def _named_others(
    linearised: LinearisedData, chosen: Sequence[Candidate], scored: Sequence[ScoredCandidate]
) -> list[Candidate]:
    """The 40 effects of other kinds or places that explain most by themselves, the best shape of each."""
    known = {s.key for s in chosen}
    best: dict[object, Candidate] = {}
    for one in sorted(scored, key=lambda one: -one.share):
        effect = one.candidate.what
        if isinstance(effect, Effect) and not isinstance(effect, CyclicError) and one.candidate.key not in known:
            best.setdefault(effect.exclusive, replace(one.candidate, Z=linearised.sensitivities.columns(effect)))
    return list(best.values())[:40]


@dataclass(frozen=True, eq=False)
class _Comparison:
    """A model about to lose one member or the other.

    Args:
        Q: (m, p) orthonormal basis of geometry and members; e: (m,) what they leave of the residuals r (m,).
        directions: per member, orthonormal directions (m, k) that it alone brings.
        groups: (N,) blocks of rows, of ``block`` residuals each.
    """

    Q: Array
    e: Array
    r: Array
    directions: tuple[Array, ...]
    groups: Codes
    block: int

    @classmethod
    def of(cls, linearised: LinearisedData, members: Sequence[Candidate], groups: Codes) -> _Comparison:
        A, places = linearised.columns(members)
        lengths = np.linalg.norm(A, axis=0)
        Q, R = np.linalg.qr(A / np.where(lengths > 0, lengths, 1.0))
        # Of (AᵀA)⁻¹Aᵀ, row by row, each is orthogonal to all columns but its own.
        alone = Q @ np.linalg.pinv(R, rcond=1e-10).T
        directions = tuple(np.linalg.qr(alone[:, own])[0] for own in places)
        r = linearised.r
        return cls(Q, r - Q @ (Q.T @ r), r, directions, groups, linearised.sensitivities.residuals.block)

    def unrefuted(self, member: int, Z: Array, outside: Array) -> bool:
        """Whether columns Z (m, k), ``outside`` the model, resemble a member and explain no clearly less without it."""
        from scipy.special import stdtrit

        B = self.directions[member]
        basis, lengths, _ = np.linalg.svd(outside + B @ (B.T @ Z), full_matrices=False)
        basis = basis[:, lengths > 1e-10 * max(lengths[0], 1e-300)]
        if np.linalg.norm(B.T @ basis, 2) < levels.MIN_RIVAL_COSINE:
            return False
        without = self.e + B @ (B.T @ self.r)
        instead = without - basis @ (basis.T @ without)
        rows = len(self.groups) * self.block
        lost = (instead[:rows] ** 2 - self.e[:rows] ** 2).reshape(-1, self.block).sum(axis=1)
        by_group = np.bincount(np.unique(self.groups, return_inverse=True)[1], lost)
        # Student's 97.5 % quantile, by as many blocks, of the standard errors by which a refuted rival is worse.
        least = float(stdtrit(max(len(by_group) - 1, 1), 0.975))
        return float(lost.sum()) < least * float(np.linalg.norm(by_group))
