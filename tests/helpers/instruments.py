"""Simulated instruments at a DH arm with hidden errors: matrices of its own, nothing from the package."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

UR10 = np.array(
    [
        # d [m], a [m], alpha [rad]; data sheet of Universal Robots
        [0.1273, 0.0, np.pi / 2],
        [0.0, -0.612, 0.0],
        [0.0, -0.5723, 0.0],
        [0.163941, 0.0, np.pi / 2],
        [0.1157, 0.0, -np.pi / 2],
        [0.0922, 0.0, 0.0],
    ]
)
JOINTS = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")


@dataclass
class TrueArm:
    """A UR10 with a ball on its flange, errors of its geometry, and perhaps backlash in one joint."""

    tool: np.ndarray = field(default_factory=lambda: np.array([0.03, -0.02, 0.12]))
    errors: np.ndarray = field(default_factory=lambda: np.zeros((6, 4)))  # theta, d, a, alpha
    backlash: tuple[int, float] = (0, 0.0)
    beta: np.ndarray = field(default_factory=lambda: np.zeros(6))  # turns about y behind each link, of a model

    def error_of(self, name: str) -> float:
        """The true deviation of a parameter as the program names it [rad or m]."""
        joint, _, kind = name.rpartition(".")
        kinds = ("theta", "d", "a", "alpha")
        return float(self.errors[JOINTS.index(joint), kinds.index(kind)]) if kind in kinds else 0.0

    def pose(self, q: np.ndarray, side: np.ndarray | None = None) -> np.ndarray:
        """(N, 4, 4) of the ball's frame in the base, for postures (N, 6) and sides of approach (N, 6)."""
        T = np.broadcast_to(np.eye(4), (len(q), 4, 4))
        for i, ((d, a, alpha), (et, ed, ea, el)) in enumerate(zip(UR10, self.errors, strict=True)):
            theta = q[:, i] + et
            if side is not None and i == self.backlash[0]:
                theta = theta - self.backlash[1] * side[:, i] / 2
            A = np.zeros((len(q), 4, 4))
            c, s, ca, sa = np.cos(theta), np.sin(theta), np.cos(alpha + el), np.sin(alpha + el)
            A[:, 0, :3] = np.stack([c, -s * ca, s * sa], axis=1)
            A[:, 1, :3] = np.stack([s, c * ca, -c * sa], axis=1)
            A[:, 0, 3], A[:, 1, 3], A[:, 2, 3] = (a + ea) * c, (a + ea) * s, d + ed
            A[:, 2, 1], A[:, 2, 2], A[:, 3, 3] = sa, ca, 1.0
            cb, sb = np.cos(self.beta[i]), np.sin(self.beta[i])
            T = T @ A @ np.array([[cb, 0, sb, 0], [0, 1, 0, 0], [-sb, 0, cb, 0], [0, 0, 0, 1]])
        T = T.copy()
        T[:, :3, 3] += T[:, :3, :3] @ self.tool
        return T

    def point(self, q: np.ndarray, side: np.ndarray | None = None) -> np.ndarray:
        """(N, 3) the ball's centre."""
        return self.pose(q, side)[:, :3, 3]

    @classmethod
    def drawn(cls, rng: np.random.Generator, size: float = 5e-4, **more: object) -> TrueArm:
        """Errors of 0.5 mm and 0.5 mrad in all parameters."""
        return cls(errors=rng.normal(0, size, (6, 4)), **more)  # type: ignore[arg-type]


def misplaced(values: dict[str, float], q: np.ndarray, truth: np.ndarray, tool: bool = False) -> float:
    """RMS distance [m] of an arm with these parameters from true points (N, 3), the base aligned to them (Kabsch).

    With ``tool`` its offset is aligned too.
    """
    found = TrueArm(tool=np.array([values[f"tool.{axis}"] for axis in "xyz"]))
    for i, (joint, (d, a, alpha)) in enumerate(zip(JOINTS, UR10, strict=True)):
        for k, (kind, nominal) in enumerate(zip(("theta", "d", "a", "alpha"), (0.0, d, a, alpha), strict=True)):
            found.errors[i, k] = values.get(f"{joint}.{kind}", nominal) - nominal
        found.beta[i] = values.get(f"{joint}.beta", 0.0)
    p = found.point(q)
    if tool:  # to first order, beside small shifts and turns of the base
        T = found.pose(q)
        turned = np.stack([np.cross(e, p) for e in np.eye(3)], axis=2)
        A = np.concatenate([T[:, :3, :3], np.broadcast_to(np.eye(3), (len(q), 3, 3)), turned], axis=2)
        offset = np.linalg.lstsq(A.reshape(-1, 9), (truth - p).ravel(), rcond=None)[0][:3]
        p = p + T[:, :3, :3] @ offset
    U, _, Vt = np.linalg.svd((truth - truth.mean(axis=0)).T @ (p - p.mean(axis=0)))
    R = U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt
    left = (p - p.mean(axis=0)) @ R.T - (truth - truth.mean(axis=0))
    return float(np.sqrt(np.mean(np.sum(left**2, axis=1))))


