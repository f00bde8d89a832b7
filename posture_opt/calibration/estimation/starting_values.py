"""Closed-form starts for frames and points that are not known beforehand."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from posture_opt.calibration.estimation.parameters import Parameter, tool_unknown
from posture_opt.calibration.estimation.residuals import Residuals
from posture_opt.measurements.affine_fit import reach
from posture_opt.measurements.measurements import carried_joint_values, group_means
from posture_opt.measurements.rotations import roll_pitch_yaw
from posture_opt.model.chain import factor_values, walk
from posture_opt.numerics import Array, Codes, rms, stacked_rows
from posture_opt.robot.robot import Factor, Robot

_REACH_PER_TOOL = 10.0  # a tool is some ten times shorter than its arm; one of twice that is twice its σ away
_LENGTH_TOLERANCE_M = 1e-9  # m: rounding


def kabsch(a: Array, b: Array, near: Array | None = None) -> tuple[Array, Array]:
    """The rotation and shift that take the points ``a`` (N, 3) best onto ``b``: ``b ≈ R a + t``.

    ``near`` (3, 3), small compared with the scatter of the points [m²], decides the turn that points on a line leave
    open. Source: Umeyama (1991), equations 39-42, without scale.

    Args:
        a, b: corresponding points [m]; three that are not on a line determine the rotation.

    Example:
        >>> import numpy as np
        >>> a = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
        >>> R, t = kabsch(a, a @ np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]]) + 1.0)
        >>> bool(np.allclose(R, [[0, -1, 0], [1, 0, 0], [0, 0, 1]])), np.round(t, 9).tolist()
        (True, [1.0, 1.0, 1.0])
    """
    mean_a, mean_b = a.mean(axis=0), b.mean(axis=0)
    scatter = (b - mean_b).T @ (a - mean_a)
    R = nearest_rotation(scatter if near is None else scatter + near)
    return R, mean_b - R @ mean_a


def nearest_rotation(M: Array) -> Array:
    """The rotation closest to a (3, 3) matrix in the Frobenius norm; never a reflection."""
    U, _, Vt = np.linalg.svd(M)
    return np.asarray(U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt)


def starting_deviations(residuals: Residuals) -> Array:
    """Deviations (k,) from nominal at which free frames and touched points fit the nominal arm.

    With ``p_i``, ``R_i`` the flange in the base, ``t`` the tool offset and ``m_i`` the measured point,
    ``R_bᵀ m_i + u − R_i t = p_i`` is linear in ``R_bᵀ``, ``u = −R_bᵀ t_b`` and ``t``; the rotation is then made
    one by projection and the rest solved again. Touched points are linear in ``t`` and themselves. Where orientations
    hardly change, base and tool cannot be distinguished: the tool stays as near to its stated offset as the arm's size
    asks, see `tool_sigma`.
    """
    robot, data = residuals.robot, residuals.data
    tool_free = tool_unknown(robot, data)
    flange = _Flange.of(residuals)
    values: dict[str, float] = {}
    offset, (R_b, t_b) = flange.nominal, _base_pose(residuals)
    if data.position is None:
        offset = _socket_start(flange, data.point) if tool_free and data.touches else offset
        values |= _place_starts(residuals, flange, offset)
    elif robot.base_free or tool_free:
        R_b, t_b, offset = _frames_start(flange, data.position, (robot.base_free, tool_free), (R_b, t_b))
        if robot.base_free:
            values |= dict(zip((f"base.{a}" for a in "xyz"), t_b, strict=True)) | _named_angles(robot.base, R_b)
    if tool_free:
        values |= _tool_turns(residuals, flange, R_b) if data.kind.oriented else {}
        for k in range(len(offset)):
            values |= {f"{_tool_name(residuals, k)}.{a}": offset[k, i] for i, a in enumerate("xyz")}
    return np.array([values.get(q.name, q.nominal) - q.nominal for q in residuals.parameters])


def tool_sigma(robot: Robot) -> float:
    """How far a free tool that nothing determines is from its start or the flange [m]: less than the arm."""
    return reach(robot) / _REACH_PER_TOOL


def offset_of_tool(parameter: Parameter) -> bool:
    """Whether an unknown is a coordinate of a tool's offset."""
    return parameter.group == "tool" and parameter.unit == "m"


