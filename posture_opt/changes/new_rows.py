"""What a few new rows say of a calibrated arm: every change to first order, and the evidence for it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from posture_opt.calibration.assumptions.frames import arm_and_data, fit_frames
from posture_opt.calibration.assumptions.instrument import relative_sigma
from posture_opt.calibration.estimation.parameters import Parameter
from posture_opt.calibration.estimation.residuals import Residuals
from posture_opt.experiments.possible_changes import FRAME_PARTS, PossibleChange, effects_of, possible_changes
from posture_opt.measurements.measurements import Measurements
from posture_opt.numerics import Array, Codes, stacked_rows
from posture_opt.selection.problem_data import ProblemData
from posture_opt.uncertainty.sources import Sources

NOISE_SPREAD = 0.2
# Noise over what instrument and scatter are stated as: known to 20 %.
NOISE_LEVELS = np.exp(NOISE_SPREAD * np.linspace(-2, 2, 7))


@dataclass(frozen=True, eq=False)
class GaussianRows:
    """Rows ``r = P u − A θ + ε``, u ~ N(0, I), ε ~ N(0, k² I), in coordinates in which ``k² I + P Pᵀ`` is diagonal.

    Args:
        r: (d,) residuals, model minus measurement; A: (d, K) derivatives of the model.
        e: (d,) eigenvalues of ``P Pᵀ``.
    """

    r: Array
    A: Array
    e: Array
    rest: float
    freedom: int

    @classmethod
    def of(cls, r: Array, P: Array, A: Array) -> GaussianRows:
        """From whitened rows (m,), (m, p) and (m, K)."""
        Q, R = np.linalg.qr(np.concatenate([P, A], axis=1))
        inside = Q.T @ r
        known = R[:, : P.shape[1]]
        e, U = np.linalg.eigh(known @ known.T)
        rest = max(float(r @ r - inside @ inside), 0.0)
        return cls(U.T @ inside, U.T @ R[:, P.shape[1] :], np.maximum(e, 0.0), rest, len(r) - len(inside))

    def log_densities(self, levels: Array) -> Array:
        """(L,) ``log p(r | θ = 0, k)`` at noise levels k (L,), but for the constant of the dimension."""
        variance = levels[:, None] ** 2 + self.e
        inside = np.sum(self.r**2 / variance + np.log(variance), axis=1)
        return np.asarray(-0.5 * (inside + self.rest / levels**2 + self.freedom * np.log(levels**2)))

    @cached_property
    def densities(self) -> Array:
        """(L,) at each noise level."""
        return self.log_densities(NOISE_LEVELS)

    @cached_property
    def normal(self) -> list[tuple[Array, Array]]:
        """``Aᵀ S⁻¹ A`` (K, K) and ``−Aᵀ S⁻¹ r`` (K,) under ``S = k² I + P Pᵀ``, at each noise level k."""
        weighted = [self.A / (level**2 + self.e)[:, None] for level in NOISE_LEVELS]
        return [(W.T @ self.A, -W.T @ self.r) for W in weighted]


@dataclass(frozen=True, eq=False)
class Estimate:
    """A Gaussian estimate: mean (p,) and covariance (p, p)."""

    mean: Array
    covariance: Array

    def of(self, W: Array) -> Estimate:
        """The estimate of ``W t``, t having this one."""
        return Estimate(W @ self.mean, W @ self.covariance @ W.T)

    @classmethod
    def mixture(cls, parts: Sequence[Estimate], weights: Array) -> Estimate:
        """Mean and covariance of a mixture, the spread of its parts' means included."""
        means = np.array([part.mean for part in parts])
        mean = weights @ means
        off = means - mean
        inner = sum(w * part.covariance for w, part in zip(weights, parts, strict=True))
        return cls(mean, np.asarray(inner + (off * weights[:, None]).T @ off))


