"""Robots in the Denavit-Hartenberg conventions, standard and modified."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Literal

import numpy as np

from posture_opt.numerics import Array
from posture_opt.robot.axes import NEARLY_PARALLEL, Links, axes_of, moved_factors, nearest_values
from posture_opt.robot.format import JointSpec, TableRobot
from posture_opt.robot.robot import Factor
from posture_opt.robot.shape_section import factor_transform, product_of

_FAR = 10.0  # times all lengths across the axes: no arm is so much longer along them


class DhRobot(TableRobot):
    """``T_{i-1,i} = Rz(theta) Tz(d) Tx(a) Rx(alpha) Ry(beta)``, ``theta`` or ``d`` carrying the joint variable.

    ``beta`` is nominally zero; it is the parameter that a pair of nearly parallel axes needs, where ``d`` jumps.
    Sources: Denavit, Hartenberg (1955); Hayati, Mirmirani (1985) for ``beta``.
    """

    kind: Literal["dh"] = "dh"

    @staticmethod
    def row(joint: JointSpec, index: int) -> tuple[Factor, ...]:
        """The five factors of one row of the table, in the order of their product. joint: ``a``, ``d`` [m], ``alpha``,
        ``theta`` [rad] of the row."""
        return (
            joint.driven(index, "theta"),
            joint.driven(index, "d"),
            Factor("translate", 0, joint.a, f"{joint.name}.a"),
            Factor("rotate", 0, joint.alpha, f"{joint.name}.alpha"),
            Factor("rotate", 1, 0.0, f"{joint.name}.beta"),
        )

    def placed(self, links: Links) -> Links:
        """The chain with ``d = 0`` and ``beta`` between nearly parallel axes, where a table has frames far away."""
        across = sum(abs(joint.a) for joint in self.joints)
        near = [*(1e-12 < abs(math.sin(joint.alpha)) < NEARLY_PARALLEL for joint in self.joints[:-1]), False]
        rows = [i for i, (before, own) in enumerate(pairwise([False, *near])) if before or own]
        if not rows or max(abs(self.joints[i].d) for i in rows) <= _FAR * max(across, 0.1):
            return links
        axes, flange = axes_of(factor for link in links for factor in link)
        values = _beside_axes(self.joints, rows, axes)
        guess = tuple(moved_factors(link, values) for link in links)
        closer = nearest_values(guess, axes, flange)
        return tuple(moved_factors(link, closer) for link in guess)


def _beside_axes(joints: tuple[JointSpec, ...], rows: list[int], axes: Array) -> dict[str, float]:
    # Each frame but the last of ``rows`` where its axis meets the xy plane of the frame before (Hayati, Mirmirani 1985)
    found: dict[str, float] = {}
    T = product_of([factor for i in range(rows[0]) for factor in DhRobot.row(joints[i], i)])
    for i in rows[:-1]:
        w, moment = axes[i + 1, :3], axes[i + 1, 3:]
        local_w, local_p = T[:3, :3].T @ w, T[:3, :3].T @ (np.cross(w, moment) - T[:3, 3])
        x, y, _ = local_p - local_w * local_p[2] / local_w[2]
        theta = math.atan(y / x) if x else 0.0
        a, c, s = math.hypot(x, y) * math.copysign(1, x), math.cos(theta), math.sin(theta)
        wx, wy, wz = c * local_w[0] + s * local_w[1], c * local_w[1] - s * local_w[0], local_w[2]
        new = {"theta": theta, "d": 0.0, "a": a, "alpha": math.atan2(-wy, wz), "beta": math.asin(wx)}
        T = T @ product_of(
            DhRobot.row(joints[i].model_copy(update={k: new[k] for k in ("theta", "d", "a", "alpha")}), i)
        )
        T = T @ factor_transform(Factor("rotate", 1, new["beta"]))
        found |= {f"{joints[i].name}.{k}": v - getattr(joints[i], k, 0.0) for k, v in new.items()}
    last = joints[rows[-1]].name
    found[f"{last}.d"] = sum(joints[i].d for i in rows[:-1])
    found[f"{last}.theta"] = -sum(found[f"{joints[i].name}.theta"] for i in rows[:-1])
    return found


class MdhRobot(TableRobot):
    """``T_{i-1,i} = Rx(alpha) Tx(a) Rz(theta) Tz(d)``, ``theta`` or ``d`` carrying the joint variable.

    ``a`` and ``alpha`` of a row come before its joint: they are Craig's a_{i-1}, alpha_{i-1}.
    Source: Craig, Introduction to Robotics (2005), equation 3.6.
    """

    kind: Literal["mdh"] = "mdh"

    @staticmethod
    def row(joint: JointSpec, index: int) -> tuple[Factor, ...]:
        """The four factors of one row of the table, in the order of their product. joint: ``a``, ``d`` [m], ``alpha``,
        ``theta`` [rad] of the row."""
        return (
            Factor("rotate", 0, joint.alpha, f"{joint.name}.alpha"),
            Factor("translate", 0, joint.a, f"{joint.name}.a"),
            joint.driven(index, "theta"),
            joint.driven(index, "d"),
        )
