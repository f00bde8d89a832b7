"""The tables of lecture.md."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
from lecture_format import e4, mm, number, percent, probability, table, thousands, two_digits, vector
from lecture_numbers import CLOUD_SIZES, ENTRIES, EXAMPLES, K95, SMALL, Chance, Example, Place
from lecture_rules import (
    COVERED,
    K_LINE,
    LENGTHS,
    READINGS,
    Axes,
    KlineMcClintock,
    MeasuringRobot,
    Pose,
    Times,
    along_one_axis,
)


def with_interval(value: float, low: float, high: float, digits: int) -> str:
    return f"{e4(value, digits)} ({e4(low, digits)} … {e4(high, digits)})"


def example_table(example: Example) -> str:
    """Entries, eigenvalues and eigenvectors: printed (where it is), closed form, and two clouds."""
    printed, clouds = example.printed, (example.small, example.large)
    digits = (2, 4)
    rows = []
    for name, (i, j) in ENTRIES.items():
        row = [name, *([e4(printed.C[i][j], 1)] if printed else []), e4(example.first[i, j]), e4(example.exact[i, j])]
        for cloud, d in zip(clouds, digits, strict=True):
            row.append(with_interval(cloud.covariance[i, j], *cloud.covariance_interval[i, j], d))
        rows.append(row)
    closed = [np.linalg.eigh(C) for C in (example.first, example.exact)]
    for k, name in enumerate(("smaller eigenvalue", "larger eigenvalue")):
        row = [name, *([e4(printed.eigenvalues[k], 1)] if printed else []), *(e4(values[k]) for values, _ in closed)]
        for cloud, d in zip(clouds, digits, strict=True):
            row.append(with_interval(cloud.eigenvalues[k], *cloud.eigenvalue_intervals[k], d))
        rows.append(row)
    for k, name in enumerate(("its vector (minor axis)", "its vector (major axis)")):
        like = np.array(printed.vectors[k]) if printed else None
        vectors = [v[:, k] for _, v in closed] + [cloud.ellipse.axes[:, k] for cloud in clouds]
        shown = [vector(printed.vectors[k], 2)] if printed else []
        rows.append([name, *shown, *(vector(_signed(v, like)) for v in vectors)])
    header = ["10⁻⁴ m²", *(["printed"] if printed else []), "first order", "exact", f"cloud of {SMALL}", "cloud of 10⁶"]
    return table(header, rows)


def _signed(v: np.ndarray, like: np.ndarray | None) -> np.ndarray:
    """An eigenvector has no sign of its own: it takes that of the printed one, else its largest entry is positive."""
    sign = np.sign(v[np.argmax(np.abs(v))] if like is None else v @ like)
    return v * sign


def consistency_table() -> str:
    """The printed matrices against their own eigenvalues and eigenvectors."""
    rows = []
    for label, key in PRINTED.items():
        p = EXAMPLES[key].printed
        own = ", ".join(e4(v, 2) for v in p.matrix_eigenvalues)
        said = ", ".join(e4(v, 1) for v in p.eigenvalues)
        exact = EXAMPLES[key].exact
        rows.append([label, own, said, e4(p.C[0][1], 1), e4(p.rebuilt[0, 1], 2), e4(exact[0, 1], 2)])
    header = ["10⁻⁴ m²", "eigenvalues of the printed matrix", "eigenvalues printed", "Cxy printed",
              "Cxy of the printed eigenvectors", "Cxy exact"]  # fmt: skip
    return table(header, rows)


PRINTED = {"folded, 1° 1°": "folded", "bent, 1° 1°": "bent", "bent, 1° 3°": "weak"}


def chance_table() -> str:
    """The printed entries against what clouds of some sizes may show."""
    rows = []
    for label, key in PRINTED.items():
        example = EXAMPLES[key]
        for name, (i, j) in ENTRIES.items():
            row = [f"{label}: {name}", e4(example.printed.C[i][j], 1), e4(example.exact[i, j], 2)]
            for n in CLOUD_SIZES:
                chance = Chance(example.exact, (i, j), n)
                row.append(f"{e4(chance.quantile(0.025), 2)} … {e4(chance.quantile(0.975), 2)}")
                row.append(probability(chance.as_far_as(example.printed.C[i][j])))
            rows.append(row)
    header = ["10⁻⁴ m²", "printed", "exact"]
    for n in CLOUD_SIZES:
        header += [f"95 % of clouds of {n}", f"p ({n})"]
    return table(header, rows)


def coverage_table() -> str:
    rows = []
    for label, key in PRINTED.items():
        row = [label]
        for k in (2.0, K95):
            share, (low, high) = EXAMPLES[key].within(k)
            row.append(f"{percent(share)} ({percent(low)} … {percent(high)})")
        rows.append(row)
    return table(["% of 10⁶ points inside", "2 sigma", f"{number(K95)} sigma"], rows)


def correlated_table() -> str:
    rows = []
    for label, key in {"folded (90°, −180°)": "correlated", "stretched (90°, 0°)": "correlated_stretched"}.items():
        example = EXAMPLES[key]
        sigma = math.sqrt(example.exact[1, 1])
        cloud = example.large
        low, high = (math.sqrt(v) for v in cloud.covariance_interval[1, 1])
        sampled = f"{mm(math.sqrt(cloud.covariance[1, 1]))} ({mm(low)} … {mm(high)})"
        rows.append([label, e4(example.exact[1, 1]), mm(sigma), sampled])
    return table(["both links from one machine, ρ = 0.8", "Cyy, 10⁻⁴ m²", "σy, mm", "cloud of 10⁶, mm"], rows)


def axes_table() -> str:
    rows = []
    for label, key in PRINTED.items():
        axes, p = AXES[key], EXAMPLES[key].printed
        said = ", ".join(e4(v, 1) for v in p.eigenvalues)
        roots = ", ".join(mm(math.sqrt(v), 2) for v in axes.alphas)
        rows.append([label, said, ", ".join(e4(v) for v in axes.alphas), roots, number(axes.angle, 2)])
    header = ["", "α1, α2 printed, 10⁻⁴ m²", "α1, α2 exact, 10⁻⁴ m²", "√α1, √α2, mm", "longer axis from x, deg"]
    return table(header, rows)


def rule_table() -> str:
    rows = [[f"±{k:g} sigma", *(percent(p) for p in covered)] for k, covered in COVERED.items()]
    return table(["% inside", "on a line", "in the plane", "in space", "pose of six"], rows)


def reading_table() -> str:
    weak, rows = EXAMPLES["weak"], []
    for label, k in READINGS.items():
        share, (low, high) = weak.within(k)
        axes = " × ".join(mm(k * math.sqrt(v), 1) for v in AXES["weak"].alphas[::-1])
        counted = f"{percent(share)} ({percent(low)} … {percent(high)})"
        rows.append([label, number(k * k, 3), axes, percent(1 - math.exp(-k * k / 2)), counted])
    return table(["semi-axes, bent arm, 1° 3°", "k²", "mm", "% held", "% of 10⁶ points inside"], rows)


def scalar_counts() -> str:
    counts = [along_one_axis(EXAMPLES["weak"], k)[0] for k in COVERED]
    return ", ".join(percent(share) for share in counts)


def kline_table(kline: KlineMcClintock) -> str:
    names = ("R", "θ1, 1°", "θ2, 3°", "a1, 10 mm", "a2, 10 mm", "wR")
    rows = [
        [name, *(mm(part, 2) for part in parts), mm(w, 2)]
        for name, parts, w in zip("xy", kline.parts, kline.w, strict=True)
    ]
    return table(["∂R/∂p · w, mm" if name == "R" else name for name in names], rows)


def time_table(times: Times) -> str:
    rows = [[name, two_digits(ns / 1000), thousands(times.ratio(name))] for name, ns in times.ns.items()]
    return table(["way", "µs", "ratio"], rows)


def pose_table(pose: Pose) -> str:
    rho = pose.correlations
    sigmas = [f"{mm(math.sqrt(pose.covariance[0, 0]), 2)} mm", f"{mm(math.sqrt(pose.covariance[1, 1]), 2)} mm",
              f"{number(math.degrees(math.sqrt(pose.covariance[2, 2])), 3)}°"]  # fmt: skip
    rows = [
        [name, sigma, *(number(r, 4) for r in row)]
        for name, sigma, row in zip(("x", "y", "φ"), sigmas, rho, strict=True)
    ]
    return table(["", "σ", "correlation with x", "with y", "with φ"], rows)


def length_table(robot: MeasuringRobot) -> str:
    rows = []
    for what, shared in LENGTHS.items():
        sigma, low, high = robot.length_cloud(shared)
        first = robot.length_sigma(shared)
        rows.append([what, mm(first, 2), f"{mm(sigma, 2)} ({mm(low, 2)} … {mm(high, 2)})", mm(K_LINE * first, 1)])
    return table(["what both readings share", "u(L) first order, mm", "cloud of 2·10⁵, mm", "U = 1.96 u, mm"], rows)


AXES = {key: Axes(EXAMPLES[key]) for key in PRINTED.values()}


def place_row(place: Place) -> list[str]:
    angles = "(" + ", ".join(number(d, 0) + "°" for d in place.degrees) + ")"
    low, high = place.interval
    point = vector(place.position[:2], 2)
    return [place.what, angles, point, mm(place.first), mm(place.exact), f"{mm(place.cloud)} ({mm(low)} … {mm(high)})"]


def place_table(places: Iterable[Place]) -> str:
    header = ["posture", "(θ1, θ2)", "tool point, m", "σx first order, mm", "σx exact, mm", "σx cloud of 2·10⁵, mm"]
    return table(header, [place_row(place) for place in places])
