"""Closed-form starts for frames and points that are not known beforehand."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from posture_opt.calibration.estimation.parameters import Parameter, tool_unknown
from posture_opt.calibration.estimation.residuals import Residuals
from posture_opt.measurements.kinds import Seen
from posture_opt.measurements.measurements import Measurements, carried_joint_values, group_means, reach
from posture_opt.measurements.rotations import roll_pitch_yaw
from posture_opt.model.chain import factor_values, walk
from posture_opt.numerics import Array, Codes, rms, stacked_rows
from posture_opt.robot.robot import Factor, Robot

_LENGTH_TOLERANCE_M = 1e-9  # m: rounding


def kabsch(a: Array, b: Array, near: Array | None = None) -> tuple[Array, Array]:
    """The rotation and shift that take the points ``a`` (N, 3) best onto ``b``: ``b ≈ R a + t``.

    ``near`` (3, 3), small compared with the scatter of the points [m²], decides the turn that points on a line leave
    open. Source: Umeyama (1991), equations 39-42, without scale.

    a, b: corresponding points [m]; three that are not on a line determine the rotation.
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

    With ``p_i``, ``R_i`` the flange in the base, ``t`` the tool offset and ``m_i`` the measured point, ``R_bᵀ m_i + u −
    R_i t = p_i`` is linear in ``R_bᵀ``, ``u = −R_bᵀ t_b`` and ``t``; the rotation is then made one by projection and
    the rest solved again. Touched points are linear in ``t`` and themselves. Where orientations hardly change, base and
    tool cannot be distinguished: the tool stays as near to its stated offset as the arm's size asks, see `tool_sigma`.
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
    # 10.0 a tool is some ten times shorter than its arm; one of twice that is twice its σ away
    return reach(robot) / 10.0


def offset_of_tool(parameter: Parameter) -> bool:
    """Whether an unknown is a coordinate of a tool's offset."""
    return parameter.group == "tool" and parameter.unit == "m"


@dataclass(frozen=True, eq=False)
class _Flange:
    """The nominal flange in the base at all rows: position p (N, 3), orientation R (N, 3, 3), and what it carries."""

    p: Array
    R: Array
    # (N,) the target of each row; ``nominal`` (tools, 3) their stated offsets [m], ``sigma`` how near to them the
    # offsets are [m]
    codes: Codes
    nominal: Array
    sigma: float

    @classmethod
    def of(cls, residuals: Residuals) -> _Flange:
        """The flange of the nominal arm at the rows of the data, and its stated tool offsets."""
        robot, data, n = residuals.robot, residuals.data, len(residuals.data)
        tools = max(len(data.target_names), 1)
        codes = data.target if tools > 1 else np.zeros(n, dtype=np.intp)
        stated = [f.nominal for f in robot.tool if f.kind == "translate"] or [0.0] * 3
        factors = tuple(f for link in robot.links for f in link)
        reached = walk(factors, factor_values(factors, list(carried_joint_values(residuals.arm, data.q).T)))
        R = np.stack([stacked_rows(column, n) for column in reached.columns], axis=-1)
        return cls(stacked_rows(reached.position, n), R, codes, np.array([stated] * tools), tool_sigma(robot))

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


def _base_pose(residuals: Residuals) -> tuple[Array, Array]:
    """Nominal rotation (3, 3) and position (3,) [m] of the base in the world."""
    factors = residuals.robot.base
    reached = walk(factors, [f.nominal for f in factors])
    return np.array(reached.columns, dtype=float).T, np.array(reached.position, dtype=float)