@dataclass(frozen=True, eq=False)
class SizedChange:
    """The change ``t ~ N(0, s² I / p)`` of root mean square motion s: evidence and estimate for any s.

    Args:
        G: (p, p) ``Bᵀ S⁻¹ B`` of the columns B of t; b: (p,) ``−Bᵀ S⁻¹ r``.
    """

    G: Array
    b: Array

    @cached_property
    def spectrum(self) -> tuple[Array, Array, Array]:
        """(p,) eigenvalues of G, (p, p) its eigenvectors, (p,) b in them."""
        values, V = np.linalg.eigh(self.G)
        return np.maximum(values, 0.0), V, V.T @ self.b

    def estimate(self, size: float) -> Estimate:
        """Mean and covariance of t at one size [m]."""
        values, V, z = self.spectrum
        variance = 1.0 / (values + len(self.b) / size**2)
        return Estimate(V @ (variance * z), (V * variance) @ V.T)


def log_gains(values: Array, z: Array, sizes: Array) -> Array:
    """(…, S) ``Σ_j ½ (v z_j² / (1 + v λ_j) − log(1 + v λ_j))``, ``v = s²/p``, for eigenvalues λ (p,) and z (…, p)."""
    v = sizes[:, None] ** 2 / len(values)
    fit = np.sum(v * z[..., None, :] ** 2 / (1 + v * values), axis=-1)
    return np.asarray(0.5 * (fit - np.sum(np.log1p(v * values), axis=-1)))


def log_normalised(values: Array) -> Array:
    """Logarithms of probabilities that are proportional to ``exp v``."""
    return np.asarray(values - log_sum(values))


def log_sum(values: Array) -> float:
    """``log Σ exp v`` of numbers of any shape; −∞ of none."""
    if not np.size(values):
        return -np.inf
    top = float(np.max(values))
    return top + float(np.log(np.sum(np.exp(values - top)))) if np.isfinite(top) else -np.inf


_FRAMES = tuple(f"{frame}.{part}" for frame in ("base", "tool") for part in FRAME_PARTS)
_RANK_TOLERANCE = 1e-9


