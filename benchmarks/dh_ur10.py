"""The UR10 in standard Denavit-Hartenberg form with 30 uncertain quantities: 5 a joint.

A joint is Rz(θ + q) Tz(d) Tx(a) Rx(α) Ry(β); the errors of θ are the joint noise, the 24 of d, a, α and β (Hayati's
tilt, nominally zero) the manufacture. Lengths and twists: Universal Robots, "DH parameters for calculations of
kinematics and dynamics", UR10.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin

from benchmarks.arms import Array

D = (0.1273, 0.0, 0.0, 0.163941, 0.1157, 0.0922)  # m
A = (0.0, -0.612, -0.5723, 0.0, 0.0, 0.0)  # m
ALPHA = (np.pi / 2, 0.0, 0.0, np.pi / 2, -np.pi / 2, 0.0)
JOINTS = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
PARAMETERS = ("theta", "d", "a", "alpha", "beta")

JOINT_SIGMA = (3e-4, 3e-4, 3e-4, 5e-4, 5e-4, 5e-4)  # rad
LENGTH_SIGMA = 5e-5  # m
TWIST_SIGMA = 1e-4  # rad


def sigma() -> Array:
    """Standard deviations of the 30 sources in the order joint by joint, `PARAMETERS` within: (30,) [rad or m]."""
    rows = [(s, LENGTH_SIGMA, LENGTH_SIGMA, TWIST_SIGMA, TWIST_SIGMA) for s in JOINT_SIGMA]
    return np.array(rows).ravel()


def coordinates(Q: Array) -> Array:
    """Nominal values of all 30 elementary transforms at postures (N, 6): (N, 30)."""
    fixed = np.array([[0.0, d, a, alpha, 0.0] for d, a, alpha in zip(D, A, ALPHA, strict=True)]).ravel()
    values = np.broadcast_to(fixed, (len(Q), fixed.size)).copy()
    values[:, ::5] += Q
    return values


def pinocchio_model() -> pin.Model:
    """A chain of 30 one-axis joints, one for each source: its Jacobian holds all 30 columns."""
    model, parent = pin.Model(), 0
    kinds = (pin.JointModelRZ, pin.JointModelPZ, pin.JointModelPX, pin.JointModelRX, pin.JointModelRY)
    for joint in JOINTS:
        for parameter, kind in zip(PARAMETERS, kinds, strict=True):
            parent = model.addJoint(parent, kind(), pin.SE3.Identity(), f"{joint}.{parameter}")
    return model


def problem() -> dict[str, Any]:
    """The same arm and sources as the content of a problem file."""
    joints = [
        {"name": name, "type": "revolute", "limits": ["-360 deg", "360 deg"]}
        | {"a": f"{a!r} m", "alpha": f"{alpha!r} rad", "d": f"{d!r} m", "theta": "0 rad"}
        for name, d, a, alpha in zip(JOINTS, D, A, ALPHA, strict=True)
    ]
    names = [f"{joint}.{parameter}" for joint in JOINTS for parameter in PARAMETERS]
    units = ("rad", "m", "m", "rad", "rad") * len(JOINTS)
    spread = {n: f"{s!r} {u}" for n, s, u in zip(names, sigma().tolist(), units, strict=True)}
    return {
        "name": "Covariance of a UR10",
        "robot": {"kind": "dh", "joints": joints},
        "uncertainty": {"sigma": spread},
        "task": {"kind": "insert", "direction": [0, 0, -1], "position": ["0.6 m", "0.2 m", "0.2 m"]},
    }
