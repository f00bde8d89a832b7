"""The arms: numbers of makers where they are published, plausible ones elsewhere."""

from __future__ import annotations

from math import pi

import numpy as np

from tests.hidden.mechanics import Arm, Factor, frame

DOWN = np.array([0.0, 0.0, -9.81])

# a, alpha, d, theta, mass, centre of mass in the frame behind the joint, gear ratio, limit
# Universal Robots, "DH parameters for calculations of kinematics and dynamics" (UR10); harmonic drives 101 : 1
UR10 = [
    (0.0, pi / 2, 0.1273, 0.0, 7.1, (0.021, 0.0, 0.027), 101, pi),
    (-0.612, 0.0, 0.0, 0.0, 12.7, (0.38, 0.0, 0.158), 101, pi),
    (-0.5723, 0.0, 0.0, 0.0, 4.27, (0.24, 0.0, 0.068), 101, pi),
    (0.0, pi / 2, 0.163941, 0.0, 2.0, (0.0, 0.007, 0.018), 101, pi),
    (0.0, -pi / 2, 0.1157, 0.0, 2.0, (0.0, 0.007, 0.018), 101, pi),
    (0.0, 0.0, 0.0922, 0.0, 0.365, (0.0, 0.0, -0.026), 101, pi),
]
# lengths of KUKA's KR 16 data sheet; masses and ratios plausible
KR16 = [
    (0.26, -pi / 2, 0.675, 0.0, 85.0, (-0.18, 0.10, 0.01), 125, 185 * pi / 180),
    (0.68, 0.0, 0.0, 0.0, 42.0, (-0.37, 0.0, -0.14), 143, 100 * pi / 180),
    (-0.035, pi / 2, 0.0, -pi / 2, 34.0, (0.03, 0.02, 0.09), 127, 130 * pi / 180),
    (0.0, -pi / 2, 0.67, 0.0, 16.0, (0.0, -0.21, 0.0), 86, pi),
    (0.0, pi / 2, 0.0, 0.0, 7.0, (0.0, 0.0, 0.04), 81, 130 * pi / 180),
    (0.0, 0.0, 0.158, 0.0, 2.0, (0.0, 0.0, -0.03), 57, pi),
]
PLANAR = [(1.0, 0.0, 0.0, 0.0, 12.0, (-0.55, 0.0, 0.0), 121, pi), (0.8, 0.0, 0.0, 0.0, 7.0, (-0.42, 0.0, 0.0), 101, pi)]
# two revolute joints, a quill that moves down, and its turn
SCARA = [
    (0.35, 0.0, 0.40, 0.0, 9.0, (-0.16, 0.0, 0.05), 80, 150 * pi / 180),
    (0.30, pi, 0.0, 0.0, 6.0, (-0.12, 0.0, 0.02), 50, 145 * pi / 180),
    (0.0, 0.0, 0.05, 0.0, 1.2, (0.0, 0.0, -0.1), 0, (0.0, 0.20)),
    (0.0, 0.0, 0.02, 0.0, 0.4, (0.0, 0.0, -0.02), 15, pi),
]
# Seven joints in the manner of KUKA's iiwa 14, one axis against its coordinate axis: origin, roll pitch yaw, axis with
# sign, mass, centre of mass, ratio, limit
SEVEN = [
    ((0.0, 0.0, 0.1575), (0.0, 0.0, 0.0), (2, 1), 6.4, (0.0, -0.014, 0.102), 160, 170 * pi / 180),
    ((0.0, 0.0, 0.2025), (0.0, 0.0, 0.0), (1, 1), 7.9, (0.0, 0.016, 0.064), 160, 120 * pi / 180),
    ((0.0, 0.0, 0.2045), (0.0, 0.0, 0.0), (2, 1), 2.5, (0.0, 0.02, 0.098), 160, 170 * pi / 180),
    ((0.0, 0.0, 0.2155), (0.0, 0.0, 0.0), (1, -1), 3.9, (0.0, 0.018, 0.075), 160, 120 * pi / 180),
    ((0.0, 0.0, 0.1845), (0.0, 0.0, 0.0), (2, 1), 2.6, (0.0, 0.0117, 0.0603), 100, 170 * pi / 180),
    ((0.0, 0.0, 0.2155), (0.0, 0.0, 0.0), (1, 1), 3.1, (0.0, -0.017, 0.023), 160, 120 * pi / 180),
    ((0.0, 0.0, 0.0810), (0.0, 0.0, 0.3), (2, 1), 1.1, (0.0, 0.0, 0.032), 160, 175 * pi / 180),
]


