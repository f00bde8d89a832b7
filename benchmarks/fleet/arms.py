"""The arms of the fleet: presets, arms of example-robot-data, random DH arms, slides and tight limits."""

from __future__ import annotations

import zlib
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import distribution
from pathlib import Path
from typing import Any

import numpy as np

Document = dict[str, Any]


@dataclass(frozen=True)
class FleetArm:
    """One arm as the section ``robot`` of a problem file.

    Args:
        tool_axis: in the tool frame, what the tasks with a tool axis point along their direction.
        flat: whether the arm moves in the plane z = 0 with a tool axis across it, so that it can never be pointed.
    """

    name: str
    section: Callable[[], Document]
    tool_axis: tuple[float, float, float] = (0.0, 0.0, 1.0)
    flat: bool = False


def _framed(section: Document) -> Document:
    """With a base and a tool: errors of theirs are among the sources."""
    zero = ["0 deg", "0 deg", "0 deg"]
    return section | {
        "base": {"xyz": ["0.1 m", "-0.05 m", "0.3 m"], "rpy": zero},
        "tool": {"xyz": ["0.02 m", "0 m", "0.12 m"], "rpy": zero},
    }


def _preset(name: str) -> Callable[[], Document]:
    section = {"kind": "preset", "name": name}
    return lambda: section if name == "planar_2r" else _framed(section)


def _urdf(file: str, base: str, tip: str) -> Callable[[], Document]:
    def section() -> Document:
        package = distribution("example-robot-data")
        found = next(str(package.locate_file(f)) for f in package.files or () if f.name == file)
        path = Path(found).resolve()
        return {"kind": "urdf", "file": str(path), "base_link": base, "tip_link": tip}

    return section


def _joint(name: str, kind: str, row: tuple[float, float, float, float], limits: tuple[float, float]) -> Document:
    """A row a, alpha, d, theta [m, rad] of a DH table."""
    a, alpha, d, theta = row
    unit = "rad" if kind == "revolute" else "m"
    return {
        "name": name,
        "type": kind,
        "a": f"{a!r} m",
        "alpha": f"{alpha!r} rad",
        "d": f"{d!r} m",
        "theta": f"{theta!r} rad",
        "limits": [f"{limits[0]!r} {unit}", f"{limits[1]!r} {unit}"],
    }


def _random_dh(name: str, kinds: str, span: tuple[float, float], quarter: bool) -> Callable[[], Document]:
    """A random DH arm: ``kinds`` holds R or P for each joint, ``span`` the least and largest range of a joint [rad].

    ``quarter`` takes twists of 0 and ±90°, as drawn by people; else any.
    """

    def section() -> Document:
        rng = np.random.default_rng(zlib.crc32(name.encode()))
        joints = []
        for k, kind in enumerate(kinds, 1):
            twist = float(rng.choice([-0.5, 0.0, 0.5]) * np.pi if quarter else rng.uniform(-np.pi, np.pi))
            row = (float(rng.uniform(0.0, 0.4)), twist, float(rng.uniform(0.0, 0.3)), float(rng.uniform(-1.0, 1.0)))
            if kind == "P":
                joints.append(_joint(f"slide{k}", "prismatic", row, (0.0, float(rng.uniform(0.2, 0.6)))))
                continue
            half, middle = rng.uniform(*span) / 2, rng.uniform(-1.0, 1.0)
            limits = float(max(middle - half, -np.pi)), float(min(middle + half, np.pi))
            joints.append(_joint(f"turn{k}", "revolute", row, limits))
        return _framed({"kind": "dh", "joints": joints})

    return section


def _gantry() -> Document:
    """Three slides along y, x and −z that carry a roll, a pitch and a roll."""
    h = np.pi / 2
    rows = [(0.0, -h, 0.0, 0.0), (0.0, -h, 0.0, -h), (0.0, 0.0, 0.0, 0.0)]
    slides = [_joint(f"slide{k}", "prismatic", row, (0.0, 0.8)) for k, row in enumerate(rows, 1)]
    wrist = [(0.0, h, 0.2, 0.0), (0.0, -h, 0.0, 0.0), (0.0, 0.0, 0.1, 0.0)]
    turns = [_joint(f"turn{k}", "revolute", row, (-2.0, 2.0)) for k, row in enumerate(wrist, 4)]
    return _framed({"kind": "dh", "joints": [*slides, *turns]})


