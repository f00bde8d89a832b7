"""The candidates of a diagnosis: named effects and unnamed components, with their columns and their score tests."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from posture_opt.calibration.estimation.effect_sensitivities import EffectSensitivities
from posture_opt.diagnosis.scores import levels
from posture_opt.diagnosis.scores.column_blocks import ColumnPlace, ColumnStore
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

_MIN_JOINT_RANGE_RAD = 1e-3  # rad: a joint that moves by less shows no line


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
        """Whether it is an effect of the catalogue."""
        return isinstance(self.what, Effect)

    @property
    def detached(self) -> Candidate:
        """The same with columns of its own, so that the blocks in which it is kept can be freed."""
        return self if self.place is None else replace(self, Z=self.Z.copy(), place=None)

    @property
    def compact(self) -> Candidate:
        """The same with columns in single precision, as those of a dictionary of many rows are."""
        return replace(self, Z=self.Z.astype(np.float32, copy=False))

    @property
    def without_columns(self) -> Candidate:
        """The same without any residual, where only what it is matters from now on."""
        return replace(self, Z=np.zeros((0, self.Z.shape[1])), place=None)

    @property
    def persistent(self) -> bool:
        """Whether it has a name, and outlasts the session that was measured."""
        return isinstance(self.what, Effect) and self.what.for_planning

    @property
    def kind(self) -> str:
        """The name of its kind in files."""
        return self.what.kind

    @property
    def target(self) -> str:
        """What it acts on: a joint, ``base``, ``linear`` …"""
        return self.what.target

    @property
    def family(self) -> str:
        """The family of tests that it belongs to."""
        return self.what.family if isinstance(self.what, Effect) else levels.UNNAMED_FAMILY

    @property
    def specific(self) -> bool:
        """Whether it has a name, and a shape of its own."""
        return isinstance(self.what, Effect) and not self.what.flexible

    @property
    def key(self) -> tuple[str, str]:
        """Kind and target: of all shapes the best one is kept."""
        return self.kind, self.target

    @property
    def exclusive(self) -> object:
        """Candidates that have it in common are shapes of one effect, of which a model holds one."""
        return self.what.exclusive


@dataclass(frozen=True, eq=False)
class ScoredCandidate:
    """A candidate with its F test given a projected baseline.

    ``p_value`` counts all candidates of all families; ``log_p`` is of this one alone, as if no other had been tried.

    Args:
        rho: share of its length that the baseline leaves.
        log_p: natural logarithm of the p-value of its F test alone.
        p_value: family-wise, by the null distribution of all candidates.
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

    A kind that depends on a shape (a period, a time constant, a moment) has one candidate for each shape of its grid;
    ``searched`` is the effective number of them, which the criterion charges for.

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
    searched = {
        key: max(effective_number(own), min(len(own), levels.MIN_SEARCHED_SHAPES)) for key, own in shapes.items()
    }
    unnamed = [keep(Candidate(u, Z)) for u, Z in unnamed_components(sensitivities, excitation)]
    grids = Counter(s.key for s in unnamed)
    return [
        *(replace(s, searched=searched[s.key]) for s in named),
        *(replace(s, searched=grids[s.key]) for s in unnamed),
    ]


def _column_keeper(rows: int) -> Callable[[Candidate], Candidate]:
    """Keeps the columns of candidates of many rows in blocks: twice in memory, they would be most of it."""
    if rows < levels.MANY_ROWS:
        return lambda candidate: candidate
    store = ColumnStore()

    def keep(candidate: Candidate) -> Candidate:
        place = store.keep((candidate.named, candidate.persistent), candidate.Z)
        return replace(candidate, Z=place.columns, place=place)

    return keep


