"""Candidates of a diagnosis, their columns and score tests, and the linearised data that they explain."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from posture_opt.calibration.assumptions.instrument import position_sigma
from posture_opt.calibration.calibration import Calibration
from posture_opt.calibration.estimation.effect_sensitivities import EffectSensitivities, case_of
from posture_opt.calibration.estimation.least_squares import triangular_factor
from posture_opt.diagnosis.scores import levels
from posture_opt.diagnosis.scores.score_tests import (
    NullDistribution,
    ProjectedBaseline,
    beyond_limits,
    explained_squares,
    fitted_sizes,
    log_p,
    orthonormal_basis,
    projected_basis,
    scan_frequencies,
)
from posture_opt.diagnosis.scores.unnamed_components import UnnamedComponent, unnamed_components
from posture_opt.measurements.measurements import Measurements
from posture_opt.model.effects import EFFECTS, CyclicError, Effect, Excitation
from posture_opt.model.effects.cyclic_error import OVERSAMPLING
from posture_opt.numerics import Array, Codes


@dataclass(frozen=True, eq=False)
class ColumnPlace:
    """Place of a candidate's columns in a ``block`` (candidates, k, m) of several, single precision."""

    block: Array
    index: int


@dataclass(frozen=True, eq=False)
class Candidate:
    """An effect or an unnamed component that may explain the residuals.

    Args:
        Z: (m, k) whitened residual per unit of each parameter [1/SI].
        searched: how many different shapes its own was chosen from.
        place: where its columns are in blocks, if they are.
        most: sum of squares that it can explain at the most; infinite where its size is not limited.
    """

    what: Effect | UnnamedComponent
    Z: Array
    searched: float = 1.0
    place: ColumnPlace | None = None
    most: float = np.inf

    @property
    def named(self) -> bool:
        return isinstance(self.what, Effect)

    @property
    def detached(self) -> Candidate:
        return self if self.place is None else replace(self, Z=self.Z.copy(), place=None)

    @property
    def without_columns(self) -> Candidate:
        """Without any residual, where only what it is matters from now on."""
        return replace(self, Z=np.zeros((0, self.Z.shape[1])), place=None)

    @property
    def persistent(self) -> bool:
        """Whether it has a name, and outlasts the session that was measured."""
        return self.what.for_planning

    @property
    def kind(self) -> str:
        return self.what.kind

    @property
    def target(self) -> str:
        return self.what.target

    @property
    def family(self) -> str:
        return self.what.family

    @property
    def key(self) -> tuple[str, str]:
        """Kind and target: of all shapes the best one is kept."""
        return self.kind, self.target


@dataclass(frozen=True, eq=False)
class ScoredCandidate:
    """A candidate with its F test given a projected baseline.

    Args:
        rho: share of its length that the baseline leaves.
        log_p: natural logarithm of the p-value of its F test alone, ``p_value`` family-wise of all candidates.
        share: of the sum of squares that it explains.
    """

    candidate: Candidate
    rho: float
    log_p: float
    p_value: float
    share: float


def list_candidates(
    sensitivities: EffectSensitivities, excitation: Excitation, G: Array, instrument: float = np.inf
) -> list[Candidate]:
    """Every candidate but the cyclic errors, one for each shape of its grid.

    Args:
        instrument: σ of a measured coordinate as stated, in σ of the residuals; infinite where none is.
    """
    effects = [e for kind in EFFECTS for e in kind.candidates(excitation)]
    if "masses" not in excitation.inputs:
        effects += point_mass_effects(sensitivities, excitation, G)
    keep = _column_keeper(len(sensitivities.residuals.data))
    coordinates = len(sensitivities.residuals.data) * len(sensitivities.residuals.axes)
    named = [
        keep(Candidate(e, sensitivities.columns(e), most=coordinates * (e.largest_shift * instrument) ** 2))
        for e in effects
        if e.acts(sensitivities.state)
    ]
    shapes: dict[tuple[str, str], list[Array]] = {}
    for s in named:
        shapes.setdefault(s.key, []).append(s.Z)
    # A fitted shape is a parameter too: it counts as eight at the least.
    searched = {key: max(effective_number(own), min(len(own), 8.0)) for key, own in shapes.items()}
    unnamed = [keep(Candidate(u, Z)) for u, Z in unnamed_components(sensitivities, excitation)]
    grids = Counter(s.key for s in unnamed)
    return [replace(s, searched=(searched if s.named else grids)[s.key]) for s in (*named, *unnamed)]