def _frames_start(
    flange: _Flange, m: Array, free: tuple[bool, bool], base: tuple[Array, Array]
) -> tuple[Array, Array, Array]:
    """Rotation (3, 3) and place (3,) of the base and the offsets (tools, 3), of the stated ones those that are free."""
    R_b, t_b = base
    if not free[0]:
        off = rms(flange.reached(flange.nominal) - (m - t_b) @ R_b)
        return R_b, t_b, _tool_offsets(flange, (m - t_b) @ R_b, off, shift=False)
    starts = [flange.nominal]
    if free[1]:
        off = _placed_base(flange, flange.nominal, m, R_b)[1]
        A = np.zeros((len(m), 3, 12 + flange.nominal.size))
        for i in range(3):
            # Centred: far from the tracker, the columns of a coordinate and of the shift would be alike.
            A[:, i, 3 * i : 3 * i + 3] = m - m.mean(axis=0)
            A[:, i, 9 + i] = 1.0
        flange.columns(A, 12)
        R = nearest_rotation(flange.solved(A, flange.p, 12, off)[:9].reshape(3, 3)).T
        starts.append(_tool_offsets(flange, m @ R, off, shift=True))
    placed = [(*_placed_base(flange, offset, m, R_b), offset) for offset in starts]

    def cost(one: tuple[tuple[Array, Array], float, Array]) -> float:
        far = (one[2] - flange.nominal) / flange.sigma
        return m.size * math.log(max(one[1], _LENGTH_TOLERANCE_M) ** 2) + float(np.sum(far**2))

    found, _, offset = min(placed, key=cost)
    return *found, offset


def _placed_base(flange: _Flange, offset: Array, m: Array, stated: Array) -> tuple[tuple[Array, Array], float]:
    """Rotation and place of the base for some offsets, and the RMS that they leave [m]."""
    reached = flange.reached(offset)
    left, near = 0.0, None
    for _ in range(2):
        R, t = kabsch(reached, m, near)
        left = rms(reached @ R.T + t - m)
        near = len(m) * left**2 * stated
    return (R, t), left


def _tool_offsets(flange: _Flange, turned: Array, spread: float, *, shift: bool) -> Array:
    """Offsets (tools, 3) [m] that bring the tool points to points ``turned`` (N, 3) into the frame of the base."""
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
    found = kind.start(_seen(residuals, flange.reached(offset) @ R_b.T + t_b, R_b @ flange.R), _places(data))
    return {
        kind.parameter(place, name): float(found[k, i])
        for k, place in enumerate(data.place_names)
        for i, (name, _) in zip(kind.slots(place), kind.unknowns(place), strict=True)
    }


def _tool_turns(residuals: Residuals, flange: _Flange, R_b: Array) -> dict[str, float]:
    """Angles of each tool on the flange [rad], by name, in the mean of the rows with an orientation."""
    R, found = R_b @ flange.R, dict[str, float]()
    turn = np.swapaxes(R, -1, -2) @ residuals.data.kind.orientations(_seen(residuals, flange.p, R))
    for k in range(len(flange.nominal)):
        own = turn[(flange.codes == k) & np.isfinite(turn[:, 0, 0])]
        if len(own):
            angles = _named_angles(residuals.robot.tool, nearest_rotation(own.sum(axis=0)))
            found |= {name.replace("tool", _tool_name(residuals, k), 1): angle for name, angle in angles.items()}
    return found


def _places(data: Measurements) -> int:
    return max(len(data.place_names), 1)


def _seen(residuals: Residuals, points: Array, R: Array) -> Seen:
    """The rows beside a tool at points (N, 3) [m] with orientations R (N, 3, 3), places unknown."""
    data = residuals.data
    columns = list(np.moveaxis(R, 0, -1).swapaxes(0, 1))
    return data.seen(points.T, columns, np.zeros((_places(data), data.kind.width)))


def frame_rotation(factors: Sequence[Factor], turns: Mapping[str, float]) -> Array:
    """Rotation (3, 3) of a frame whose named turns have these values in addition to their nominal ones."""
    named = {f.parameter: turns[f.parameter.rpartition(".")[2]] for f in factors if f.kind == "rotate" and f.parameter}
    return np.array(walk(factors, factor_values(factors, [], named)).columns, dtype=float).T


def _named_angles(factors: Sequence[Factor], R: Array) -> dict[str, float]:
    """Angles [rad] of the named turns of a frame with rotation R, after its constant turns."""
    turns = [factor for factor in factors if factor.kind == "rotate"]
    constant = [factor for factor in turns if not factor.parameter]
    before = np.array(walk(constant, [factor.nominal for factor in constant]).columns, dtype=float).T
    found = roll_pitch_yaw(before.T @ R)
    return {f.parameter: found[f.parameter.rpartition(".")[2]] for f in turns if f.parameter}
