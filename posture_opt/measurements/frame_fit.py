"""How well the nominal arm, within tolerances and with its free frames, explains measurements: a few linear fits."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from posture_opt.measurements.hand_eye import closed_rotations
from posture_opt.measurements.measurements import group_means, reach
from posture_opt.measurements.rotations import cross_matrices, nearest_rotation, rotation_matrices, rotation_vectors
from posture_opt.model.chain import factor_values, position_column, rotation_column, walk
from posture_opt.numerics import Array, Codes, rms_length, stacked_rows
from posture_opt.robot.robot import Robot

# Standard deviations of lengths, axes and zeros of an arm that nobody calibrated; 1° of a zero set by hand
_TOLERANCE_M, _TOLERANCE_RAD, _ZERO_RAD = 1e-3, 3e-3, 17e-3
# Standard deviations of a frame that the file states: what a calibration holds undetermined ones by, 10 mm and 1°
_FRAME_M, _FRAME_RAD = 10e-3, 17e-3
# Standard deviations of what is free: a base anywhere, a tool as arms carry it
_FREE_M, _FREE_TOOL_M, _FREE_RAD = 1e3, 0.5, 10.0
_LEAST_SCATTER = 0.1  # Of the stated noise: data that are met more closely have none that could be compared


@dataclass(frozen=True, eq=False)
class Sample:
    """The rows that readings are judged by, and what is known beside them."""

    rows: Codes  # (m,) their indices in the data
    robot: Robot  # the nominal arm
    # commanded, q: (m, n) joint values, without and with what others carry them [rad or m]
    commanded: Array
    q: Array
    position: Array | None  # (m, 3) [m]
    rotation: Array | None  # (m, 4) quaternions; None where not measured
    axes: Codes  # (d,) coordinates that were measured
    point: Codes  # (m,) codes of touched points, where no position was
    # base_free, tool_free: frames of which nothing is known
    base_free: bool
    tool_free: bool
    sigma: float  # of a coordinate [m]
    turn: float  # of an orientation [rad]
    spare: int  # numbers beyond the unknowns of the frames

    @property
    def idle(self) -> set[int]:
        """Joints whose zero a free frame takes up: the first and the last."""
        return ({0} if self.base_free else set()) | ({self.robot.n - 1} if self.tool_free else set())

    @property
    def motion(self) -> float:
        """RMS motion of the measured points [m]; of touched ones, half of the reach."""
        p = self.position
        return 0.5 * reach(self.robot) if p is None else rms_length(p - p.mean(axis=0))


@dataclass(frozen=True)
class FrameFit:
    """What the best frames and an arm within tolerances leave."""

    scatter: float  # robust standard deviation of the residuals, in units of the stated one
    left: float  # RMS of the positions [m]
    turned: float  # of the orientations [rad], 0 without
    strain: float  # length of the vector of deviations of parts from nominal, in their standard deviations
    shift: float  # how far the tool point comes to lie from where the file starts it [m]
    scale: float = 1.0  # factor of the measured lengths


def frame_fit(sample: Sample, scaled: bool = False, rounds: int = 5) -> FrameFit:
    """Fit base, tool and the arm within its tolerances; with the ``scaled`` lengths of the instrument too."""
    # ``m_i = k (B (p_i(x) + R_i(x) t) + b)`` and ``M_i = B R_i(x) T`` by Gauss-Newton in B, b, T, t, x and k, with
    # what is known of frames and parts as a prior, and rows weighed by Student's t
    # From a closed form, four rounds suffice even for nearly parallel axes.
    state, scatter = _State.of(sample), np.inf
    for _ in range(rounds):
        error, columns = state.residuals(scaled)
        size = np.sqrt(np.sum(error**2, axis=1))
        scatter = max(min(scatter, _robust(size, error.shape[1])), _LEAST_SCATTER)  # never up: weights must settle
        # Student's t with four degrees of freedom: gross rows decide nothing.
        weight = np.sqrt((4 + error.shape[1]) / (4 + (size / scatter) ** 2)) / scatter
        A = (columns * weight[:, None, None]).reshape(-1, columns.shape[2])
        H = A.T @ A + np.diag(1 / state.widths(scaled) ** 2)
        g = A.T @ (error * weight[:, None]).ravel() + state.deviations(scaled) / state.widths(scaled) ** 2
        state = state.moved(-np.linalg.solve(H, g), scaled)
    error, _ = state.residuals(scaled)
    size, block = np.sqrt(np.sum(error**2, axis=1)), error.shape[1]
    freedom = max(error.size - float(np.trace(np.linalg.solve(H, A.T @ A))), 1.0)
    split = error[:, : len(state.axes)] * sample.sigma, error[:, len(state.axes) :] * sample.turn
    left, turned = (float(np.median(np.linalg.norm(part, axis=1))) if part.size else 0.0 for part in split)
    strain = float(np.linalg.norm(state.x / state.tolerance))
    scatter = _robust(size, block) * float(np.sqrt(error.size / freedom))
    return FrameFit(max(scatter, _LEAST_SCATTER), left, turned, strain, float(np.linalg.norm(state.t)), state.scale)


def start_misfit(sample: Sample, p: Array, R: Array) -> float:
    """What frames in closed form leave of p (m, 3) [m] and R (m, 3, 3) of the nominal arm, in units of an arm's
    tolerances."""
    assert sample.position is not None, "a start has no closed form for touches"
    M = None if sample.rotation is None else rotation_matrices(sample.rotation)
    B, T, t = _closed_turns(sample, p, R, sample.position, M)
    columns = np.concatenate([np.broadcast_to(np.eye(3), R.shape), B @ R], axis=2)[:, sample.axes]
    error = (sample.position - (p + R @ t) @ B.T)[:, sample.axes]
    free = [*range(3 * sample.base_free), *range(3, 3 + 3 * sample.tool_free)]
    A = columns[:, :, free].reshape(error.size, len(free))
    left = error - (A @ np.linalg.lstsq(A, error.ravel())[0]).reshape(error.shape)
    turned = np.zeros((len(p), 0)) if M is None else rotation_vectors(B @ R @ T @ np.swapaxes(M, 1, 2))
    both = np.concatenate([left / _TOLERANCE_M, turned / _TOLERANCE_RAD], axis=1)
    return _robust(np.linalg.norm(both, axis=1), both.shape[1])


@dataclass(frozen=True, eq=False)
class _State:
    """The unknowns of one fit, as in `frame_fit`, and what does not change with them."""

    sample: Sample
    tolerance: Array
    measured: Array
    M: Array | None
    axes: Codes
    B: Array
    b: Array
    T: Array
    t: Array
    x: Array
    scale: float = 1.0

    @classmethod
    def of(cls, sample: Sample) -> _State:
        factors = sample.robot.factors
        own = _own_factors(sample.robot)
        p, R, *_ = _arm_at(sample, np.zeros(len(own)))
        zeros = {f.parameter for f in factors if f.joint is not None}
        tolerance = np.array(
            [
                _ZERO_RAD if factors[i].parameter in zeros else
                _TOLERANCE_M if factors[i].kind == "translate" else _TOLERANCE_RAD
                for i in own
            ]
        )  # fmt: skip
        touched = sample.position is None
        measured = np.zeros_like(p) if sample.position is None else sample.position
        M = None if sample.rotation is None else rotation_matrices(sample.rotation)
        B, T, t = _closed_turns(sample, p, R, measured, M)
        shifted = measured - (p + R @ t) @ B.T
        b = np.zeros(3) if touched or not sample.base_free else np.median(shifted, axis=0)
        axes = np.arange(3) if touched else sample.axes
        return cls(sample, tolerance, measured, M, axes, B, b, T, t, np.zeros(len(own)))

    def widths(self, scaled: bool) -> Array:
        """(k,) prior standard deviations of base, tool, arm and scale."""
        s = self.sample
        base = (_FREE_M, _FREE_RAD) if s.base_free else (_FRAME_M, _FRAME_RAD)
        tool = (_FREE_TOOL_M, _FREE_RAD) if s.tool_free else (_FRAME_M, _FRAME_RAD)
        return np.concatenate([np.repeat([*base, *tool], 3), self.tolerance, [_FREE_RAD] * scaled])

    def deviations(self, scaled: bool) -> Array:
        """(k,) how far base, tool and arm are from what is stated."""
        turns = [rotation_vectors(R[None])[0] for R in (self.B, self.T)]
        return np.concatenate([self.b, turns[0], self.t, turns[1], self.x, np.zeros(int(scaled))])

    def residuals(self, scaled: bool) -> tuple[Array, Array]:
        """(m, d) in units of the stated σ, and (m, d, k) their change with the unknowns."""
        s, n = self.sample, len(self.sample.q)
        p, R, shift, turn = _arm_at(s, self.x)
        lever = R @ self.t
        moved = shift + np.cross(turn, lever[:, :, None], axis=1)
        reached = (p + lever) @ self.B.T
        eye = np.broadcast_to(np.eye(3), (n, 3, 3))
        turned = -cross_matrices(reached)
        columns = [eye, turned, self.B @ R, np.zeros((n, 3, 3)), self.B @ moved]
        found = self.scale * (reached + self.b)
        if scaled:
            columns.append((reached + self.b)[:, :, None])
        J, e = self.scale * np.concatenate(columns, axis=2), found - self.measured
        if s.position is None:
            codes = np.unique(s.point, return_inverse=True)[1]
            J, e = J - group_means(J, codes)[codes], e - group_means(e, codes)[codes]
        J, e = J[:, self.axes] / s.sigma, e[:, self.axes] / s.sigma
        if self.M is None:
            return e, J
        BR = self.B @ R
        off = rotation_vectors(BR @ self.T @ np.swapaxes(self.M, 1, 2))
        further = [np.zeros((n, 3, 3)), eye, np.zeros((n, 3, 3)), BR, self.B @ turn]
        K = np.concatenate([*further, *[np.zeros((n, 3, 1))] * scaled], axis=2)
        return np.concatenate([e, off / s.turn], axis=1), np.concatenate([J, K / s.turn], axis=1)

    def moved(self, step: Array, scaled: bool) -> _State:
        """The state after a step of all unknowns."""
        g = 12 + len(self.x)
        return replace(
            self, b=self.b + step[:3], B=_turn(step[3:6]) @ self.B, t=self.t + step[6:9], T=_turn(step[9:12]) @ self.T,
            x=self.x + step[12:g], scale=self.scale * (1 + float(step[g])) if scaled else self.scale,
        )  # fmt: skip


def _own_factors(robot: Robot) -> list[int]:
    named = [f.parameter or "" for f in robot.factors]
    return [i for i, name in enumerate(named) if name and not name.startswith(("base.", "tool."))]


def _arm_at(sample: Sample, x: Array) -> tuple[Array, Array, Array, Array]:
    """p (m, 3), R (m, 3, 3) and their change (m, 3, g), (m, 3, g) with the deviations x (g,) of the arm."""
    factors, own, n = sample.robot.factors, _own_factors(sample.robot), len(sample.q)
    off = {factors[i].parameter: float(value) for i, value in zip(own, x, strict=True)}
    reached = walk(factors, factor_values(factors, [np.ascontiguousarray(column) for column in sample.q.T], off))
    p = stacked_rows(reached.position, n)
    R = np.stack([stacked_rows(column, n) for column in reached.columns], axis=2)
    shift, turn = np.zeros((n, 3, len(own))), np.zeros((n, 3, len(own)))
    for k, i in enumerate(own):
        shift[:, :, k] = stacked_rows(position_column(reached, i), n)
        turn[:, :, k] = stacked_rows(rotation_column(reached, i), n)
    return p, R, shift, turn


def _closed_turns(sample: Sample, p: Array, R: Array, m: Array, M: Array | None) -> tuple[Array, Array, Array]:
    eye, tool = np.eye(3), np.zeros(3)
    base_free, tool_free = sample.base_free and sample.position is not None, sample.tool_free
    if M is not None and base_free and tool_free:
        Z, X = closed_rotations(M, R)
        return Z, X.T, tool
    if M is not None and (base_free or tool_free):
        mean = np.einsum("nij,nkj->ik", M, R) if base_free else np.einsum("nji,njk->ik", R, M)
        return (nearest_rotation(mean), eye, tool) if base_free else (eye, nearest_rotation(mean), tool)
    B = eye
    for _ in range(10 if base_free else 0):
        reached = p + R @ tool
        B = nearest_rotation((m - m.mean(axis=0)).T @ (reached - reached.mean(axis=0)))
        if not tool_free:
            break
        rest = m @ B - p
        turned = R - R.mean(axis=0)
        X = turned.reshape(-1, 3)
        # Errors of an arm over the length of a tool hold the start of a tool near the flange.
        tool = np.linalg.solve(X.T @ X + len(p) * 0.02**2 * np.eye(3), X.T @ (rest - rest.mean(axis=0)).ravel())
    return B, eye, tool


def _robust(size: Array, block: int) -> float:
    """The standard deviation of residuals of ``block`` coordinates from their lengths (m,)."""
    from scipy.special import gammaincinv

    return float(np.median(size) / np.sqrt(2 * gammaincinv(block / 2, 0.5)))


def _turn(w: Array) -> Array:
    """(3, 3) the rotation by a vector w [rad]."""
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_rotvec(w).as_matrix())
