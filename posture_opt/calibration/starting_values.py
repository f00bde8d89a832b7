"""Closed-form starts for frames and points that nobody knows beforehand."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from posture_opt.calibration.parameters import tool_unknown
from posture_opt.calibration.residuals import Residuals, _stacked, matrices
from posture_opt.measurements.measurements import group_means
from posture_opt.model.chain import factor_values, walk
from posture_opt.numerics import Array, Codes
from posture_opt.robot.robot import Factor


def kabsch(a: Array, b: Array) -> tuple[Array, Array]:
    """The rotation and shift that take the points ``a`` (N, 3) best onto ``b``: ``b ≈ R a + t``.

    Source: Umeyama (1991), equations 39-42, without scale.
    """
    mean_a, mean_b = a.mean(axis=0), b.mean(axis=0)
    R = nearest_rotation((b - mean_b).T @ (a - mean_a))
    return R, mean_b - R @ mean_a


def nearest_rotation(M: Array) -> Array:
    """The rotation closest to a (3, 3) matrix in the Frobenius norm; never a reflection."""
    U, _, Vt = np.linalg.svd(M)
    return np.asarray(U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt)


def start(residuals: Residuals) -> Array:
    """Deviations (k,) from nominal at which free frames and touched points fit the nominal arm.

    With ``p_i``, ``R_i`` the flange in the base, ``t`` the tool offset and ``m_i`` the measured point,
    ``R_bᵀ m_i + u − R_i t = p_i`` is linear in ``R_bᵀ``, ``u = −R_bᵀ t_b`` and ``t``; the rotation is then made
    one by projection and the rest solved again. Touched points are linear in ``t`` and themselves.
    """
    robot, data = residuals.robot, residuals.data
    tool_free = tool_unknown(robot, data)
    p, R = _flange(residuals)
    tools = max(len(data.target_names), 1)
    codes = data.target if tools > 1 else np.zeros(len(data), dtype=np.intp)
    offset = np.array([[f.nominal for f in robot.tool if f.kind == "translate"] or [0.0] * 3] * tools)
    values: dict[str, float] = {}
    if data.position is None:
        offset, points = _sockets(p, R, codes, offset, data.point, len(data.point_names), tool_free)
        R_b, t_b = _base(residuals)
        points = points @ R_b.T + t_b
        for k, name in enumerate(data.point_names):
            values |= {f"point[{name}].{a}": points[k, i] for i, a in enumerate("xyz")}
    elif robot.base_free or tool_free:
        free = robot.base_free, tool_free
        R_b, t_b, offset = _frames(p, R, codes, offset, data.position, free, _base(residuals))
        if robot.base_free:
            values |= dict(zip((f"base.{a}" for a in "xyz"), t_b, strict=True)) | _angles(robot.base, R_b)
        if tool_free and residuals.oriented:
            assert data.rotation is not None
            for k in range(tools):
                turn = np.swapaxes(R_b @ R, -1, -2) @ matrices(data.rotation)
                found = _angles(robot.tool, nearest_rotation(turn[codes == k].sum(axis=0)))
                values |= {name.replace("tool", _tool(residuals, k), 1): angle for name, angle in found.items()}
    if tool_free:
        for k in range(tools):
            values |= {f"{_tool(residuals, k)}.{a}": offset[k, i] for i, a in enumerate("xyz")}
    return np.array([values.get(q.name, q.nominal) - q.nominal for q in residuals.parameters])


def _tool(residuals: Residuals, code: int) -> str:
    names = residuals.data.target_names
    return f"tool[{names[code]}]" if len(names) > 1 else "tool"


def _flange(residuals: Residuals) -> tuple[Array, Array]:
    """Position (N, 3) and orientation (N, 3, 3) of the flange in the base."""
    n = len(residuals.data)
    factors = tuple(f for link in residuals.robot.links for f in link)
    reached = walk(factors, factor_values(factors, list(residuals.data.q.T)))
    return _stacked(reached.position, n), np.stack([_stacked(c, n) for c in reached.columns], axis=-1)


def _base(residuals: Residuals) -> tuple[Array, Array]:
    factors = residuals.robot.base
    reached = walk(factors, [f.nominal for f in factors])
    return np.array(reached.columns, dtype=float).T, np.array(reached.position, dtype=float)


def _frames(
    p: Array, R: Array, codes: Codes, offset: Array, m: Array, free: tuple[bool, bool],
    base: tuple[Array, Array],
) -> tuple[Array, Array, Array]:  # fmt: skip
    R_b, t_b = base
    if all(free):
        R_b = _rotation_of_base(p, R, codes, len(offset), m)
        offset = _offsets(p, R, codes, len(offset), m @ R_b, shift=True)
    if free[1] and not free[0]:
        return R_b, t_b, _offsets(p, R, codes, len(offset), (m - t_b) @ R_b, shift=False)
    reached = p + np.einsum("nij,nj->ni", R, offset[codes])
    return *kabsch(reached, m), offset


def _rotation_of_base(p: Array, R: Array, codes: Codes, tools: int, m: Array) -> Array:
    n = len(p)
    centre = m.mean(axis=0)  # far from the tracker, the columns of a coordinate and of the shift would be alike
    A = np.zeros((n, 3, 12 + 3 * tools))
    for i in range(3):
        A[:, i, 3 * i : 3 * i + 3] = m - centre
        A[:, i, 9 + i] = 1.0
    _tool_columns(A, R, codes, 12)
    solution = np.linalg.lstsq(A.reshape(3 * n, -1), p.ravel(), rcond=1e-9)[0]
    return nearest_rotation(np.asarray(solution[:9].reshape(3, 3))).T


def _offsets(p: Array, R: Array, codes: Codes, tools: int, turned: Array, *, shift: bool) -> Array:
    n = len(p)
    A = np.zeros((n, 3, 3 + 3 * tools))
    if shift:
        A[:, range(3), range(3)] = 1.0
    _tool_columns(A, R, codes, 3)
    solution = np.linalg.lstsq(A.reshape(3 * n, -1), (p - turned).ravel(), rcond=1e-9)[0]
    return np.asarray(solution[3:].reshape(tools, 3))


def _tool_columns(A: Array, R: Array, codes: Codes, first: int) -> None:
    for k in range(int(codes.max(initial=0)) + 1):
        mine = codes == k
        A[mine, :, first + 3 * k : first + 3 * k + 3] = -R[mine]


def _sockets(
    p: Array, R: Array, codes: Codes, offset: Array, point: Codes, points: int, free: bool
) -> tuple[Array, Array]:
    if free:
        # The points are means: without them, only how far each row strays from the mean of its point is left.
        A = np.zeros((len(p), 3, 3 * len(offset)))
        _tool_columns(A, R, codes, 0)
        own = np.unique(point, return_inverse=True)[1]
        A, b = A - group_means(A, own)[own], p - group_means(p, own)[own]
        solution = np.linalg.lstsq(A.reshape(3 * len(p), -1), b.ravel(), rcond=1e-9)[0]
        offset = np.asarray(solution.reshape(len(offset), 3))
    reached = p + np.einsum("nij,nj->ni", R, offset[codes])
    middle = np.zeros((points, 3))
    for k in np.unique(point):
        middle[k] = reached[point == k].mean(axis=0)
    return offset, middle


def rpy(R: Array) -> dict[str, float]:
    """Roll, pitch, yaw of ``R = Rz(yaw) Ry(pitch) Rx(roll)``."""
    pitch = math.atan2(-R[2, 0], math.hypot(R[0, 0], R[1, 0]))
    if math.hypot(R[0, 0], R[1, 0]) < 1e-9:  # only a sum of roll and yaw is left: all of it into yaw
        roll, yaw = 0.0, math.atan2(-R[0, 1], R[1, 1])
    else:
        roll, yaw = math.atan2(R[2, 1], R[2, 2]), math.atan2(R[1, 0], R[0, 0])
    return {"roll": roll, "pitch": pitch, "yaw": yaw}


def frame_rotation(factors: Sequence[Factor], turns: Mapping[str, float]) -> Array:
    """Rotation (3, 3) of a frame whose named turns have these values beside their nominal ones."""
    named = {factor.parameter: turns[factor.parameter.rpartition(".")[2]] for factor in factors if _turn(factor)}
    return np.array(walk(factors, factor_values(factors, [], named)).columns, dtype=float).T


def _turn(factor: Factor) -> bool:
    return factor.kind == "rotate" and bool(factor.parameter)


def _angles(factors: Sequence[Factor], R: Array) -> dict[str, float]:
    """The named turns of a frame whose rotation is ``R``: what its constant turns leave over."""
    constant = [factor for factor in factors if factor.kind == "rotate" and not factor.parameter]
    before = np.array(walk(constant, [factor.nominal for factor in constant]).columns, dtype=float).T
    found = rpy(before.T @ R)
    names = [factor.parameter for factor in factors if _turn(factor)]
    return {name: found[name.rpartition(".")[2]] for name in names}
