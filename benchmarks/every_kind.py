"""Every kind of measurement on several arms, from the raw file to the extended model and the plan of the next rows.

`python -m benchmarks.every_kind`, some minutes; `--arms scara --kinds plane` for a look. Each arm is off by 0.5 mm and
0.5 mrad in every parameter (one σ), and its second joint has 1 mrad of backlash; the simulator is the tests' own. The
table of docs/how-to/instruments/which.md.
"""

from __future__ import annotations

import argparse
import csv
import json
import math
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

import posture_opt as po
from benchmarks.machine import machine_line
from benchmarks.tables import table
from tests.changes.test_recheck import TABLES
from tests.helpers.cameras import TrueCamera, grid
from tests.helpers.command_line import invoke
from tests.helpers.simulated_arm import SimulatedArm, shift, turn

Columns = dict[str, Any]
BACKLASH = 1e-3  # rad, the whole width
ROWS = 90
TOOL = np.array([0.03, -0.02, 0.12])
SIGMA = {
    "position": {"position": "0.02 mm"},
    "pose": {"position": "0.02 mm", "orientation": "0.05 mrad"},
    "point": {"position": "0.05 mm"},
    "plane": {"plane": "0.02 mm"},
    "distance": {"distance": "0.01 mm"},
    "level": {"level": "0.02 mrad"},
    "camera in the cell": {"pixel": "0.1 px"},
    "camera on the tool": {"pixel": "0.1 px"},
}


@dataclass(frozen=True)
class Robot:
    """A simulated arm, its preset, and where its joints may be."""

    name: str
    arm: SimulatedArm
    low: np.ndarray
    high: np.ndarray

    @classmethod
    def drawn(cls, name: str, rng: np.random.Generator) -> Robot:
        """An arm with errors in every parameter, and a tool that sticks out aside."""
        kind, rows = TABLES[name]
        errors = {f"{row[0]}.{p}": rng.normal(0, 0.5e-3) for row in rows for p in ("theta", "d", "a", "alpha")}
        preset = po.problem_from_dict({"robot": {"kind": "preset", "name": name}}).robot
        low, high = np.maximum(preset.lower, -2.8), np.minimum(preset.upper, 2.8)
        arm = SimulatedArm(rows, errors, kind, tool=shift(*TOOL) @ turn(0, 0.3))
        return cls(name, arm, low, high)

    def postures(self, rng: np.random.Generator, n: int) -> np.ndarray:
        return rng.uniform(self.low, self.high, (n, len(self.low)))

    def stood(self, q: np.ndarray, side: np.ndarray) -> np.ndarray:
        """(N, n) where the joints are at commanded values, arriving from a side (N,) of the second joint."""
        found = q.copy()
        found[:, 1] -= BACKLASH / 2 * side
        return found

    def poses(self, q: np.ndarray, side: np.ndarray) -> np.ndarray:
        return self.arm.poses(self.stood(q, side))

    def reaching(
        self, rng: np.random.Generator, n: int, error: Callable[[np.ndarray], np.ndarray]
    ) -> tuple[np.ndarray, np.ndarray]:
        """(n, joints) postures where ``error`` of poses is zero, by damped Newton steps, and sides of approach (n,)."""
        found, sides = np.zeros((0, len(self.low))), np.zeros(0)
        while len(found) < n:
            q, side = self.postures(rng, 4 * n), rng.choice([-1.0, 1.0], 4 * n)
            for _ in range(40):
                e = error(self.poses(q, side))
                steps = 1e-6 * np.eye(q.shape[1])
                J = np.stack([(error(self.poses(q + h, side)) - e) / 1e-6 for h in steps], axis=2)
                q = q - np.einsum("nij,nj->ni", np.linalg.pinv(J, rcond=1e-2), e).clip(-0.3, 0.3)
            good = np.linalg.norm(error(self.poses(q, side)), axis=1) < 1e-9
            good &= np.all((q >= self.low) & (q <= self.high), axis=1)
            found, sides = np.concatenate([found, q[good]]), np.concatenate([sides, side[good]])
        return found[:n], sides[:n]

    def columns(self, q: np.ndarray, side: np.ndarray, shown: Mapping[str, Any]) -> Columns:
        units = ["m" if row[1] == "prismatic" else "rad" for row in self.arm.table]
        names = [row[0] for row in self.arm.table]
        joints = {f"{n} [{u}]": c for n, u, c in zip(names, units, q.T, strict=True)}
        return {**joints, f"{names[1]}.approach": side.astype(int), **shown}