@dataclass(frozen=True, eq=False)
class _Flange:
    """The nominal flange in the base at all rows: position p (N, 3), orientation R (N, 3, 3), and what it carries.

    Args:
        codes: (N,) the target of each row; ``nominal`` (tools, 3) their stated offsets [m], ``sigma`` how near to them
            the offsets are [m].
    """

    p: Array
    R: Array
    codes: Codes
    nominal: Array
    sigma: float

    @classmethod
    def of(cls, residuals: Residuals) -> _Flange:
        """The flange of the nominal arm at the rows of the data, and its stated tool offsets."""
        robot, data = residuals.robot, residuals.data
        tools = max(len(data.target_names), 1)
        codes = data.target if tools > 1 else np.zeros(len(data), dtype=np.intp)
        stated = [f.nominal for f in robot.tool if f.kind == "translate"] or [0.0] * 3
        return cls(*_flange_poses(residuals), codes, np.array([stated] * tools), tool_sigma(robot))

    def reached(self, offset: Array) -> Array:
        """(N, 3) tool points in the base with some offsets (tools, 3)."""
        return np.asarray(self.p + np.einsum("nij,nj->ni", self.R, offset[self.codes]))

    def columns(self, A: Array, first: int) -> None:
        """Puts what offsets take from the equations ``A`` (N, 3, k) into its columns from ``first`` on."""
        for k in range(len(self.nominal)):
            mine = self.codes == k
            A[mine, :, first + 3 * k : first + 3 * k + 3] = -self.R[mine]

    def solved(self, A: Array, b: Array, first: int, spread: float) -> Array:
        """(k,) ``A x ≈ b`` with offsets from column ``first`` on that stay near the stated ones, rows off by spread."""
        rows = np.zeros((3 * len(self.nominal), A.shape[-1]))
        weight = max(spread, _LENGTH_TOLERANCE_M) / self.sigma
        rows[:, first:] = weight * np.eye(len(rows))
        stacked = np.concatenate([A.reshape(-1, A.shape[-1]), rows])
        wanted = np.concatenate([b.ravel(), weight * self.nominal.ravel()])
        return np.asarray(np.linalg.lstsq(stacked, wanted, rcond=1e-9)[0])


def _tool_name(residuals: Residuals, code: int) -> str:
    """The name of the tool that a target is on: ``tool``, or ``tool[TARGET]`` of several."""
    names = residuals.data.target_names
    return f"tool[{names[code]}]" if len(names) > 1 else "tool"


def _flange_poses(residuals: Residuals) -> tuple[Array, Array]:
    """Position (N, 3) and orientation (N, 3, 3) of the flange in the base."""
    n = len(residuals.data)
    factors = tuple(f for link in residuals.robot.links for f in link)
    reached = walk(factors, factor_values(factors, list(carried_joint_values(residuals.arm, residuals.data.q).T)))
    return stacked_rows(reached.position, n), np.stack([stacked_rows(c, n) for c in reached.columns], axis=-1)


def _base_pose(residuals: Residuals) -> tuple[Array, Array]:
    """Nominal rotation (3, 3) and position (3,) [m] of the base in the world."""
    factors = residuals.robot.base
    reached = walk(factors, [f.nominal for f in factors])
    return np.array(reached.columns, dtype=float).T, np.array(reached.position, dtype=float)


def _frames_start(
    flange: _Flange, m: Array, free: tuple[bool, bool], base: tuple[Array, Array]
) -> tuple[Array, Array, Array]:
    """Rotation (3, 3) and place (3,) of the base and the offsets (tools, 3), of the stated ones those that are free.

    Where base and tool are free, the start with the stated offsets is kept unless others explain enough.
    """
    R_b, t_b = base
    if not free[0]:
        off = rms(flange.reached(flange.nominal) - (m - t_b) @ R_b)
        return R_b, t_b, _tool_offsets(flange, (m - t_b) @ R_b, off, shift=False)
    starts = [flange.nominal]
    off = _placed_base(flange, flange.nominal, m, R_b)[1]
    if free[1]:
        turned = m @ _rotation_of_base(flange, m, off)
        starts.append(_tool_offsets(flange, turned, off, shift=True))
    placed = [(_placed_base(flange, offset, m, R_b), offset) for offset in starts]

    def cost(one: tuple[tuple[tuple[Array, Array], float], Array]) -> float:
        (_, left), offset = one
        far = (offset - flange.nominal) / flange.sigma
        return m.size * math.log(max(left, _LENGTH_TOLERANCE_M) ** 2) + float(np.sum(far**2))

    (found, _), offset = min(placed, key=cost)
    return *found, offset


def _placed_base(flange: _Flange, offset: Array, m: Array, stated: Array) -> tuple[tuple[Array, Array], float]:
    """Rotation and place of the base for some offsets, and the RMS that they leave [m].

    Across a line, points scatter by what the arm errs: that determines no turn about it, and the stated one is kept.
    """
    reached = flange.reached(offset)
    left, near = 0.0, None
    for _ in range(2):
        R, t = kabsch(reached, m, near)
        left = rms(reached @ R.T + t - m)
        near = len(m) * left**2 * stated
    return (R, t), left


