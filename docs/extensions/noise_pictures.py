"""A picture of every cause that only adds scatter."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from drawing import BLUE, DARK, PALE, RED, arm, canvas, corners, ellipse, jacobian, note, save
from matplotlib.axes import Axes
from matplotlib.figure import Figure

Q = (0.5, 0.9, -0.6)


def draw_noise(kind: str, folder: Path) -> None:
    """Write ``effect_KIND.png``."""
    save(PICTURES[kind](), folder, f"effect_{kind}")


def _joint_noise() -> Figure:
    figure, axes = canvas()
    tool, J = arm(axes, Q)[-1], jacobian(Q)
    plain = np.eye(2) * 0.012**2
    ellipse(axes, tool, plain + 0.06**2 * np.outer(J[:, 1], J[:, 1]), 2.448)
    ellipse(axes, tool, plain, 2.448, DARK, fill=False)
    axes.plot(*corners(Q)[1], "o", color=RED, ms=9)
    note(axes, corners(Q)[1], "noisy joint j", RED, (8, -12))
    note(axes, tool + 0.05, "$\\Sigma_p + \\sigma^2 J_j J_j^T$", BLUE)
    return figure


def _curves(x_label: str, y_label: str) -> tuple[Figure, Axes]:
    figure = Figure(figsize=(4.2, 2.2), layout="constrained")
    axes = figure.subplots()
    axes.set_xlabel(x_label)
    axes.set_ylabel(y_label)
    axes.grid(alpha=0.3)
    return figure, axes


def _range_noise() -> Figure:
    figure, axes = _curves("distance from the instrument [m]", "error of a coordinate [µm]")
    rng = np.random.default_rng(1)
    r = rng.uniform(0.5, 8, 300)
    axes.plot(r, (15 + 6 * r) * rng.standard_normal(300), ".", ms=3, color=PALE)
    line = np.array([0, 8])
    for sign in (1, -1):
        axes.plot(line, sign * (15 + 6 * line), color=BLUE)
    axes.set_title("lines: ± (15 µm + 6 µm/m r)", fontsize=9)
    return figure


def _stated_sigma() -> Figure:
    figure, axes = _curves("error, in σ as stated", "share of the rows")
    x = np.linspace(-6, 6, 300)
    for k, color, text in ((1, DARK, "as stated"), (1.8, BLUE, "k = 1.8")):
        axes.plot(x, np.exp(-((x / k) ** 2) / 2) / (k * np.sqrt(2 * np.pi)), color=color, label=text)
    axes.legend(fontsize=8)
    return figure


def _outliers() -> Figure:
    figure, axes = _curves("row", "error [mm]")
    rng = np.random.default_rng(3)
    error = 0.05 * rng.standard_normal(100)
    axes.plot(error, ".", color=BLUE, ms=4)
    wild = [23, 71]
    axes.plot(wild, [0.62, -0.48], "o", color=RED)
    axes.set_title("2 of 100 rows are worth nothing: s = 0.02", fontsize=9)
    return figure


def _correlated_lengths() -> Figure:
    figure, axes = _curves("error of length A [mm]", "error of length B [mm]")
    rng = np.random.default_rng(2)
    a, b = 0.2 * rng.multivariate_normal([0, 0], [[1, 0.8], [0.8, 1]], 12).T
    axes.plot(a, b, "o", color=BLUE)
    ellipse(axes, np.zeros(2), 0.04 * np.array([[1, 0.8], [0.8, 1]]), 2.448)
    axes.set_title("each point is one robot of a batch; ρ = 0.8", fontsize=9)
    return figure


PICTURES: dict[str, Callable[[], Figure]] = {
    "joint_noise": _joint_noise,
    "range_noise": _range_noise,
    "stated_sigma": _stated_sigma,
    "outliers": _outliers,
    "correlated_lengths": _correlated_lengths,
}