def position_rows(robot: Robot, rng: np.random.Generator, turned: bool = False) -> Columns:
    q, side = robot.postures(rng, ROWS), rng.choice([-1.0, 1.0], ROWS)
    T = robot.poses(q, side)
    p = T[:, :3, 3] + rng.normal(0, 2e-5, (ROWS, 3))
    shown = {f"{axis} [m]": p[:, i] for i, axis in enumerate("xyz")}
    if turned:
        from scipy.spatial.transform import Rotation

        noise = Rotation.from_rotvec(rng.normal(0, 5e-5, (ROWS, 3)))
        R = (noise * Rotation.from_matrix(T[:, :3, :3])).as_quat(scalar_first=True)
        shown |= dict(zip(("qw", "qx", "qy", "qz"), R.T, strict=True))
    return robot.columns(q, side, shown)


def pose_rows(robot: Robot, rng: np.random.Generator) -> Columns:
    return position_rows(robot, rng, turned=True)


def point_rows(robot: Robot, rng: np.random.Generator) -> Columns:
    """Four sockets, somewhere within reach, and how far two of them are apart."""
    middle = 0.7 * robot.low + 0.3 * robot.high, 0.3 * robot.low + 0.7 * robot.high
    sockets = robot.arm.points(rng.uniform(*middle, (4, len(robot.low))))
    each = ROWS // 4

    def played(socket: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
        goal = socket + rng.normal(0, 5e-5, (4 * each, 3))
        return lambda T: T[:, :3, 3] - goal

    parts = [robot.reaching(rng, each, played(socket)) for socket in sockets]
    q, side = (np.concatenate(part) for part in zip(*parts, strict=True))
    return robot.columns(q, side, {"point": np.repeat([f"socket{k}" for k in range(4)], each)})


def plane_rows(robot: Robot, rng: np.random.Generator) -> Columns:
    """Three plates, inclined to each other, within reach."""
    points = robot.arm.points(robot.postures(rng, 200))
    parts, each = [], ROWS // 3
    for normal in ([0.1, 0.2, 1.0], [1.0, 0.3, 0.4], [0.2, 1.0, -0.4]):
        n = np.array(normal) / np.linalg.norm(normal)
        reached = np.quantile(points @ n, 0.6) + rng.normal(0, 2e-5, 4 * each)
        parts.append(robot.reaching(rng, each, _above(n, reached)))
    q, side = (np.concatenate(part) for part in zip(*parts, strict=True))
    return robot.columns(q, side, {"plane": np.repeat([f"plate{k}" for k in range(3)], each)})


def _above(normal: np.ndarray, reached: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    """How far poses are above a plane, each at the height (N,) that it reached."""
    return lambda T: (T[:, :3, 3] @ normal - reached)[:, None]


def distance_rows(robot: Robot, rng: np.random.Generator) -> Columns:
    """Lengths of a wire from four anchors around the arm."""
    q, side = robot.postures(rng, ROWS), rng.choice([-1.0, 1.0], ROWS)
    p = robot.poses(q, side)[:, :3, 3]
    spread = np.array([[1, 0.2, -1], [-0.3, 1, 0.4], [0.2, -1, 1], [1.1, 0.6, 0.9]]) * np.ptp(p, axis=0).max()
    code = np.arange(ROWS) % 4
    length = np.linalg.norm(p - (p.mean(axis=0) + 0.7 * spread)[code], axis=1) + rng.normal(0, 1e-5, ROWS)
    return robot.columns(q, side, {"distance [m]": length, "anchor": np.array([f"anchor{k}" for k in code])})


def level_rows(robot: Robot, rng: np.random.Generator) -> Columns:
    q, side = robot.postures(rng, ROWS), rng.choice([-1.0, 1.0], ROWS)
    up = robot.poses(q, side)[:, 2, :2]
    angles = np.degrees(np.arcsin(up) + rng.normal(0, 2e-5, up.shape))
    return robot.columns(q, side, {f"level_{axis} [deg]": angles[:, i] for i, axis in enumerate("xy")})


def camera_rows(robot: Robot, rng: np.random.Generator, on_tool: bool = False) -> Columns:
    """Pictures of a chessboard on the tool by a camera in the cell, or the other way about; whole boards only."""
    corners = grid() - grid().mean(axis=0)
    carried = shift(-0.05, 0.03, 0.02) @ turn(0, 0.3) @ turn(1, -0.2)
    middle = robot.arm.poses(0.5 * (robot.low + robot.high)[None] + 0.1)[0]
    apart = shift(0, 0, 0.9) @ turn(0, math.pi)  # what looks at the board, from the board
    if on_tool:
        camera = TrueCamera(carried)
        board = middle @ carried @ np.linalg.inv(apart)
    else:
        camera, board = TrueCamera(middle @ carried @ apart), carried
    kept: list[tuple[np.ndarray, float, np.ndarray]] = []
    while len(kept) < 30:
        near = 0.5 * (robot.low + robot.high) + rng.uniform(-0.3, 0.3, (400, len(robot.low))) * (robot.high - robot.low)
        side = rng.choice([-1.0, 1.0], len(near))
        for q, s, T in zip(near, side, robot.poses(near, side), strict=True):
            points = (T if not on_tool else np.eye(4)) @ board @ np.c_[corners, np.ones(len(corners))].T
            local = (np.linalg.inv(T) @ points if on_tool else points)[:3].T
            with np.errstate(invalid="ignore"):
                uv = camera.pixels(local)
                whole = bool(camera.seen(uv).all()) and float(np.ptp(uv[:, 0])) > 80
            if whole:
                kept.append((q, s, uv))
    kept = kept[:30]
    uv = np.concatenate([row[2] for row in kept]) + rng.normal(0, 0.1, (30 * len(corners), 2))
    q, side = (np.repeat(np.array([row[i] for row in kept]), len(corners), axis=0) for i in (0, 1))
    shown = {"marker": np.tile([f"board/{k}" for k in range(len(corners))], 30), "camera": np.array(["left"] * len(q))}
    return robot.columns(q, side, {**shown, "u [px]": uv[:, 0], "v [px]": uv[:, 1]})


def tool_camera_rows(robot: Robot, rng: np.random.Generator) -> Columns:
    return camera_rows(robot, rng, on_tool=True)


MAKERS: dict[str, Callable[[Robot, np.random.Generator], Columns]] = {
    "position": position_rows, "pose": pose_rows, "point": point_rows, "plane": plane_rows, "distance": distance_rows,
    "level": level_rows, "camera in the cell": camera_rows, "camera on the tool": tool_camera_rows,
}  # fmt: skip


def problem_file(folder: Path, name: str, kind: str) -> Path:
    """The arm as its user would state it."""
    frame = {"xyz": [f"{1e3 * v:g} mm" for v in TOOL], "rpy": ["0.3 rad", "0 rad", "0 rad"]}
    camera = kind.startswith("camera")
    robot: dict[str, Any] = {"kind": "preset", "name": name, "tool": frame if camera else {**frame, "free": True}}
    document: dict[str, Any] = {"robot": robot, "uncertainty": {"measurement": SIGMA[kind]}}
    if kind in ("position", "pose"):
        robot["base"] = "free"
    if camera:
        (folder / "left.yaml").write_text(TrueCamera(np.eye(4)).text(), encoding="utf-8")
        mount, on = ("tool", "cell") if kind.endswith("tool") else ("cell", "tool")
        board = {"rows": 6, "columns": 8, "square": "25 mm"}
        document["data"] = {
            "cameras": {"left": {"mount": mount, "intrinsics": "left.yaml"}},
            "markers": {"board": {"on": on, "chessboard": board}},
        }
    path = folder / "problem.yaml"
    path.write_text(yaml.safe_dump(document), encoding="utf-8")
    return path


def written(folder: Path, columns: Columns) -> Path:
    """The raw file."""
    path = folder / "data.csv"
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(columns)
        writer.writerows(zip(*columns.values(), strict=True))
    return path


def tool_error(problem: po.Problem, robot: Robot, aligned_tool: bool) -> float:
    """RMS error [mm] of the model's tool at 60 other postures; base, and perhaps tool, aligned to first order."""
    q = robot.postures(np.random.default_rng(77), 60)
    truth = robot.arm.points(q)
    T = np.asarray(problem.arm.pose(q))
    R, left = T[:, :3, :3], truth - T[:, :3, 3]
    own = [R] if aligned_tool else []
    for _ in range(3):
        p = truth - left
        turned = np.stack([np.cross(e, p) for e in np.eye(3)], axis=2)
        A = np.concatenate([np.broadcast_to(np.eye(3), (len(q), 3, 3)), turned, *own], axis=2)
        x = np.linalg.lstsq(A.reshape(-1, A.shape[2]), left.ravel(), rcond=None)[0]
        left = left - A @ x
    return 1e3 * float(np.sqrt(np.mean(np.sum(left**2, axis=1))))


def row_of(name: str, kind: str, seed: int) -> list[Any]:
    """What a user gets: `diagnose` from the files, its extended model read again, and ten postures planned with it."""
    rng = np.random.default_rng(seed)
    robot = Robot.drawn(name, rng)
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        problem, data = problem_file(folder, name, kind), written(folder, MAKERS[kind](robot, rng))
        out = folder / "out"
        answer = invoke("diagnose", data, "--problem", problem, "--out", out, "--no-plots", "--quiet", "--no-plan")
        if answer.exit_code:
            return [name, kind, "refused", answer.output.strip().splitlines()[0][:90], "", "", ""]
        document = json.loads((out / "diagnosis.json").read_text(encoding="utf-8"))
        first = document["effects"][0] if document["effects"] else {}
        extended = out / "extended.yaml"
        model = extended if extended.exists() else out / "calibrated.yaml"
        open_tool = kind.startswith("camera") or kind == "level"
        before, after = (tool_error(po.load_problem(str(path)), robot, open_tool) for path in (problem, model))
        plan = invoke(
            "plan-measurements", "--problem", model, "--given", data, "--count", 10, "--candidates", 300,
            "--out", folder / "plan", "--no-plots", "--quiet",
        )  # fmt: skip
        planned = "10 postures" if plan.exit_code == 0 else plan.output.strip().splitlines()[0][:60]
        named = f"{first['kind']} {first['target']}" if first else "-"
        return [name, kind, f"{before:.3f}", f"{after:.3f}", model.stem, named, planned]


def main() -> None:
    """One row an arm and kind."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--arms", nargs="*", default=["ur10", "panda", "scara"])
    parser.add_argument("--kinds", nargs="*", default=list(MAKERS))
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    rows = []
    for name in asked.arms:
        for kind in asked.kinds:
            rows.append(row_of(name, kind, asked.seed))
            print(rows[-1], flush=True)
    print(machine_line("posture_opt", "numpy"))
    print(table(["arm", "kind", "before mm", "after mm", "model", "first cause", "plan"], rows, ("",) * 7))


if __name__ == "__main__":
    main()
