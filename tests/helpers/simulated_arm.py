"""Arms with hidden errors, many postures at once, by the textbook products; without a line of the package."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

DEG = np.pi / 180


def turn(axis: int, angle: Any) -> np.ndarray:
    """(N, 4, 4) or (4, 4) rotation about a coordinate axis."""
    angle = np.asarray(angle, dtype=float)
    T = np.zeros((*angle.shape, 4, 4))
    T[..., range(4), range(4)] = 1.0
    i, j = (axis + 1) % 3, (axis + 2) % 3
    T[..., i, i] = T[..., j, j] = np.cos(angle)
    T[..., j, i] = np.sin(angle)
    T[..., i, j] = -T[..., j, i]
    return T


def shift(x: Any, y: Any, z: Any) -> np.ndarray:
    """(N, 4, 4) or (4, 4) translation."""
    x, y, z = np.broadcast_arrays(*(np.asarray(v, dtype=float) for v in (x, y, z)))
    T = np.zeros((*x.shape, 4, 4))
    T[..., range(4), range(4)] = 1.0
    T[..., 0, 3], T[..., 1, 3], T[..., 2, 3] = x, y, z
    return T


@dataclass(frozen=True)
class SimulatedArm:
    """A DH (Siciliano 2.52, with Hayati's beta) or MDH (Craig 3.6) arm that is not as its drawing says.

    ``table`` has rows (name, type, theta, d, a, alpha) [rad, m]; ``errors`` are what the drawing does not know.
    """

    table: tuple[tuple[Any, ...], ...]
    errors: dict[str, float] = field(default_factory=dict)
    kind: str = "dh"
    base: np.ndarray = field(default_factory=lambda: np.eye(4))
    tool: np.ndarray = field(default_factory=lambda: np.eye(4))

    def poses(self, q: np.ndarray) -> np.ndarray:
        """(N, 4, 4) T_world_tool at postures (N, n)."""
        T = np.broadcast_to(self.base, (len(q), 4, 4))
        for (name, kind, theta, d, a, alpha), value in zip(self.table, q.T, strict=True):
            e = {key: self.errors.get(f"{name}.{key}", 0.0) for key in ("theta", "d", "a", "alpha", "beta")}
            moved = theta + e["theta"] + value * (kind == "revolute"), d + e["d"] + value * (kind == "prismatic")
            screw = turn(2, moved[0]) @ shift(0, 0, moved[1])
            link = [shift(a + e["a"], 0, 0), turn(0, alpha + e["alpha"])]
            T = (
                T @ screw @ link[0] @ link[1] @ turn(1, e["beta"])
                if self.kind == "dh"
                else T @ link[1] @ link[0] @ screw
            )
        return T @ self.tool

    def points(self, q: np.ndarray) -> np.ndarray:
        """(N, 3) tool points."""
        return self.poses(np.atleast_2d(q))[:, :3, 3]

    def section(self, limits: tuple[str, str] = ("-180 deg", "180 deg"), **more: Any) -> dict[str, Any]:
        """The drawing as the ``robot`` section of a problem file."""
        joints = [
            {
                "name": name, "type": kind, "theta": f"{theta!r} rad", "d": f"{d!r} m", "a": f"{a!r} m",
                "alpha": f"{alpha!r} rad", "limits": list(limits) if kind == "revolute" else ["0 mm", "300 mm"],
            }
            for name, kind, theta, d, a, alpha in self.table
        ]  # fmt: skip
        return {"kind": self.kind, "joints": joints, **more}

    def drawn(self, n: int, rng: np.random.Generator, reach: float = 2.5) -> np.ndarray:
        """(N, n) random postures, the slides within their 300 mm."""
        turning = np.array([row[1] == "revolute" for row in self.table])
        return np.where(turning, rng.uniform(-reach, reach, (n, len(turning))), rng.uniform(0, 0.3, (n, len(turning))))


SIX = (
    ("j1", "revolute", 0.0, 0.13, 0.0, np.pi / 2), ("j2", "revolute", 0.0, 0.0, -0.6, 0.0),
    ("j3", "revolute", 0.0, 0.0, -0.57, 0.0), ("j4", "revolute", 0.0, 0.16, 0.0, np.pi / 2),
    ("j5", "revolute", 0.0, 0.12, 0.0, -np.pi / 2), ("j6", "revolute", 0.0, 0.09, 0.0, 0.0),
)  # fmt: skip
"""Six joints about as those of a UR10."""