def effective_number(shapes: Sequence[Array]) -> float:
    """The effective number of the shapes (each (m, k)) of one effect: ``(Σ √λ)² / Σ λ``.

    λ are the eigenvalues of the correlation of their first columns (Galwey 2009): neighbouring moments of a slip or
    time constants of a drift say nearly the same.

    Example:
        >>> import numpy as np
        >>> same = np.ones((3, 1))
        >>> effective_number([same, same]), effective_number([np.eye(3)[:, [0]], np.eye(3)[:, [1]]])
        (1.0, 2.0)
    """
    if len(shapes) == 1:
        return 1.0
    first = np.stack([Z[:, 0] for Z in shapes[:: -(-len(shapes) // levels.MAX_COMPARED_SHAPES)]], axis=1)
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
    """Whether columns Z (m, k) of loads are no mixtures of each other, and the last none of a basis and the others.

    Args:
        geometry: (m, r) orthonormal basis; None where only the loads are compared.
    """
    Z = Z / np.maximum(np.linalg.norm(Z, axis=0), 1e-300)
    if np.linalg.svd(Z, compute_uv=False)[-1] <= levels.MIN_MASS_SINGULAR_VALUE:
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

    Args:
        lines: of all joints; they are scored by one periodogram each, and the highest peaks become candidates.

    Returns:
        Scored candidates, and the null distribution for those that are scored later.
    """
    rho, sizes, gains = explained_squares(baseline, [s.Z for s in candidates])
    alive = [int(i) for i in np.flatnonzero(sizes)]
    sizes, gains = sizes[alive], _within_limits(baseline, [candidates[i] for i in alive], gains[alive])
    rss = baseline.rss
    values = log_p(gains[:, 0], rss[0], sizes, baseline.freedom)
    cyclic, lowest = _cyclic_candidates(baseline, sensitivities, lines)
    families = np.array([candidates[i].family for i in alive])
    least = {
        family: _least_log_p(gains[families == family], sizes[families == family], baseline)
        for family in levels.FAMILY_SHARES
    }
    least[CyclicError.family] = np.minimum(least[CyclicError.family], lowest)
    null = NullDistribution(least)
    found: dict[tuple[str, str], ScoredCandidate] = {}
    for row, i in enumerate(alive):
        p, candidate = float(values[row]), candidates[i]
        if candidate.key not in found or p < found[candidate.key].log_p:
            share = float(gains[row, 0] / rss[0]) if rss[0] > 0 else 0.0
            found[candidate.key] = ScoredCandidate(
                candidate, float(rho[i]), p, null.family_wise(p, candidate.family), share
            )
    scored = list(found.values())
    for candidate, p in cyclic:
        basis, left = projected_basis(baseline, candidate.Z)
        if basis.shape[1]:
            share = float(np.sum((basis.T @ baseline.e) ** 2) / rss[0]) if rss[0] > 0 else 0.0
            scored.append(ScoredCandidate(candidate, left, p, null.family_wise(p, candidate.family), share))
    return sorted(scored, key=lambda j: (j.p_value, j.log_p)), null


def _within_limits(baseline: ProjectedBaseline, candidates: Sequence[Candidate], gains: Array) -> Array:
    """``gains`` (candidates, 1 + B) without those whose estimate is beyond the physical limits of the parameters."""
    gains = np.where(gains > np.array([c.most for c in candidates])[:, None], 0.0, gains) if candidates else gains
    for row, candidate in enumerate(candidates):
        low, high = candidate.what.limits if isinstance(candidate.what, Effect) else (-np.inf, np.inf)
        if np.isfinite(low) or np.isfinite(high):
            Z = baseline.project(candidate.Z)
            sizes, errors = fitted_sizes(Z.T @ Z, Z.T @ baseline.flipped, baseline.rss / max(baseline.freedom, 1))
            gains[row, np.any(beyond_limits(sizes, errors, low, high), axis=0)] = 0.0
    return gains


def absorbed_candidates(
    baseline: ProjectedBaseline, candidates: Sequence[Candidate], scored: Sequence[ScoredCandidate]
) -> tuple[tuple[Candidate, float], ...]:
    """Named candidates that the baseline absorbs, one of each kind and target, with the share ρ that is left of it.

    Returns:
        Their share is below `levels.MIN_SURVIVING_SHARE`: whatever their size, geometry explains the data as well.
    """
    known = {j.candidate.key for j in scored}
    found: dict[tuple[str, str], tuple[Candidate, float]] = {}
    for candidate in candidates:
        if candidate.named and candidate.key not in known:
            found.setdefault(candidate.key, (candidate, projected_basis(baseline, candidate.Z)[1]))
    return tuple(found.values())


def _least_log_p(gains: Array, sizes: Codes, baseline: ProjectedBaseline) -> Array:
    """The least log p-value (B,) of each flipped data set over candidates; 0 without candidates.

    Of candidates of one size, the one that explains most has it.

    Args:
        gains: (candidates, 1 + B) sums of squares that they explain; sizes: (candidates,) by how many directions.
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
    def searched(self) -> float:
        """How many of the frequencies are independent."""
        return len(self.cycles) / OVERSAMPLING

    @property
    def least_distance(self) -> float:
        """Lines nearer than that are one line [cycles per revolution]."""
        return levels.MIN_LINE_DISTANCE * float(np.diff(self.cycles[:2]).sum())

    def candidate(self, cycles: float, sensitivities: EffectSensitivities) -> Candidate:
        """The line of so many cycles per revolution: a sine and a cosine of the joint value about its centre."""
        line = self.form.with_shape(float(cycles))
        return Candidate(line, sensitivities.columns(line), self.searched)


def lines_of_joints(excitation: Excitation, data: Measurements) -> tuple[Lines, ...]:
    """The lines of each revolute joint that has some."""
    found: list[Lines] = []
    for joint, name in enumerate(excitation.robot.joint_names):
        if excitation.robot.joints[joint].type == "revolute" and excitation.span[joint] >= _MIN_JOINT_RANGE_RAD:
            cycles = CyclicError.resolved(data.q[:, joint])
            found += [Lines(CyclicError.about(name, data.q[:, joint]), cycles)] if len(cycles) else []
    return tuple(found)


def _cyclic_candidates(
    baseline: ProjectedBaseline, sensitivities: EffectSensitivities, lines_of_all: Sequence[Lines]
) -> tuple[list[tuple[Candidate, float]], Array]:
    """Peaks of the joints' periodograms with their log p-values, and the least log p-value (B,) of flipped sets."""
    rss, data = baseline.rss, sensitivities.residuals.data
    lowest = np.zeros(len(rss) - 1)
    found: list[tuple[Candidate, float]] = []
    for lines in lines_of_all:
        joint = data.joint_names.index(lines.form.joint)
        gains, most = scan_frequencies(baseline, sensitivities.joints[joint], data.q[:, joint], lines.cycles)
        lowest = np.minimum(lowest, log_p(most, rss[1:], 2, baseline.freedom))
        for k in _highest_peaks(gains):
            p = float(log_p(gains[k : k + 1], rss[:1], 2, baseline.freedom)[0])
            found.append((lines.candidate(lines.cycles[k], sensitivities), p))
    return found, lowest


def _highest_peaks(gains: Array) -> list[int]:
    """Indices of the highest local maxima."""
    left = np.r_[True, gains[1:] >= gains[:-1]]
    right = np.r_[gains[:-1] >= gains[1:], True]
    peaks = np.flatnonzero(left & right)
    return [int(k) for k in peaks[np.argsort(-gains[peaks])][: levels.PERIODOGRAM_PEAKS]]
