"""New rows against a calibrated arm, to first order: what its covariance, and what every change would make of them."""

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
from posture_opt.uncertainty.sources.sources import Sources

TURN_LEVER_M = 0.1
"""A turn of the tool counts as what it shifts a point so far from the tool point by: the size of a tool."""
_FRAMES = tuple(f"{frame}.{part}" for frame in ("base", "tool") for part in FRAME_PARTS)
_FREE_SIGMA = 1e4  # of what is free, in standard deviations of the rows: next to nothing is known of it
_FREE_STEPS = 2  # of Gauss-Newton, from what suits the arm without the change
_RANK_TOLERANCE = 1e-9
_LEAST_MOTION_SHARE = 1e-12  # of the mean square motion by the largest of a kind, of which less is rounding


@dataclass(frozen=True, eq=False)
class NewRows:
    """Whitened residuals ``r = P u + A θ + ε`` of new rows, ε ~ N(0, k² I), u ~ N(0, I), θ what changed.

    Args:
        problem: the calibrated arm.
        residuals: the arm against the rows, in all parameters; ``x`` (K,) those of the calibrated arm [rad, m].
        r: (m,) model minus measurement at the calibrated arm, in units of instrument and scatter of the arm.
        P: (m, p) what is uncertain of the calibrated arm, a standard deviation a column, and what is free.
        A: (m, K) derivatives by all parameters of ``residuals``.
        changes: what may have changed.
        free: names of the parameters that are found from every file of data again.
        noise: (N, b, b) Cholesky factors of the covariance of each row.
        notes: sentences on what was assumed.
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
        x = np.array([free.get(p.name, 0.0) for p in wide.parameters])
        noise = _noise_factors(problem, wide, x)
        r, P, A = _linearised(problem, wide, noise, frozenset(free), x)
        return cls(problem, wide, x, r, P, A, changes, frozenset(free), noise, notes)

    def about(self, x: Array) -> NewRows:
        """The same rows linearised at other parameters (K,), `r` carried back to those of the calibrated arm.

        A large change is linear about its own estimate only: a joint that slipped by 60 mrad moves the tool along an
        arc that leaves its tangent by 2 mm in a metre.
        """
        r, P, A = _linearised(self.problem, self.residuals, self.noise, self.free, x)
        return replace(self, r=r - A @ (x - self.x), P=P, A=A)

    def errors_at(self, x: Array) -> Array:
        """(m,) the whitened residuals at some parameters, exactly."""
        return _whitened(self.noise, self.residuals.whitened(x))

    def take(self, kept: Codes) -> NewRows:
        """Some of the rows, against the frames that all of them gave."""
        residuals = self.residuals.take(kept)
        r, P, A = _linearised(self.problem, residuals, self.noise[kept], self.free, self.x)
        return replace(self, residuals=residuals, r=r, P=P, A=A, noise=self.noise[kept])

    def with_free(self, x: Array) -> Array:
        """Parameters (K,) with what is free found again beside the others: places hide a part of what changed."""
        own, x = [i for i, p in enumerate(self.residuals.parameters) if p.name in self.free], x.copy()
        for _ in range(_FREE_STEPS if own else 0):
            A = _whitened(self.noise, self.residuals.residuals_and_jacobian(x)[1][:, own])
            x[own] -= np.linalg.lstsq(A, self.errors_at(x), rcond=_RANK_TOLERANCE)[0]
        return x

    def columns(self, change: PossibleChange) -> list[int]:
        """Places of the parameters of a change in ``A``."""
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
        return tuple(change for change, size in rows if size > _LEAST_MOTION_SHARE * most[change.kind])

    def twists(self, names: Sequence[str]) -> Array:
        """(p, 6 N) motion of the tool per unit of each parameter: its shift and, where turns are measured, their shift.

        World axes; a turn counts by `TURN_LEVER_M` [m], as nothing where orientations are not measured.
        """
        return np.array([self._motions[name] for name in names])

    @cached_property
    def _motions(self) -> dict[str, Array]:
        """Parameter -> (6 N,) motion of the tool per unit of it, of all that may change and both frames."""
        R = self.residuals
        names = list(dict.fromkeys([*_FRAMES, *(p for change in self.changes for p in change.names)]))
        found = R.arm.twists(names, R.q, R.walk(self.x), R.deviations(self.x))
        levers = [1.0] * 3 + [TURN_LEVER_M * R.data.kind.oriented] * 3
        rows = [stacked_rows([f * v for f, v in zip(levers, (*s, *w), strict=True)], len(R.data)) for s, w in found]
        return {name: row.ravel() for name, row in zip(names, rows, strict=True)}


def _linearised(
    problem: ProblemData, residuals: Residuals, noise: Array, free: frozenset[str], x: Array
) -> tuple[Array, Array, Array]:
    """Whitened residuals (m,) at x, columns of what is uncertain (m, p) and derivatives (m, K)."""
    r, A = residuals.residuals_and_jacobian(x)
    r, A = _whitened(noise, r), _whitened(noise, A)
    known = _known_columns(problem.sources, residuals, A)
    return r, np.concatenate([known, _free_columns(residuals, free, A)], axis=1), A


def _in_all_parameters(
    residuals: Residuals, x0: Array, changes: Sequence[PossibleChange], sources: Sources
) -> Residuals:
    """The residuals with what is free, what is uncertain and what may have changed as parameters, each once."""
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


def _known_columns(sources: Sources, residuals: Residuals, A: Array) -> Array:
    """(m, p) ``A F`` with ``F Fᵀ = C``, the covariance of what is not known of the arm; free frames apart."""
    place = {p.name: i for i, p in enumerate(residuals.parameters)}
    loose = residuals.free_groups
    rows = [i for i, n in enumerate(sources.names) if n in place and n.partition(".")[0] not in loose]
    values, vectors = np.linalg.eigh(sources.constant[np.ix_(rows, rows)])
    kept = values > _RANK_TOLERANCE * values.max(initial=0.0)
    return np.asarray(A[:, [place[sources.names[i]] for i in rows]] @ (vectors[:, kept] * np.sqrt(values[kept])))


def _free_columns(residuals: Residuals, free: frozenset[str], A: Array) -> Array:
    """(m, f) columns of what is free, each of a length at which next to nothing is known of it."""
    columns = A[:, [i for i, p in enumerate(residuals.parameters) if p.name in free]]
    U, s, _ = np.linalg.svd(columns, full_matrices=False)
    return np.asarray(_FREE_SIGMA * U[:, s > _RANK_TOLERANCE * s.max(initial=0.0)])