def postures(rng: np.random.Generator, n: int) -> np.ndarray:
    """(n, 6) in front of the arm, elbow up, every joint moving."""
    low = np.array([-1.2, -2.2, 0.6, -2.2, -2.2, -2.5])
    high = np.array([1.2, -0.7, 2.2, 0.2, -0.6, 2.5])
    return rng.uniform(low, high, (n, 6))


def touching(arm: TrueArm, q: np.ndarray, normal: np.ndarray, distance: np.ndarray, side: np.ndarray) -> np.ndarray:
    """Postures near q (N, 6) at which the ball's centre has ``normal · p = distance``: Newton steps of least length."""
    for _ in range(12):
        left = arm.point(q, side) @ normal - distance
        slope = np.stack([arm.point(q + h, side) @ normal - distance - left for h in 1e-6 * np.eye(6)], axis=1) / 1e-6
        q = q - slope * (left / np.sum(slope**2, axis=1))[:, None]
    return q


def table_of(q: np.ndarray, **columns: object) -> dict[str, object]:
    """A table of measurements: joints in radians and further columns."""
    return {**{f"{name} [rad]": q[:, i] for i, name in enumerate(JOINTS)}, **columns}


PLANES = (
    (np.array([0.0, 0.0, 1.0]), -0.10),
    (np.array([0.9, 0.1, 0.42]) / np.linalg.norm([0.9, 0.1, 0.42]), 0.95),
    (np.array([0.25, 0.9, 0.35]) / np.linalg.norm([0.25, 0.9, 0.35]), 0.45),
)


def plane_table(
    arm: TrueArm, rng: np.random.Generator, each: int, sigma: float, radius: float = 0.005
) -> dict[str, object]:
    """Touches of three planes, radius of the ball counted on the side of the arm; sides of approach stated."""
    rows, names, sides = [], [], []
    for k, (normal, distance) in enumerate(PLANES):
        toward = 1.0 if distance < 0 else -1.0  # the base, at the origin, is on this side of the plane
        side = rng.choice([-1.0, 1.0], (3 * each, 6))
        reached = distance + toward * radius + rng.normal(0, sigma, 3 * each)
        q = touching(arm, postures(rng, 3 * each), normal, reached, side)
        near = np.abs(arm.point(q, side) @ normal - reached) < 1e-9
        kept = np.flatnonzero(near & np.all(np.abs(q) < 3.1, axis=1))[:each]
        assert len(kept) == each
        rows += list(q[kept])
        names += [f"plate{k}"] * each
        sides += list(side[kept])
    q, side = np.array(rows), np.array(sides)
    return table_of(q, plane=np.array(names), **{f"{name}.approach": side[:, i] for i, name in enumerate(JOINTS)})


ANCHORS = np.array([[0.7, 0.0, -0.6], [0.3, 0.9, 0.0], [0.3, -0.8, 0.3], [1.1, 0.3, 0.9]])


def distance_table(
    arm: TrueArm, rng: np.random.Generator, each: int, sigma: float, offset: float = 0.0
) -> dict[str, object]:
    """Lengths of a wire from four anchors, up to a constant ``offset``; sides of approach stated."""
    q = postures(rng, each * len(ANCHORS))
    side = rng.choice([-1.0, 1.0], q.shape)
    code = np.arange(len(q)) % len(ANCHORS)
    p = arm.point(q, side)
    length = np.linalg.norm(p - ANCHORS[code], axis=1) + offset + rng.normal(0, sigma, len(q))
    names = np.array([f"bar{k}" for k in code])
    return table_of(
        q, anchor=names, **{"distance [m]": length},
        **{f"{name}.approach": side[:, i] for i, name in enumerate(JOINTS)},
    )  # fmt: skip


MOUNTING = np.array([[0.8, 0.6, 0.0], [-0.6, 0.8, 0.0], [0.0, 0.0, 1.0]])
"""Axes of the inclinometer in the frame of the tool, as columns."""