@dataclass(frozen=True, eq=False)
class NewRows:
    """Whitened residuals ``r = P u + A θ + ε`` of new rows, ε ~ N(0, k² I), u ~ N(0, I), θ what changed.

    Args:
        residuals: the arm against the rows, in all parameters; ``x`` (K,) those of the calibrated arm [rad, m].
        r: (m,) model minus measurement at the calibrated arm, in units of instrument and scatter of the arm.
        P: (m, p) what is uncertain of the calibrated arm, a standard deviation a column, and what is free.
        A: (m, K) derivatives by all parameters of ``residuals``.
        noise: (N, b, b) Cholesky factors of the covariance of each row.
    """

    problem: ProblemData
    residuals: Residuals
    x: Array
    r: Array
    P: Array
    A: Array
    changes: tuple[PossibleChange, ...]
    free: frozenset[str]
    noise: Array
    notes: tuple[str, ...]

    @classmethod
    def of(cls, problem: ProblemData, data: Measurements) -> NewRows:
        """The rows of ``data`` against the arm of a problem; free frames and touched points are fitted first."""
        residuals, notes = arm_and_data(problem, data)
        x0 = fit_frames(residuals)
        changes = possible_changes(residuals.robot, residuals.data)
        free = {residuals.parameters[i].name: float(x0[i]) for i in residuals.free}
        wide = _in_all_parameters(residuals, x0, changes, problem.sources)
        x, none = np.array([free.get(p.name, 0.0) for p in wide.parameters]), np.zeros(0)
        noise = _noise_factors(problem, wide, x)
        return cls(problem, wide, x, none, none, none, changes, frozenset(free), noise, notes)._at(x)

    def _at(self, x: Array) -> NewRows:
        """Linearised at parameters (K,): residuals, columns of what is uncertain or free, and derivatives."""
        sources, residuals = self.problem.sources, self.residuals
        r, A = (_whitened(self.noise, part) for part in residuals.residuals_and_jacobian(x))
        # A F with F Fᵀ = C, the covariance of what is not known of the arm; free frames apart.
        place = {p.name: i for i, p in enumerate(residuals.parameters)}
        loose = residuals.free_groups
        rows = [i for i, n in enumerate(sources.names) if n in place and n.partition(".")[0] not in loose]
        values, vectors = np.linalg.eigh(sources.constant[np.ix_(rows, rows)])
        sure = values > _RANK_TOLERANCE * values.max(initial=0.0)
        known = A[:, [place[sources.names[i]] for i in rows]] @ (vectors[:, sure] * np.sqrt(values[sure]))
        # Of what is free next to nothing is known: 1e4 standard deviations of the rows.
        U, s, _ = np.linalg.svd(A[:, self._free_places], full_matrices=False)
        loose_columns = 1e4 * U[:, s > _RANK_TOLERANCE * s.max(initial=0.0)]
        return replace(self, r=r, P=np.concatenate([known, loose_columns], axis=1), A=A)

    @property
    def _free_places(self) -> list[int]:
        return [i for i, p in enumerate(self.residuals.parameters) if p.name in self.free]

    def about(self, x: Array) -> NewRows:
        """Linearised at other parameters (K,), `r` carried back to those of the calibrated arm.

        A large change is linear about its own estimate only: a joint that slipped by 60 mrad moves the tool along an
        arc that leaves its tangent by 2 mm in a metre.
        """
        there = self._at(x)
        return replace(there, r=there.r - there.A @ (x - self.x))

    def errors_at(self, x: Array) -> Array:
        """(m,) the whitened residuals at some parameters, exactly."""
        return _whitened(self.noise, self.residuals.whitened(x))

    def take(self, kept: Codes) -> NewRows:
        return replace(self, residuals=self.residuals.take(kept), noise=self.noise[kept])._at(self.x)

    def with_free(self, x: Array) -> Array:
        """Parameters (K,) with what is free found again beside the others: places hide a part of what changed."""
        own, x = self._free_places, x.copy()
        for _ in range(2 if own else 0):  # steps of Gauss-Newton, from what suits the arm without the change
            A = _whitened(self.noise, self.residuals.residuals_and_jacobian(x)[1][:, own])
            x[own] -= np.linalg.lstsq(A, self.errors_at(x), rcond=_RANK_TOLERANCE)[0]
        return x

    def columns(self, change: PossibleChange) -> list[int]:
        place = {p.name: i for i, p in enumerate(self.residuals.parameters)}
        return [place[p.name] for p in change.parameters]

    def motion(self, change: PossibleChange) -> Array:
        """(p, p) mean square motion of the tool over the rows, ``θᵀ M θ`` [m²], by the parameters of a change."""
        moved = self.twists(change.names)
        return moved @ moved.T / len(self.residuals.data)

    @property
    def moving(self) -> tuple[PossibleChange, ...]:
        """The changes that move the tool on these rows, by more than rounding beside others of their kind."""
        sizes = [float(np.trace(self.motion(change))) for change in self.changes]
        kinds = [change.kind for change in self.changes]
        most = {kind: max(s for s, k in zip(sizes, kinds, strict=True) if k == kind) for kind in kinds}
        rows = zip(self.changes, sizes, strict=True)
        return tuple(change for change, size in rows if size > 1e-12 * most[change.kind])

    def twists(self, names: Sequence[str]) -> Array:
        """(p, 6 N) motion of the tool per unit of each parameter, world: shift, and that by its turn if measured."""
        return np.array([self._motions[name] for name in names])

    @cached_property
    def _motions(self) -> dict[str, Array]:
        """Parameter -> (6 N,) motion of the tool per unit of it, of all that may change and both frames."""
        R = self.residuals
        names = list(dict.fromkeys([*_FRAMES, *(p for change in self.changes for p in change.names)]))
        found = R.arm.twists(names, R.q, R.walk(self.x), R.deviations(self.x))
        # A turn of the tool counts as what it shifts a point 0.1 m from the tool point by: the size of a tool.
        levers = [1.0] * 3 + [0.1 * R.data.kind.oriented] * 3
        rows = [stacked_rows([f * v for f, v in zip(levers, (*s, *w), strict=True)], len(R.data)) for s, w in found]
        return {name: row.ravel() for name, row in zip(names, rows, strict=True)}


