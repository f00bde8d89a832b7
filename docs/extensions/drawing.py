"""Planar arms, ellipses and arrows of the pictures on tasks and terms."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

Array = np.ndarray[Any, Any]
DARK, BLUE, RED, PALE = "0.25", "C0", "C3", "0.75"
ARROW = {"arrowstyle": "-|>", "shrinkA": 0, "shrinkB": 0, "lw": 1.6}
LENGTHS = (0.5, 0.4, 0.2)


def at(x: float, y: float) -> Array:
    """(2,) a shift on the page [m]."""
    return np.array([x, y])


def canvas() -> tuple[Figure, Axes]:
    """A small figure without frame, its axes of equal scale."""
    figure = Figure(figsize=(4.2, 2.6), layout="constrained")
    axes = figure.subplots()
    axes.set_aspect("equal")
    axes.axis("off")
    axes.margins(0.12)
    return figure, axes


def save(figure: Figure, folder: Path, name: str) -> None:
    figure.savefig(folder / f"{name}.png", dpi=110)


def corners(q: Sequence[float], lengths: Sequence[float] = LENGTHS) -> Array:
    """(n + 1, 2) joints and tool point of a planar arm [m]."""
    angles = np.cumsum(q)
    steps = np.column_stack([np.cos(angles), np.sin(angles)]) * np.asarray(lengths)[:, None]
    return np.vstack([np.zeros(2), np.cumsum(steps, axis=0)])


def jacobian(q: Sequence[float], lengths: Sequence[float] = LENGTHS) -> Array:
    """(2, n) of the tool point [m/rad]."""
    points = corners(q, lengths)
    lever = points[-1] - points[:-1]
    return np.array([-lever[:, 1], lever[:, 0]])


def arm(axes: Axes, q: Sequence[float], lengths: Sequence[float] = LENGTHS, color: str = DARK) -> Array:
    """Draw the arm; the points of `corners` come back."""
    points = corners(q, lengths)
    axes.plot(*points.T, "-", color=color, lw=5, solid_capstyle="round", alpha=0.55)
    axes.plot(*points[:-1].T, "o", color=color, ms=7)
    axes.plot(*points[-1], "o", color=color, ms=3)
    axes.plot([-0.09, 0.09], [-0.02, -0.02], color=color, lw=3)
    return points


def ellipse(axes: Axes, centre: Array, covariance: Array, factor: float, color: str = BLUE, fill: bool = True) -> None:
    """The ellipse of ``factor`` standard deviations."""
    values, vectors = np.linalg.eigh(covariance)
    angle = np.linspace(0, 2 * np.pi, 90)
    circle = np.array([np.cos(angle), np.sin(angle)])
    x, y = centre[:, None] + factor * vectors @ (np.sqrt(np.maximum(values, 0))[:, None] * circle)
    if fill:
        axes.fill(x, y, color=color, alpha=0.2)
    axes.plot(x, y, color=color, lw=1)


def arrow(axes: Axes, start: Array, end: Array, color: str = RED, text: str = "", both: bool = False) -> None:
    """An arrow with a text beside its middle."""
    style = {**ARROW, "color": color, "arrowstyle": "<|-|>" if both else "-|>"}
    axes.annotate("", tuple(end), tuple(start), arrowprops=style)
    axes.plot(*np.array([start, end]).T, alpha=0)  # arrows alone do not widen the limits
    if text:
        middle = (np.asarray(start) + np.asarray(end)) / 2
        axes.annotate(text, tuple(middle), (6, 4), textcoords="offset points", color=color, fontsize=9)


def note(axes: Axes, place: Array, text: str, color: str = DARK, offset: tuple[float, float] = (6, 4)) -> None:
    axes.annotate(text, tuple(place), offset, textcoords="offset points", color=color, fontsize=9)