def _column_keeper(rows: int) -> Callable[[Candidate], Candidate]:
    """Keeps columns of many rows in blocks of 64 candidates, once and in single precision: they are most of memory.

    Seven digits are enough: what is chosen is fitted anew, from columns of its own.
    """
    if rows < levels.MANY_ROWS:
        return lambda candidate: candidate
    open_: dict[object, ColumnPlace] = {}

    def keep(candidate: Candidate) -> Candidate:
        k = candidate.Z.shape[1]
        key = candidate.named, candidate.persistent, k
        last = open_.get(key)
        if last is None or last.index + 1 == len(last.block):
            last = ColumnPlace(np.empty((64, k, len(candidate.Z)), dtype=np.float32), -1)
        place = open_[key] = ColumnPlace(last.block, last.index + 1)
        place.block[place.index] = candidate.Z.T
        return replace(candidate, Z=place.block[place.index].T, place=place)

    return keep


def effective_number(shapes: Sequence[Array]) -> float:
    """Effective number of the shapes (each (m, k)) of one effect: ``(Σ √λ)² / Σ λ``.

    λ are the eigenvalues of the correlation of their first columns (Galwey 2009), of 50 shapes at the most.

    Example:
        >>> import numpy as np
        >>> same = np.ones((3, 1))
        >>> effective_number([same, same]), effective_number([np.eye(3)[:, [0]], np.eye(3)[:, [1]]])
        (1.0, 2.0)
    """
    if len(shapes) == 1:
        return 1.0
    first = np.stack([Z[:, 0] for Z in shapes[:: -(-len(shapes) // 50)]], axis=1)
    norms = np.linalg.norm(first, axis=0)
    first = first / np.where(norms > 0, norms, 1.0)
    values = np.maximum(np.linalg.eigvalsh(first.T @ first), 0.0)
    return float(np.sum(np.sqrt(values)) ** 2 / max(np.sum(values), 1e-300))


def point_mass_effects(sensitivities: EffectSensitivities, excitation: Excitation, G: Array) -> list[Effect]:
    """Compliances of joints, links and base of arms whose masses are not stated: unknown point masses at frames beyond.

    Frames that load alike, as those of a wrist do, count once; of links and base those too that act as geometry does.

    Args:
        G: (m, k) columns of the geometry.
    """
    geometry = orthonormal_basis(G)
    least = 1e-6 * max((float(np.linalg.norm(lever)) for lever in sensitivities.joints), default=0.0)
    effects: list[Effect] = []
    for bare, frames in (one for kind in EFFECTS for one in kind.unknown_loads(excitation)):
        points: tuple[str, ...] = ()
        for frame in frames:
            Z = sensitivities.columns(bare.model_copy(update={"points": (*points, frame)}))
            if np.linalg.norm(Z[:, -1]) > least and _loads_distinct(Z, geometry if bare.less_likely else None):
                points = (*points, frame)
        effects += [bare.model_copy(update={"points": points})] if points else []
    return effects


def _loads_distinct(Z: Array, geometry: Array | None) -> bool:
    """Whether columns Z (m, k) of loads are no mixtures of each other, and the last none of a basis and the others."""
    Z = Z / np.maximum(np.linalg.norm(Z, axis=0), 1e-300)
    # Ablation A: 0.2 raises the held-out RMS of kuka_14 from 0.159 to 0.241 mm, 0.01 lowers that of the WAM by 2 %.
    if np.linalg.svd(Z, compute_uv=False)[-1] <= 0.05:
        return False
    if geometry is None:
        return True
    rest = Z - geometry @ (geometry.T @ Z)
    others = np.linalg.qr(rest[:, :-1])[0]
    last = rest[:, -1] - others @ (others.T @ rest[:, -1])
    return float(last @ last) > levels.MIN_DISTINCT_SHARE


def score_candidates(
    baseline: ProjectedBaseline,
    candidates: Sequence[Candidate],
    sensitivities: EffectSensitivities,
    lines: Sequence[Lines],
) -> tuple[list[ScoredCandidate], NullDistribution]:
    """The best shape of every kind and target given a baseline, the least p-value first, and the null distribution.

    Every candidate is a score test (Rao 1948): an F test of its columns on the residuals that the baseline leaves. The
    null distribution is that of the least p-value in data sets whose residuals have the signs of whole poses flipped
    (Winkler et al. 2014).
    """
    rho, sizes, gains = explained_squares(baseline, [s.Z for s in candidates])
    alive = np.flatnonzero(sizes)
    offered, rho, sizes = [candidates[int(i)] for i in alive], rho[alive], sizes[alive]
    gains = _within_limits(baseline, offered, gains[alive])
    rss = baseline.rss
    values = log_p(gains[:, 0], rss[0], sizes, baseline.freedom)
    cyclic, lowest = _cyclic_candidates(baseline, sensitivities, lines)
    families = np.array([candidate.what.family for candidate in offered])
    least = {
        family: _least_log_p(gains[families == family], sizes[families == family], baseline)
        for family in levels.FAMILY_SHARES
    }
    least[CyclicError.family] = np.minimum(least[CyclicError.family], lowest)
    null = NullDistribution(least)

    def scored(candidate: Candidate, left: float, p: float, gain: float) -> ScoredCandidate:
        share = gain / float(rss[0]) if rss[0] > 0 else 0.0
        return ScoredCandidate(candidate, left, p, null.family_wise(p, candidate.what.family), share)

    best: dict[tuple[str, str], int] = {}
    for row, candidate in enumerate(offered):
        if values[row] < values[best.setdefault(candidate.key, row)]:
            best[candidate.key] = row
    found = [scored(offered[i], float(rho[i]), float(values[i]), float(gains[i, 0])) for i in best.values()]
    for candidate, p in cyclic:
        basis, left = projected_basis(baseline, candidate.Z)
        if basis.shape[1]:
            found.append(scored(candidate, left, p, float(np.sum((basis.T @ baseline.e) ** 2))))
    return sorted(found, key=lambda j: (j.p_value, j.log_p)), null


def _within_limits(baseline: ProjectedBaseline, candidates: Sequence[Candidate], gains: Array) -> Array:
    """``gains`` (candidates, 1 + B) without those whose estimate is beyond the physical limits of the parameters."""
    gains = np.where(gains > np.array([c.most for c in candidates])[:, None], 0.0, gains) if candidates else gains
    for row, candidate in enumerate(candidates):
        if np.isfinite(candidate.what.limits).any():
            Z = baseline.project(candidate.Z)
            sizes, errors = fitted_sizes(Z.T @ Z, Z.T @ baseline.flipped, baseline.rss / max(baseline.freedom, 1))
            gains[row, np.any(beyond_limits(sizes, errors, *candidate.what.limits), axis=0)] = 0.0
    return gains


def absorbed_candidates(
    baseline: ProjectedBaseline, candidates: Sequence[Candidate], scored: Sequence[ScoredCandidate]
) -> tuple[tuple[Candidate, float], ...]:
    """Named candidates that the baseline absorbs, one of each kind and target, with the share ρ that is left of it."""
    known = {j.candidate.key for j in scored}
    found: dict[tuple[str, str], tuple[Candidate, float]] = {}
    for candidate in candidates:
        if candidate.named and candidate.key not in known:
            found.setdefault(candidate.key, (candidate, projected_basis(baseline, candidate.Z)[1]))
    return tuple(found.values())


def _least_log_p(gains: Array, sizes: Codes, baseline: ProjectedBaseline) -> Array:
    """The least log p-value (B,) of each flipped data set over candidates; 0 without candidates.

    Of candidates of one size, the one that explains most has it.
    """
    rss = baseline.rss[1:]
    least = np.zeros(len(rss))
    for size in np.unique(sizes).tolist():
        least = np.minimum(least, log_p(gains[sizes == size, 1:].max(axis=0), rss, size, baseline.freedom))
    return least


@dataclass(frozen=True, eq=False)
class Lines:
    """The lines of one joint that its values resolve: frequencies at which its error may repeat.

    Args:
        form: any of them; the others have its joint and centre.
        cycles: (K,) evenly spaced [cycles per revolution].
    """

    form: CyclicError
    cycles: Array

    @property
    def least_distance(self) -> float:
        """Distance [cycles per revolution] within which lines are one: half of what the range of a joint resolves."""
        return 1.5 * float(np.diff(self.cycles[:2]).sum())

    def candidate(self, cycles: float, sensitivities: EffectSensitivities) -> Candidate:
        line = self.form.with_shape(float(cycles))
        return Candidate(line, sensitivities.columns(line), len(self.cycles) / OVERSAMPLING)


def lines_of_joints(excitation: Excitation, data: Measurements) -> tuple[Lines, ...]:
    """The lines of each revolute joint that moves by 1 mrad or more."""
    found: list[Lines] = []
    for joint, name in enumerate(excitation.robot.joint_names):
        if excitation.robot.joints[joint].type == "revolute" and excitation.span[joint] >= 1e-3:
            cycles = CyclicError.resolved(data.q[:, joint])
            found += [Lines(CyclicError.about(name, data.q[:, joint]), cycles)] if len(cycles) else []
    return tuple(found)


def _cyclic_candidates(
    baseline: ProjectedBaseline, sensitivities: EffectSensitivities, lines_of_all: Sequence[Lines]
) -> tuple[list[tuple[Candidate, float]], Array]:
    """Four peaks of each joint's periodogram with their log p-values, and the least (B,) of flipped sets."""
    rss, data = baseline.rss, sensitivities.residuals.data
    lowest = np.zeros(len(rss) - 1)
    found: list[tuple[Candidate, float]] = []
    for lines in lines_of_all:
        joint = data.joint_names.index(lines.form.joint)
        gains, most = scan_frequencies(baseline, sensitivities.joints[joint], data.q[:, joint], lines.cycles)
        lowest = np.minimum(lowest, log_p(most, rss[1:], 2, baseline.freedom))
        rising, falling = np.r_[True, gains[1:] >= gains[:-1]], np.r_[gains[:-1] >= gains[1:], True]
        peaks = np.flatnonzero(rising & falling)
        for k in peaks[np.argsort(-gains[peaks])][:4]:
            p = float(log_p(gains[k : k + 1], rss[:1], 2, baseline.freedom)[0])
            found.append((lines.candidate(lines.cycles[k], sensitivities), p))
    return found, lowest


@dataclass(frozen=True, eq=False)
class LinearisedData:
    """The residuals of a calibrated arm with the sensitivities that could explain them: ``r ≈ G x + Z θ + noise``.

    Args:
        r: (m,) whitened residuals [1].
        G: (m, k) columns of the geometry that the data determine.
        groups: (m,) the pose of every residual, whose signs are flipped together.
    """

    sensitivities: EffectSensitivities
    excitation: Excitation
    r: Array
    G: Array
    groups: Codes
    flips: int = 299
    seed: int = 0
    count: int = 0
    instrument: float = np.inf

    @cached_property
    def lines(self) -> tuple[Lines, ...]:
        """The lines of each revolute joint that its values resolve."""
        return lines_of_joints(self.excitation, self.sensitivities.residuals.data)

    def columns(self, members: Sequence[Candidate]) -> tuple[Array, list[slice]]:
        """Columns (m, K) of the geometry and some members, and which of them each member has."""
        edges = np.cumsum([self.G.shape[1], *(s.Z.shape[1] for s in members)]).tolist()
        return np.concatenate([self.G, *(s.Z for s in members)], axis=1), [slice(a, b) for a, b in pairwise(edges)]

    def baseline(self, chosen: Sequence[Candidate] = (), flips: int | None = None) -> ProjectedBaseline:
        """The geometry and the chosen candidates projected off the residuals."""
        flips = self.flips if flips is None else flips
        return ProjectedBaseline.of(self.r, self.columns(chosen)[0], self.groups, flips, self.seed, self.count)

    def reduced(self, members: Sequence[Candidate]) -> tuple[LinearisedData, list[Candidate]]:
        """Data and members in coordinates of the space that geometry and members span, and one for all outside it."""
        columns, places = self.columns(members)
        R = triangular_factor(np.concatenate([columns, self.r[:, None]], axis=1))
        r, R = R[:, -1], R[:, :-1]
        parts = [replace(s, Z=R[:, own]) for s, own in zip(members, places, strict=True)]
        groups = np.zeros(len(r), dtype=np.intp)
        count = self.count or len(self.r)
        return replace(self, r=r, G=R[:, : self.G.shape[1]], groups=groups, flips=0, count=count), parts


def linearise_calibration(calibration: Calibration, flips: int = 299, seed: int = 0) -> LinearisedData:
    """The residuals of a calibrated arm, without its outliers, about its estimate."""
    kept = calibration.kept_rows
    residuals = calibration.residuals.take(kept)
    r, J = residuals.residuals_and_jacobian(calibration.x)
    sensitivities = EffectSensitivities(residuals, calibration.x)
    poses = np.repeat(np.unique(residuals.data.pose, return_inverse=True)[1], residuals.block)
    apart = len(poses) + np.arange(len(residuals.distances))  # no two known distances err together
    groups = np.unique(np.concatenate([poses, apart]), return_inverse=True)[1]
    G = J @ calibration.identifiability.directions
    stated = position_sigma(calibration.request.problem, residuals.data)
    excitation = case_of(residuals.data, residuals.robot)
    return LinearisedData(
        sensitivities, excitation, r, G, groups, flips, seed,
        instrument=stated / residuals.sigma if stated else np.inf,
    )  # fmt: skip
