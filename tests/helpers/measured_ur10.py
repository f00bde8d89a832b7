"""Makes ``problems/ur10_measured.csv`` and ``problems/ur10_another_day.csv``; not a line of the package.

A UR10 whose elbow gives way under its load and whose first gear has play, with small errors of all its lengths and
joint zeros, seen by a tracker that was aligned with its foot. Run from the folder of the project:
``python -m tests.helpers.measured_ur10 problems``.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

JOINTS = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
# Universal Robots, "DH Parameters for calculations of kinematics and dynamics", table UR10 (CB3): m, rad, kg.
A = np.array([0, -0.612, -0.5723, 0, 0, 0])
D = np.array([0.1273, 0, 0, 0.163941, 0.1157, 0.0922])
ALPHA = np.pi / 2 * np.array([1, 0, 0, 1, -1, 0])
MASSES = np.array([7.1, 12.7, 4.27, 2.0, 2.0, 0.365])
CENTRES = np.array(
    [[0.021, 0, 0.027], [0.38, 0, 0.158], [0.24, 0, 0.068], [0, 0.007, 0.018], [0, 0.007, 0.018], [0, 0, -0.026]]
)
G = 9.81  # m/s²

COMPLIANCE = 8e-6  # rad/(N m): of the elbow, 125 kN m/rad
PLAY = 2e-4  # rad: of the first gear, 41 arcsec from flank to flank; it stops short
GEOMETRY = 0.3e-3  # m and rad: σ of the error of every length, joint zero and twist
FOOT = np.array([0.0013, -0.0021, 0.0008]), 0.0012  # m, rad about z: of the arm's foot in the tracker's frame
TIP = np.array([0.0007, -0.0004, 0.1211])  # m: of the reflector in the flange; drawn with 120 mm
NOISE = 0.03e-3  # m: of a measured coordinate
LOADS = 0.0, 10.0  # kg, in the reflector's place
HEAD = ", ".join([*(f"{name} [deg]" for name in JOINTS), "x [mm], y [mm], z [mm], payload [kg]"])


def frames(q, errors=0.0):
    """Rotations and origins of the six links at one posture (6,) [rad], the arm standing upright in the origin."""
    theta, d, a, alpha = np.array([q, D, A, ALPHA]) + errors
    R, o, found = np.eye(3), np.zeros(3), [(np.eye(3), np.zeros(3))]
    for t, along, out, twist in zip(theta, d, a, alpha, strict=True):
        c, s = np.cos(t), np.sin(t)
        o = o + R @ np.array([out * c, out * s, along])
        turn = np.array([[1, 0, 0], [0, np.cos(twist), -np.sin(twist)], [0, np.sin(twist), np.cos(twist)]])
        R = R @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ turn
        found.append((R, o))
    return found


def torque(q, load, joint):
    """Torque [N m] of gravity about the axis of one joint."""
    found = frames(q)
    axis, about = found[joint][0][:, 2], found[joint][1]
    centres = [o + R @ c for (R, o), c in zip(found[1:], CENTRES, strict=True)]
    R, o = found[-1]
    bodies = [*zip(MASSES, centres, strict=True), (load, o + R @ TIP)]
    forces = [np.cross(point - about, [0, 0, -G * mass]) for i, (mass, point) in enumerate(bodies) if i >= joint]
    return float(axis @ np.sum(forces, axis=0))


def errors(seed=2):
    """(4, 6) what θ, d, a and α are off by."""
    return np.random.default_rng(seed).normal(0, GEOMETRY, (4, 6))


def reached(q, load, side):
    """(3,) where the reflector comes to lie at a commanded posture, its first joint having moved to ``side``."""
    true = q + np.array([-PLAY * side / 2, 0, COMPLIANCE * torque(q, load, 2), 0, 0, 0])
    R, o = frames(true, errors())[-1]
    shift, yaw = FOOT
    turn = np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
    return shift + turn @ (o + R @ TIP)


def postures(count, rng):
    """(count, 6) random postures [rad] with elbow, wrist and reflector over the table."""
    found = []
    while len(found) < count:
        q = np.radians(np.round(np.degrees(rng.uniform(-1, 1, 6) * np.radians([170, 170, 150, 180, 180, 180])), 2))
        at = frames(q)
        if min(o[2] for _, o in at[3:]) > 0.1 and (at[-1][1] + at[-1][0] @ TIP)[2] > 0.1:
            found.append(q)
    return np.array(found)


def rows(count, seed):
    """(count, 10) commanded joints [deg], measured points [mm], load [kg]: first without load, then with it."""
    rng = np.random.default_rng(seed)
    q = postures(count + 1, rng)  # the first one is where the arm starts from, and is not measured
    loads = np.repeat(LOADS, [(count + 1) // 2, count // 2])
    sides = np.sign(np.diff(q[:, 0]))
    points = [reached(*row) for row in zip(q[1:], loads, sides, strict=True)] + rng.normal(0, NOISE, (count, 3))
    return np.column_stack([np.degrees(q[1:]), 1e3 * points, loads])


def text(count, seed):
    lines = [
        ", ".join([*(f"{v:.2f}" for v in r[:6]), *(f"{v:.3f}" for v in r[6:9]), f"{r[9]:g}"]) for r in rows(count, seed)
    ]
    return "\n".join([HEAD, *lines]) + "\n"


if __name__ == "__main__":
    folder = Path(sys.argv[1])
    (folder / "ur10_measured.csv").write_text(text(110, 3), encoding="utf-8")
    (folder / "ur10_another_day.csv").write_text(text(40, 4), encoding="utf-8")