def dh_arm(
    name: str, rows: list, *, slides: tuple[int, ...] = (), gravity: np.ndarray = DOWN, measured=(0, 1, 2)
) -> Arm:
    """Standard Denavit-Hartenberg: Rz(θ) Tz(d) Tx(a) Rx(α) Ry(β), q added to θ, or to d of the joints in ``slides``."""
    joints = tuple(f"joint{i + 1}" for i in range(len(rows)))
    links, lower, upper = [], [], []
    for i, (joint, (a, alpha, d, theta, *_, limit)) in enumerate(zip(joints, rows, strict=True)):
        slide = i in slides
        turn = Factor("R", 2, theta, f"{joint}.theta", -1 if slide else i)
        rise = Factor("T", 2, d, f"{joint}.d", i if slide else -1)
        links.append((turn, rise, Factor("T", 0, a, f"{joint}.a"), Factor("R", 0, alpha, f"{joint}.alpha")))
        links[-1] += (Factor("R", 1, 0.0, f"{joint}.beta"),)
        low, high = limit if isinstance(limit, tuple) else (-limit, limit)
        lower.append(low)
        upper.append(high)
    n = len(rows)
    return Arm(
        name, "dh", joints, tuple(i in slides for i in range(n)), np.array(lower), np.array(upper), tuple(links),
        frame("base"), frame("tool"), np.array([r[4] for r in rows]), np.array([r[5] for r in rows]),
        np.array([r[6] for r in rows], float), gravity, measured,
        tuple(i for i in range(n - 1) if abs(np.sin(rows[i][1])) < 0.17),
    )  # fmt: skip


def seven_arm() -> Arm:
    """The seven joint arm with its URDF text."""
    links, parts = [], ['<robot name="seven"><link name="base_link"/>']
    names = tuple(f"a{i + 1}" for i in range(len(SEVEN)))
    for i, (name, row) in enumerate(zip(names, SEVEN, strict=True)):
        (x, y, z), (roll, pitch, yaw), (axis, sign), mass, com, _, limit = row
        places = frame(name, np.array([x, y, z, roll, pitch, yaw]))
        links.append((*places, Factor("R", axis, 0.0, f"{name}.theta", i, float(sign))))
        vector = " ".join(str(sign if k == axis else 0) for k in range(3))
        parts.append(
            f'<link name="link{i + 1}"><inertial><origin xyz="{com[0]} {com[1]} {com[2]}"/><mass value="{mass}"/>'
            '<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>'
            f'<joint name="{name}" type="revolute"><parent link="{f"link{i}" if i else "base_link"}"/>'
            f'<child link="link{i + 1}"/><origin xyz="{x} {y} {z}" rpy="{roll} {pitch} {yaw}"/><axis xyz="{vector}"/>'
            f'<limit lower="{-limit!r}" upper="{limit!r}" effort="300" velocity="2"/></joint>'
        )
    limits = np.array([r[6] for r in SEVEN])
    return Arm(
        "seven", "urdf", names, (False,) * 7, -limits, limits, tuple(links), frame("base"), frame("tool"),
        np.array([r[3] for r in SEVEN]), np.array([r[4] for r in SEVEN]), np.array([r[5] for r in SEVEN], float), DOWN,
        urdf="\n".join([*parts, "</robot>"]),
    )  # fmt: skip


ARMS = {
    "ur10": lambda: dh_arm("ur10", UR10),
    "kr16": lambda: dh_arm("kr16", KR16),
    "planar": lambda: dh_arm("planar", PLANAR, gravity=np.array([0.0, -9.81, 0.0]), measured=(0, 1)),
    "scara": lambda: dh_arm("scara", SCARA, slides=(2,)),
    "seven": seven_arm,
}