def _planar(count: int) -> Callable[[], Document]:
    rows = [(1.0 / count, 0.0, 0.0, 0.0)] * count
    return lambda: {
        "kind": "dh",
        "joints": [_joint(f"turn{k}", "revolute", row, (-2.5, 2.5)) for k, row in enumerate(rows, 1)],
    }


WIDE, MIDDLE, TIGHT = (3.5, 6.2), (1.4, 3.2), (0.6, 1.6)
"""Ranges of the joints of random arms [rad]; within the two smaller ones most optima lie on limits."""

PRESETS = ("iiwa14", "irb120", "panda", "planar_2r", "puma560", "scara", "ur10", "ur10e", "ur5", "ur5e")
"""Those that the figures on record were counted with; others are of the same structures."""
ARMS: tuple[FleetArm, ...] = (
    *(FleetArm(name, _preset(name), flat=name == "planar_2r") for name in PRESETS),
    FleetArm("urdf_panda", _urdf("panda.urdf", "panda_link0", "panda_hand_tcp")),
    FleetArm("urdf_ur10", _urdf("ur10_robot.urdf", "base_link", "tool0")),
    FleetArm("urdf_ur3_limited", _urdf("ur3_joint_limited_robot.urdf", "base_link", "tool0")),
    FleetArm("urdf_kinova", _urdf("kinova.urdf", "base", "j2s6s200_end_effector")),
    FleetArm("urdf_talos", _urdf("talos_reduced.urdf", "torso_2_link", "gripper_left_base_link"), (0.0, 0.0, -1.0)),
    FleetArm("urdf_talos_torso", _urdf("talos_reduced.urdf", "base_link", "gripper_left_base_link"), (0.0, 0.0, -1.0)),
    FleetArm("urdf_tiago", _urdf("tiago_no_hand.urdf", "base_footprint", "arm_tool_link"), (1.0, 0.0, 0.0)),
    FleetArm("urdf_baxter", _urdf("baxter.urdf", "base", "right_gripper")),
    FleetArm("urdf_pr2", _urdf("pr2.urdf", "torso_lift_link", "r_gripper_tool_frame"), (1.0, 0.0, 0.0)),
    FleetArm("urdf_xarm7", _urdf("xarm7.urdf", "world", "link_eef")),
    FleetArm("urdf_z1", _urdf("z1.urdf", "world", "gripperStator"), (1.0, 0.0, 0.0)),
    FleetArm("urdf_so101", _urdf("so101.urdf", "base_link", "gripper_frame_link")),
    FleetArm("dh2", _random_dh("dh2", "RR", WIDE, quarter=False)),
    FleetArm("dh3", _random_dh("dh3", "RRR", WIDE, quarter=False)),
    FleetArm("dh4", _random_dh("dh4", "RRRR", WIDE, quarter=False)),
    FleetArm("dh5", _random_dh("dh5", "RRRRR", WIDE, quarter=True)),
    FleetArm("dh6", _random_dh("dh6", "RRRRRR", WIDE, quarter=False)),
    FleetArm("dh7", _random_dh("dh7", "RRRRRRR", WIDE, quarter=False)),
    FleetArm("dh8", _random_dh("dh8", "RRRRRRRR", WIDE, quarter=True)),
    FleetArm("tight6", _random_dh("tight6", "RRRRRR", TIGHT, quarter=True)),
    FleetArm("tight7", _random_dh("tight7", "RRRRRRR", TIGHT, quarter=False)),
    FleetArm("tight8", _random_dh("tight8", "RRRRRRRR", TIGHT, quarter=True)),
    FleetArm("rail7", _random_dh("rail7", "PRRRRRR", WIDE, quarter=True)),
    FleetArm("slides6", _random_dh("slides6", "RPRRPR", WIDE, quarter=True)),
    FleetArm("gantry6", _gantry),
    FleetArm("planar4", _planar(4), (1.0, 0.0, 0.0)),
    FleetArm("middle6", _random_dh("middle6", "RRRRRR", MIDDLE, quarter=True)),
    FleetArm("middle7", _random_dh("middle7", "RRRRRRR", MIDDLE, quarter=True)),
    FleetArm("middle8", _random_dh("middle8", "RRRRRRRR", MIDDLE, quarter=False)),
)