def _rotation_of_base(flange: _Flange, m: Array, spread: float) -> Array:
    """The rotation (3, 3) of the base by the linear equations of `starting_deviations`, projected to a rotation.

    Args:
        m: (N, 3) measured points [m]; spread: how far off the equations are [m], against the tool's tolerance.
    """
    n = len(m)
    centre = m.mean(axis=0)  # far from the tracker, the columns of a coordinate and of the shift would be alike
    A = np.zeros((n, 3, 12 + flange.nominal.size))
    for i in range(3):
        A[:, i, 3 * i : 3 * i + 3] = m - centre
        A[:, i, 9 + i] = 1.0
    flange.columns(A, 12)
    solution = flange.solved(A, flange.p, 12, spread)
    return nearest_rotation(np.asarray(solution[:9].reshape(3, 3))).T


def _tool_offsets(flange: _Flange, turned: Array, spread: float, *, shift: bool) -> Array:
    """Offsets (tools, 3) [m] that bring the tool points to points ``turned`` (N, 3) into the frame of the base.

    ``shift`` says whether a common shift of all points is unknown too.
    """
    A = np.zeros((len(turned), 3, 3 + flange.nominal.size))
    if shift:
        A[:, range(3), range(3)] = 1.0
    flange.columns(A, 3)
    return flange.solved(A, flange.p - turned, 3, spread)[3:].reshape(-1, 3)


def _socket_start(flange: _Flange, point: Codes) -> Array:
    """Offsets (tools, 3) [m] with which the touches of each point agree best."""
    # The points are means: without them, only how far each row strays from the mean of its point is left.
    A = np.zeros((len(point), 3, flange.nominal.size))
    flange.columns(A, 0)
    own = np.unique(point, return_inverse=True)[1]
    A, b = A - group_means(A, own)[own], flange.p - group_means(flange.p, own)[own]
    off = rms(b - A.reshape(len(point), 3, -1) @ flange.nominal.ravel())
    return flange.solved(A, b, 0, off).reshape(-1, 3)


def _place_starts(residuals: Residuals, flange: _Flange, offset: Array) -> dict[str, float]:
    """The unknowns of places that suit the nominal arm with some offsets (tools, 3) of its tools, by name."""
    data, kind = residuals.data, residuals.data.kind
    R_b, t_b = _base_pose(residuals)
    points, columns = flange.reached(offset) @ R_b.T + t_b, np.moveaxis(R_b @ flange.R, 0, -1).swapaxes(0, 1)
    none = np.zeros((max(len(data.place_names), 1), kind.width))
    found = kind.start(data.seen(points.T, list(columns), none), len(none))
    return {
        kind.parameter(place, name): float(found[k, i])
        for k, place in enumerate(data.place_names)
        for i, (name, _) in zip(kind.slots(place), kind.unknowns(place), strict=True)
    }


def _tool_turns(residuals: Residuals, flange: _Flange, R_b: Array) -> dict[str, float]:
    """The turns of each tool on the flange, the mean of those that rows with an orientation show, by name."""
    data, found = residuals.data, dict[str, float]()
    columns = np.moveaxis(R_b @ flange.R, 0, -1).swapaxes(0, 1)
    none = np.zeros((max(len(data.place_names), 1), data.kind.width))
    turn = np.swapaxes(R_b @ flange.R, -1, -2) @ data.kind.orientations(data.seen(flange.p.T, list(columns), none))
    for k in range(len(flange.nominal)):
        own = turn[(flange.codes == k) & np.isfinite(turn[:, 0, 0])]
        if len(own):
            angles = _named_angles(residuals.robot.tool, nearest_rotation(own.sum(axis=0)))
            found |= {name.replace("tool", _tool_name(residuals, k), 1): angle for name, angle in angles.items()}
    return found


def frame_rotation(factors: Sequence[Factor], turns: Mapping[str, float]) -> Array:
    """Rotation (3, 3) of a frame whose named turns have these values in addition to their nominal ones."""
    named = {
        factor.parameter: turns[factor.parameter.rpartition(".")[2]] for factor in factors if _is_named_turn(factor)
    }
    return np.array(walk(factors, factor_values(factors, [], named)).columns, dtype=float).T


def _is_named_turn(factor: Factor) -> bool:
    """Whether a factor is a rotation with a parameter."""
    return factor.kind == "rotate" and bool(factor.parameter)


def _named_angles(factors: Sequence[Factor], R: Array) -> dict[str, float]:
    """The named turns of a frame whose rotation is ``R``: what its constant turns leave over."""
    constant = [factor for factor in factors if factor.kind == "rotate" and not factor.parameter]
    before = np.array(walk(constant, [factor.nominal for factor in constant]).columns, dtype=float).T
    found = roll_pitch_yaw(before.T @ R)
    names = [factor.parameter for factor in factors if _is_named_turn(factor)]
    return {name: found[name.rpartition(".")[2]] for name in names}
