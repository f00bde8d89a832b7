"""The figures of lecture.md: clouds with their ellipses, and the map of the closing question."""

from __future__ import annotations

import math
from pathlib import Path

import matplotlib as mpl
import numpy as np
from lecture_numbers import EXAMPLES, K95, Closing, Example
from lecture_rules import K_LINE, READINGS, KlineMcClintock
from matplotlib.axes import Axes
from matplotlib.figure import Figure

# Okabe and Ito's colours, which colour-blind readers tell apart.
POINTS, EXACT, PRINTED, MARK = "#56B4E9", "#000000", "#D55E00", "#D55E00"
STYLE = {"font.size": 9, "axes.spines.top": False, "axes.spines.right": False}
SHOWN = 1500  # points of a cloud


def write_figures(folder: Path, closing: Closing) -> None:
    """All figures as PNG files, the same bytes in every run of one matplotlib."""
    folder.mkdir(exist_ok=True)
    with mpl.rc_context(STYLE):
        figures = {
            "folded": _clouds({"angles only": "angles", "lengths only": "lengths", "all four": "folded"}),
            "bent": _clouds({"joints of 1° and 1°": "bent", "joints of 1° and 3°": "weak"}),
            "map": _map(closing),
            "sigmas": _sigmas(EXAMPLES["weak"]),
        }
        for name, figure in figures.items():
            dpi = 90 if name == "map" else 100  # keeps every file below 150 kB
            figure.savefig(folder / f"lecture_{name}.png", dpi=dpi, metadata={"Software": None})


def _clouds(panels: dict[str, str]) -> Figure:
    figure = Figure(figsize=(3.0 * len(panels) + 0.4, 3.8), layout="constrained")
    every = figure.subplots(1, len(panels), squeeze=False)[0]
    reach = 3.3e3 * max(math.sqrt(np.linalg.eigvalsh(EXAMPLES[key].exact)[-1]) for key in panels.values())
    for axes, (title, key) in zip(every, panels.items(), strict=True):
        _cloud(axes, EXAMPLES[key])
        axes.set(xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal", xlabel="x − nominal, mm")
        axes.set_title(title, fontsize=10)
    every[0].set_ylabel("y − nominal, mm")
    handles = {label: handle for axes in every for handle, label in zip(*axes.get_legend_handles_labels(), strict=True)}
    figure.legend(handles.values(), handles.keys(), loc="outside lower center", ncols=len(panels), frameon=False)
    return figure


def _cloud(axes: Axes, example: Example) -> None:
    nominal = example.spread.position[:2]
    points = (example.large.points[:SHOWN, :2] - nominal) * 1e3
    axes.plot(*points.T, ".", color=POINTS, markersize=2.5, markeredgewidth=0, label=f"{SHOWN} of 10⁶ points")
    mean = example.spread.bias[:2] * 1e3
    label = f"95 % ellipse, exact ({K95:.3f} σ)"
    axes.plot(*_ellipse(mean, example.exact * 1e6), color=EXACT, linewidth=1.6, label=label)
    if example.printed:
        printed = np.array(example.printed.C)
        axes.plot(*_ellipse(np.zeros(2), printed * 1e6), color=PRINTED, linewidth=1.4, linestyle="--",
                  label="the same of the printed matrix")  # fmt: skip
    axes.grid(alpha=0.25)


def _sigmas(example: Example) -> Figure:
    figure = Figure(figsize=(4.8, 5.2), layout="constrained")
    axes = figure.subplots()
    nominal, mean = example.spread.position[:2], example.spread.bias[:2] * 1e3
    points = (example.large.points[:SHOWN, :2] - nominal) * 1e3
    axes.plot(*points.T, ".", color=POINTS, markersize=2.5, markeredgewidth=0)
    for (what, k), style in zip(READINGS.items(), (":", "--", "-"), strict=True):
        label = f"{what.partition(',')[0]}: {100 * example.within(k)[0]:.1f} %"
        axes.plot(*_ellipse(mean, example.exact * 1e6, k), color=EXACT, linewidth=1.4, linestyle=style, label=label)
    kline = KlineMcClintock()
    w = K_LINE * kline.w * 1e3
    box = np.array([[-1, 1, 1, -1, -1], [-1, -1, 1, 1, -1]]) * w[:, None] + mean[:, None]
    axes.plot(*box, color=MARK, linewidth=1.4, label=f"±1.96 wx, ±1.96 wy: {100 * kline.boxed:.1f} %")
    axes.grid(alpha=0.25)
    axes.set(aspect="equal", xlabel="x − nominal, mm", ylabel="y − nominal, mm")
    figure.legend(loc="outside lower center", ncols=2, frameon=False, title="share of the cloud inside")
    return figure


def _ellipse(mean: np.ndarray, covariance: np.ndarray, k: float = K95) -> np.ndarray:
    values, vectors = np.linalg.eigh(covariance)
    turn = np.linspace(0, 2 * math.pi, 181)
    circle = np.array([np.cos(turn), np.sin(turn)])
    return mean[:, None] + k * vectors @ (np.sqrt(np.maximum(values, 0))[:, None] * circle)


def _map(closing: Closing) -> Figure:
    figure = Figure(figsize=(6.2, 5.6), layout="constrained")
    axes = figure.subplots()
    levels = np.arange(10, 71, 5)
    filled = axes.contourf(closing.axis, closing.axis, closing.map * 1e3, levels, cmap="cividis")
    lines = axes.contour(closing.axis, closing.axis, closing.map * 1e3, levels[1::2], colors="white", linewidths=0.6)
    axes.clabel(lines, fmt="%g", fontsize=7)
    figure.colorbar(filled, label="σx across the vertical, mm")
    folded = [(t1, t2) for t1 in (-180, 0, 180) for t2 in (-180, 180)]
    stretched = [(t1, 0) for t1 in (-180, 0, 180)]
    marks = {
        "best: folded, horizontal": (folded, "*", 190),
        "nearly as good: stretched, horizontal": (stretched, "P", 90),
        "the lecture's postures": ([(90, -180), (90, -135)], "o", 45),
    }
    for label, (places, marker, size) in marks.items():
        look = {"marker": marker, "s": size, "color": MARK, "edgecolor": "white", "zorder": 3, "clip_on": False}
        axes.scatter(*np.transpose(places), label=label, **look)
    ticks = range(-180, 181, 60)
    axes.set(xlabel="θ1, deg", ylabel="θ2, deg", xticks=ticks, yticks=ticks, aspect="equal")
    figure.legend(loc="outside lower center", ncols=2, frameon=False)
    return figure
