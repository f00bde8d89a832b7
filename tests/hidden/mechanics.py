"""Kinematics and statics of a serial chain by elementary transforms, for all rows at once; NumPy only.

``T_world_tool`` is the product of elementary translations along and rotations about coordinate axes. Gravity acts on
links and payload; the torque of a joint is the one that gravity exerts ON it, so that a soft joint moves in its
direction: τ_j = z_j · Σ_{k ≥ j} (c_k − o_j) × m_k g, and z_j · Σ m_k g for a prismatic joint. The payload hangs in the
tool point.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

Array = np.ndarray


@dataclass(frozen=True)
class Factor:
    """Rotation (``R``) about or translation (``T``) along axis 0, 1, 2 by ``value + deviation + sign q[joint]``."""

    kind: str
    axis: int
    value: float
    name: str = ""
    joint: int = -1
    sign: float = 1.0


@dataclass(frozen=True, eq=False)
class Arm:
    """A serial arm: ``links[j]`` ends in the frame in which ``coms[j]`` of the link behind joint j is given."""

    name: str
    kind: str  # dh or urdf, the format of its file
    joints: tuple[str, ...]
    prismatic: tuple[bool, ...]
    lower: Array
    upper: Array
    links: tuple[tuple[Factor, ...], ...]
    base: tuple[Factor, ...]
    tool: tuple[Factor, ...]
    masses: Array
    coms: Array
    gear: Array
    gravity: Array
    measured: tuple[int, ...] = (0, 1, 2)
    parallel: tuple[int, ...] = ()  # joints behind which a nearly parallel axis follows
    urdf: str = ""

    @property
    def n(self) -> int:
        return len(self.joints)

    @property
    def factors(self) -> tuple[Factor, ...]:
        return (*self.base, *(f for link in self.links for f in link), *self.tool)

    @property
    def lengths(self) -> tuple[str, ...]:
        """Names of the lengths of the links that are not zero."""
        return tuple(f.name for link in self.links for f in link if f.kind == "T" and f.name and f.value)

    def with_frames(self, base: Array, tool: Array) -> Arm:
        """The same arm with other values of the six factors of each frame."""
        pairs = ((self.base, base), (self.tool, tool))
        a, b = (tuple(replace(f, value=float(v)) for f, v in zip(fs, vs, strict=True)) for fs, vs in pairs)
        return replace(self, base=a, tool=b)


def frame(prefix: str, values: Array = np.zeros(6)) -> tuple[Factor, ...]:  # noqa: B008
    """x, y, z, roll, pitch, yaw as factors: Trans Rz(yaw) Ry(pitch) Rx(roll)."""
    x, y, z, roll, pitch, yaw = values
    steps = (("T", 0, x, "x"), ("T", 1, y, "y"), ("T", 2, z, "z"))
    turns = (("R", 2, yaw, "yaw"), ("R", 1, pitch, "pitch"), ("R", 0, roll, "roll"))
    return tuple(Factor(k, i, float(v), f"{prefix}.{n}") for k, i, v, n in (*steps, *turns))


@dataclass(frozen=True, eq=False)
class Walk:
    """Where everything stands: axes and origins (N, 3) of all factors and joints, link frames, tool point (N, 3)."""

    axes: list[Array]
    origins: list[Array]
    z: Array  # (N, n, 3)
    o: Array  # (N, n, 3)
    R_link: Array  # (N, n, 3, 3)
    o_link: Array  # (N, n, 3)
    o_base: Array
    p: Array


Twists = Mapping[int, tuple[Array, Array]]


def walk(arm: Arm, q: Array, deviations: Mapping[str, object] | None = None, twists: Twists | None = None) -> Walk:
    """All frames at commands (N, n) with deviations of named parameters, each a number or (N,).

    ``twists[j]`` = (φ, δ), (N, 3) each, turns and shifts the frame behind link j by exp(φ) and δ, seen in it;
    ``twists[-1]`` does so behind the base.
    """
    deviations, twists = deviations or {}, twists or {}
    N, n = len(q), arm.n
    R, o = np.tile(np.eye(3), (N, 1, 1)), np.zeros((N, 3))
    axes, origins = [], []
    z, at = np.zeros((N, n, 3)), np.zeros((N, n, 3))
    R_link, o_link = np.zeros((N, n, 3, 3)), np.zeros((N, n, 3))
    o_base = o
    for j, group in enumerate((arm.base, *arm.links, arm.tool), -1):
        for f in group:
            axes.append(R[:, :, f.axis].copy())
            origins.append(o)
            if f.joint >= 0:
                z[:, f.joint], at[:, f.joint] = f.sign * R[:, :, f.axis], o
            value = f.value + np.asarray(deviations.get(f.name, 0.0))
            value = np.broadcast_to(value + (f.sign * q[:, f.joint] if f.joint >= 0 else 0.0), (N,))
            R, o = _step(R, o, f, value)
        if j in twists:
            phi, delta = twists[j]
            R, o = R @ exponential(phi), o + np.einsum("nij,nj->ni", R, delta)
        if j == -1:
            o_base = o
        elif j < n:
            R_link[:, j], o_link[:, j] = R, o
    return Walk(axes, origins, z, at, R_link, o_link, o_base, o)


def _step(R: Array, o: Array, f: Factor, value: Array) -> tuple[Array, Array]:
    if f.kind == "T":
        return R, o + R[:, :, f.axis] * value[:, None]
    i, j = (f.axis + 1) % 3, (f.axis + 2) % 3
    c, s = np.cos(value)[:, None], np.sin(value)[:, None]
    turned = R.copy()
    turned[:, :, i] = c * R[:, :, i] + s * R[:, :, j]
    turned[:, :, j] = c * R[:, :, j] - s * R[:, :, i]
    return turned, o


def exponential(phi: Array) -> Array:
    """(N, 3, 3) rotations by the vectors phi (N, 3), after Rodrigues."""
    angle = np.linalg.norm(phi, axis=1)
    unit = phi / np.where(angle > 0, angle, 1.0)[:, None]
    K = np.zeros((len(phi), 3, 3))
    K[:, 0, 1], K[:, 0, 2], K[:, 1, 2] = -unit[:, 2], unit[:, 1], -unit[:, 0]
    K -= K.transpose(0, 2, 1)
    return np.eye(3) + np.sin(angle)[:, None, None] * K + (1 - np.cos(angle))[:, None, None] * (K @ K)


def loads(arm: Arm, w: Walk, payload: Array) -> tuple[Array, Array]:
    """Points (N, n + 1, 3) in which gravity acts, and masses (N, n + 1): the links, then the payload."""
    centres = w.o_link + np.einsum("njab,jb->nja", w.R_link, arm.coms)
    points = np.concatenate([centres, w.p[:, None]], axis=1)
    return points, np.concatenate([np.tile(arm.masses, (len(payload), 1)), payload[:, None]], axis=1)


def moment(arm: Arm, w: Walk, payload: Array, about: Array, first: int) -> Array:
    """(N, 3) moment of gravity [N m], in the world, of links ``first`` … and payload about the points (N, 3)."""
    points, masses = loads(arm, w, payload)
    arms = ((points - about[:, None]) * masses[:, :, None])[:, first:].sum(axis=1)
    return np.cross(arms, arm.gravity)


def torques(arm: Arm, w: Walk, payload: Array) -> Array:
    """(N, n) torque [N m] or force [N] of gravity on each joint, along its axis."""
    tau = np.zeros((len(payload), arm.n))
    for j in range(arm.n):
        if arm.prismatic[j]:
            _, masses = loads(arm, w, payload)
            load = masses[:, j:].sum(axis=1)[:, None] * arm.gravity
        else:
            load = moment(arm, w, payload, w.o[:, j], j)
        tau[:, j] = np.einsum("ni,ni->n", w.z[:, j], load)
    return tau


def columns(w: Walk, arm: Arm) -> dict[str, Array]:
    """∂p/∂parameter (N, 3) of every named parameter."""
    found = {}
    for f, axis, origin in zip(arm.factors, w.axes, w.origins, strict=True):
        if f.name:
            found[f.name] = np.cross(axis, w.p - origin) if f.kind == "R" else axis
    return found
