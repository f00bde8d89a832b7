"""Two simulated UR10 whose tools touch: Newton steps lead the second arm to where the first one is."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import yaml

import posture_opt as po
from tests.helpers.instruments import JOINTS, TrueArm, postures, table_of

SECOND_BASE = np.array(
    [
        [np.cos(2.6), -np.sin(2.6), 0.0, 1.2],
        [np.sin(2.6), np.cos(2.6), 0.0, 0.3],
        [0.0, 0.0, 1.0, 0.05],
        [0.0, 0.0, 0.0, 1.0],
    ]
)
"""Of the second arm in the world of the first."""


def pair_table(
    one: TrueArm, two: TrueArm, rng: np.random.Generator, n: int, sigma: float, distance: float = 0.0
) -> dict[str, object]:
    """Touches of two arms, the second at `SECOND_BASE`; sides of approach of the first are stated."""
    rows: list[np.ndarray] = []
    while len(rows) < n:
        q, second = postures(rng, 4 * n), postures(rng, 4 * n)
        side = rng.choice([-1.0, 1.0], q.shape)
        goal = one.point(q, side)
        if distance:
            away = rng.normal(size=goal.shape)
            length = distance + rng.normal(0, sigma, (len(q), 1))
            goal = goal + away / np.linalg.norm(away, axis=1)[:, None] * length
        else:
            goal = goal + rng.normal(0, sigma, goal.shape)
        goal = (goal - SECOND_BASE[:3, 3]) @ SECOND_BASE[:3, :3]
        for _ in range(40):
            J = np.stack([(two.point(second + h) - two.point(second)) / 1e-6 for h in 1e-6 * np.eye(6)], axis=2)
            step = np.einsum("nij,nj->ni", np.linalg.pinv(J, rcond=1e-2), goal - two.point(second))
            second = second + np.clip(step, -0.3, 0.3)
        there = np.linalg.norm(goal - two.point(second), axis=1) < 1e-8
        there &= np.all(np.abs(second) < 3.1, axis=1)
        rows += list(np.concatenate([q, second, side], axis=1)[there])
    found = np.array(rows[:n])
    return table_of(
        found[:, :6],
        **{f"right.{name} [rad]": found[:, 6 + i] for i, name in enumerate(JOINTS)},
        **{f"{name}.approach": found[:, 12 + i] for i, name in enumerate(JOINTS)},
    )


def tool_at(*xyz: str, free: bool = True) -> dict[str, object]:
    """The section of a tool."""
    return {"xyz": list(xyz), "rpy": ["0 deg"] * 3, "free": free}


def pair_problem(folder: Path, tool: dict[str, object], second: dict[str, object], **pair: object) -> po.Problem:
    """A UR10 whose tool touches that of a second one, in files of ``folder``; ``pair`` is said of it."""
    robot = {"kind": "preset", "name": "ur10"}
    (folder / "right.yaml").write_text(yaml.safe_dump({"robot": {**robot, "tool": second}}))
    return po.problem_from_dict(
        {
            "robot": {**robot, "tool": tool},
            "uncertainty": {"measurement": {"pair": "0.02 mm"}},
            "data": {"pairs": {"right": {"problem": "right.yaml", **pair}}},
        },
        folder=folder,
    )


def ur10_problem(measurement: dict[str, str], tool: Any = None, data: Any = None, **robot: Any) -> po.Problem:
    """Of the preset with a tool about where that of the simulated arms is, which is to be found."""
    held = {"kind": "preset", "name": "ur10", "tool": tool or tool_at("30 mm", "-20 mm", "120 mm"), **robot}
    more = {"data": data} if data else {}
    return po.problem_from_dict({"robot": held, "uncertainty": {"measurement": measurement}, **more})