def _in_all_parameters(
    residuals: Residuals, x0: Array, changes: Sequence[PossibleChange], sources: Sources
) -> Residuals:
    wide = residuals.with_effects(effects_of(changes), x0)
    free = [residuals.parameters[i] for i in residuals.free]
    factors = residuals.robot.parameters
    of_effects = {*wide.arm.effect_parameters}
    known = [
        Parameter(n, n.split(".")[0] if n in factors else "effect", "", 0.0, n)
        for n in sources.names
        if n in factors or n in of_effects
    ]
    taken: dict[str, Parameter] = {}
    for p in (*free, *(p for change in changes for p in change.parameters), *known):
        taken.setdefault(p.name, p)
    return replace(wide, parameters=tuple(taken.values()))


def _noise_factors(problem: ProblemData, residuals: Residuals, x: Array) -> Array:
    """(N, b, b) Cholesky factors of the covariance of each row: of the instrument, and of the arm's own scatter."""
    data, block = residuals.data, residuals.block
    covariance = np.zeros((len(data), block, block))
    diagonal = np.ones((len(data), block))
    diagonal[:, : len(residuals.axes)] = relative_sigma(problem, data)[:, None] ** 2
    covariance[:, range(block), range(block)] = diagonal
    sources = problem.sources
    own = [i for i, n in enumerate(sources.names) if sources.scatter[i, i] > 0 and n in residuals.arm.parameters]
    if own:
        J = residuals.sensitivities([sources.names[i] for i in own], x)
        covariance += J @ sources.scatter[np.ix_(own, own)] @ np.swapaxes(J, 1, 2)
    return np.asarray(np.linalg.cholesky(covariance), dtype=float)


def _whitened(L: Array, rows: Array) -> Array:
    """Rows (m,) or (m, K) in units of the standard deviation of each row; those of known distances stay."""
    n, block = L.shape[:2]
    measured = rows[: n * block].reshape(n, block, -1)
    found = np.linalg.solve(L, measured).reshape(n * block, *rows.shape[1:])
    return np.concatenate([found, rows[n * block :]])


def distinct_rows(rows: NewRows) -> NewRows:
    """The rows with links that act as a frame or the zero of a joint left to it, and links that act alike as one.

    Parallel axes have one distance along them between all: the longest link stands for it. A twist about the axis of a
    joint is its zero by another name.
    """
    factors = rows.residuals.robot.parameters
    lengths = {name: abs(factor.nominal) for name, factor in factors.items()}
    frames = {name: rows.twists([f"{name}.{part}" for part in FRAME_PARTS]) for name in ("base", "tool")}
    alike: dict[str, list[str]] = {name: [] for name in frames}
    zeros = [change for change in rows.changes if change.kind == "joint_offset"]
    own = {change.target: rows.twists(change.names) for change in zeros}
    links = [change.target for change in rows.changes if change.kind == "link"]
    for link in sorted(links, key=lambda link: -lengths[link]):
        motion = rows.twists([link])
        size, others = float(np.linalg.norm(motion)), {**frames, **own}
        left = (motion[0] - B.T @ np.linalg.lstsq(B.T, motion[0], rcond=None)[0] for B in others.values())
        # By less than 2 % of its motion, a change of a millimetre differs from another by micrometres.
        near = (float(np.linalg.norm(rest)) <= 0.02 * size for rest in left)
        same = next((name for name, alike_one in zip(others, near, strict=True) if alike_one), None)
        if same is None:
            own[link], alike[link] = motion, []
        elif same in alike and (factors[link].kind == "rotate" or lengths[link] > 5e-3):
            # A link that is shorter is an error and no part of the arm.
            alike[same].append(link)
    gone = set(links) - set(own)
    kept = [change for change in rows.changes if change.target not in gone]
    return replace(rows, changes=tuple(replace(c, alike=tuple(alike.get(c.target, ()))) for c in kept))