def level_table(arm: TrueArm, rng: np.random.Generator, n: int, sigma: float) -> dict[str, object]:
    """Angles of both axes of an inclinometer on the tool; sides of approach stated."""
    q = postures(rng, n)
    side = rng.choice([-1.0, 1.0], q.shape)
    axes = arm.pose(q, side)[:, :3, :3] @ MOUNTING
    angles = np.arcsin(axes[:, 2, :2]) + rng.normal(0, sigma, (n, 2))
    shown = {f"level_{axis} [deg]": np.degrees(column) for axis, column in zip("xy", angles.T, strict=True)}
    return table_of(q, **shown, **{f"{name}.approach": side[:, i] for i, name in enumerate(JOINTS)})


def tracker_table(arm: TrueArm, rng: np.random.Generator, n: int, sigma: float, T: np.ndarray) -> dict[str, object]:
    """Positions in the frame of a tracker; T (4, 4) takes the base to it."""
    q = postures(rng, n)
    p = arm.point(q) @ T[:3, :3].T + T[:3, 3] + rng.normal(0, sigma, (n, 3))
    return table_of(q, **{f"{axis} [m]": p[:, i] for i, axis in enumerate("xyz")})


def mixed_table(tables: dict[str, dict[str, object]]) -> dict[str, list[object]]:
    """The rows of several instruments, by name: cells that one does not fill are empty."""
    keys = list(dict.fromkeys(key for table in tables.values() for key in table))
    found: dict[str, list[object]] = {key: [] for key in (*keys, "instrument")}
    for name, table in tables.items():
        n = len(table[f"{JOINTS[0]} [rad]"])  # type: ignore[arg-type]
        for key in keys:
            empty = float("nan") if key.endswith("]") else ""
            found[key] += list(table[key]) if key in table else [empty] * n  # type: ignore[call-overload]
        found["instrument"] += [name] * n
    return found


SOCKETS = np.array([[0.6, -0.4, 0.2], [0.8, 0.3, 0.4], [0.5, 0.5, 0.1], [0.9, 0.0, 0.6]])


def socket_table(arm: TrueArm, rng: np.random.Generator, each: int, sigma: float) -> dict[str, object]:
    """Touches of four sockets, with the play of the ball in every coordinate; damped Newton steps lead there."""
    rows: list[np.ndarray] = []
    for socket in SOCKETS:
        own: list[np.ndarray] = []
        while len(own) < each:
            q = postures(rng, 4 * each)
            goal = socket + rng.normal(0, sigma, (len(q), 3))
            for _ in range(40):
                J = np.stack([(arm.point(q + h) - arm.point(q)) / 1e-6 for h in 1e-6 * np.eye(6)], axis=2)
                step = np.einsum("nij,nj->ni", np.linalg.pinv(J, rcond=1e-2), goal - arm.point(q))
                q = q + np.clip(step, -0.3, 0.3)
            there = np.linalg.norm(goal - arm.point(q), axis=1) < 1e-8
            own += list(q[there & np.all(np.abs(q) < 3.1, axis=1)])
        rows += own[:each]
    return table_of(np.array(rows), point=np.repeat([f"socket{k}" for k in range(len(SOCKETS))], each))


def deviations(found: Any, arm: TrueArm) -> np.ndarray:
    """Of determined geometry of a calibration from the truth, in standard errors."""
    rows = zip(found.parameters, found.x, found.std, found.fixed, strict=True)
    return np.array([(x - arm.error_of(p.name)) / std for p, x, std, fixed in rows if p.group == "geometry" and fixed])


def pose_table(
    arm: TrueArm, rng: np.random.Generator, n: int, sigmas: tuple[float, float], T: np.ndarray, mount: np.ndarray
) -> dict[str, object]:
    """Poses in the frame of a tracker that T (4, 4) takes the base to, as unit quaternions; sides of approach stated.

    Args:
        sigmas: of a coordinate [m] and of a component of the rotation vector [rad]; mount: (3, 3) of the target.
    """
    q = postures(rng, n)
    side = rng.choice([-1.0, 1.0], q.shape)
    at = T @ arm.pose(q, side)
    p = at[:, :3, 3] + rng.normal(0, sigmas[0], (n, 3))
    noise = Rotation.from_rotvec(rng.normal(0, sigmas[1], (n, 3)))
    turned = (noise * Rotation.from_matrix(at[:, :3, :3] @ mount)).as_quat(scalar_first=True)
    columns = {f"{axis} [m]": p[:, i] for i, axis in enumerate("xyz")}
    columns |= {f"{name}.approach": side[:, i] for i, name in enumerate(JOINTS)}
    return table_of(q, **columns, **dict(zip(("qw", "qx", "qy", "qz"), turned.T, strict=True)))
