"""A picture of every term, drawn with a planar arm of three joints."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from drawing import BLUE, DARK, PALE, RED, Array, arm, arrow, at, canvas, corners, ellipse, jacobian, note, save
from matplotlib.axes import Axes
from matplotlib.figure import Figure

Q = (0.6, 0.9, -0.7)


def draw_term(kind: str, folder: Path) -> None:
    """Write ``term_KIND.png``."""
    save(PICTURES[kind](), folder, f"term_{kind}")


def _spread() -> Figure:
    figure, axes = canvas()
    tool, J = arm(axes, Q)[-1], jacobian(Q)
    C = 0.05**2 * J @ J.T
    ellipse(axes, tool, C, 2.448)
    along, across = (2.448 * np.sqrt(C[k, k]) for k in (1, 0))
    arrow(axes, tool + at(0.45, 0.1), tool + at(0.45, -0.2), DARK, "direction")
    arrow(axes, tool - at(across, 0), tool + at(across, 0), RED, "", both=True)
    arrow(axes, tool - at(0, along), tool + at(0, along), BLUE, "", both=True)
    note(axes, tool + at(across, 0), "across", RED, (4, -3))
    note(axes, tool - at(0, along), "along", BLUE, (4, -8))
    return figure


def _orientation_spread() -> Figure:
    figure, axes = canvas()
    tool = arm(axes, (1.2, -1.1, -0.1))[-1]
    for angle, color in ((0.0, DARK), (0.25, RED), (-0.25, RED)):
        arrow(axes, tool, tool + 0.35 * np.array([np.sin(angle), -np.cos(angle)]), color)
    note(axes, tool + at(0.08, -0.3), "tilt ± σ", RED)
    note(axes, tool + at(0.0, -0.45), "tool axis", DARK, (-22, 0))
    return figure


def _success() -> Figure:
    figure, axes = canvas()
    points = np.random.default_rng(5).multivariate_normal([0.05, 0], [[0.16, 0.06], [0.06, 0.06]], 300)
    inside = np.hypot(*points.T) < 1
    axes.plot(*points[inside].T, ".", ms=3, color=BLUE)
    axes.plot(*points[~inside].T, ".", ms=4, color=RED)
    ellipse(axes, np.zeros(2), np.eye(2), 1, "C2", fill=False)
    arrow(axes, np.zeros(2), np.array([-0.6, 0.8]), "C2", "clearance")
    note(axes, np.array([1, -0.4]), f"{inside.mean():.0%} within", DARK, (12, 0))
    return figure


def _limit_margin() -> Figure:
    figure, axes = canvas()
    low, high, q = np.radians([-30, 200, 150])
    _arc(axes, 0.9, low, high, PALE, 5)
    _arc(axes, 0.9, q, high, RED, 5)
    tip = np.array([np.cos(q), np.sin(q)])
    axes.plot([0, tip[0]], [0, tip[1]], color=DARK, lw=5, alpha=0.6)
    axes.plot(0, 0, "o", color=DARK, ms=9)
    for angle, text in ((low, "lower limit"), (high, "upper limit")):
        note(axes, 1.0 * np.array([np.cos(angle), np.sin(angle)]), text, DARK, (4, -10))
    note(axes, 0.95 * np.array([np.cos((q + high) / 2), np.sin((q + high) / 2)]), "margin", RED, (-48, 0))
    axes.set_xlim(-1.7, 1.6)
    return figure


def _arc(axes: Axes, radius: float, start: float, end: float, color: str, width: float) -> None:
    angle = np.linspace(start, end, 60)
    axes.plot(radius * np.cos(angle), radius * np.sin(angle), color=color, lw=width)


def _link_height() -> Figure:
    figure, axes = canvas()
    points = arm(axes, (0.9, -1.2, -0.5))
    axes.fill_between([-0.2, 1.2], -0.06, -0.03, color=PALE)
    for point in points[1:-1]:
        arrow(axes, np.array([point[0], -0.03]), point, RED, both=True)
    note(axes, points[1], "height of the link ends", RED, (8, 4))
    note(axes, np.array([0.9, -0.06]), "table", DARK, (0, -12))
    return figure


def _velocity_ellipse(axes: Axes, q: Array | tuple[float, ...], fill: bool) -> tuple[Array, Array, Array]:
    tool, J = arm(axes, q)[-1], jacobian(q)
    ellipse(axes, tool, 0.35**2 * J @ J.T, 1, BLUE, fill)
    axes_of, lengths, _ = np.linalg.svd(J)
    return tool, axes_of, 0.35 * lengths


def _singularity_margin() -> Figure:
    figure, axes = canvas()
    tool, directions, lengths = _velocity_ellipse(axes, (0.3, 0.25, 0.1), fill=False)
    arrow(axes, tool, tool + lengths[1] * directions[:, 1], RED)
    note(axes, tool + lengths[1] * directions[:, 1], "$\\sigma_{min}(J)$", RED, (6, -12))
    return figure


def _manipulability() -> Figure:
    figure, axes = canvas()
    tool, directions, lengths = _velocity_ellipse(axes, (0.1, 1.3, 0.3), fill=True)
    for k in (0, 1):
        arrow(axes, tool, tool + lengths[k] * directions[:, k], BLUE)
    note(axes, tool, "its area counts", BLUE, (24, 16))
    return figure


def _joint_torque() -> Figure:
    figure, axes = canvas()
    points = arm(axes, (0.35, -0.2, -0.1))
    for k in range(3):
        middle = (points[k] + points[k + 1]) / 2
        arrow(axes, middle, middle - at(0, 0.16), DARK, "m g" if k == 0 else "")
    arrow(axes, points[-1], points[-1] - at(0, 0.22), DARK)
    note(axes, points[-1] - at(0, 0.22), "payload", DARK, (-20, -12))
    _arc(axes, 0.14, -0.6, 1.4, RED, 2)
    note(axes, np.array([0.02, 0.14]), "τ", RED, (-4, 4))
    return figure


def _near_posture() -> Figure:
    figure, axes = canvas()
    points = arm(axes, (1.4, -1.0, -0.4), color=PALE)
    note(axes, points[1], "posture of the term", DARK, (-100, 4))
    found = arm(axes, (1.1, -0.8, -0.6))
    note(axes, found[2], "answer", DARK, (0, -20))
    _arc(axes, 0.25, 1.1, 1.4, RED, 3)
    return figure


def _fixed_joints() -> Figure:
    figure, axes = canvas()
    for bend, color in ((-1.2, PALE), (-0.8, PALE), (-0.4, DARK)):
        arm(axes, (1.0, bend, -bend / 2), color=color)
    axes.plot(0, 0, "s", color=RED, ms=13)
    note(axes, np.zeros(2), "held", RED, (12, 2))
    note(axes, corners((1.0, -0.4, 0.2))[1], "free", DARK, (-28, 4))
    return figure


PICTURES: dict[str, Callable[[], Figure]] = {
    "spread": _spread,
    "orientation_spread": _orientation_spread,
    "success": _success,
    "limit_margin": _limit_margin,
    "link_height": _link_height,
    "singularity_margin": _singularity_margin,
    "manipulability": _manipulability,
    "joint_torque": _joint_torque,
    "near_posture": _near_posture,
    "fixed_joints": _fixed_joints,
}
