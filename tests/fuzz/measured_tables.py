"""Simulated measurements of the planar arm of the lecture, as rows of texts: few, badly chosen, or with outliers."""

from __future__ import annotations

import math
import random
from dataclasses import dataclass

Row = list[str]


@dataclass
class Table:
    """Heads and rows of a CSV file, to change."""

    heads: list[str]
    rows: list[Row]

    def text(self, separator: str = ", ", end: str = "\n") -> str:
        """The file."""
        return end.join(separator.join(row) for row in [self.heads, *self.rows]) + end

    def add(self, head: str, cells: list[str]) -> None:
        """A column more."""
        self.heads.append(head)
        for row, cell in zip(self.rows, cells, strict=True):
            row.append(cell)


def planar(rng: random.Random, rows: int) -> Table:
    """Rows of joint1, joint2, x, y: the arm has errors, the instrument scatters, the design may be degenerate."""
    lengths = 1 + rng.gauss(0, 1e-3), 1 + rng.gauss(0, 1e-3)
    offsets = rng.gauss(0, 2e-3), rng.gauss(0, 2e-3)
    sigma = rng.choice((0.0, 2e-5, 2e-5, 1e-3))
    outliers = rng.choice((0.0, 0.0, 0.0, 0.1, 0.5))
    size = rng.choice((0.01, 1.0, 1e6))
    table = Table(["joint1 [deg]", "joint2 [deg]", "x [mm]", "y [mm]"], [])
    for q1, q2 in _postures(rng, rows):
        a, b = math.radians(q1) + offsets[0], math.radians(q1 + q2) + sum(offsets)
        tool = lengths[0] * math.cos(a) + lengths[1] * math.cos(b), lengths[0] * math.sin(a) + lengths[1] * math.sin(b)
        measured = [1e3 * (value + rng.gauss(0, sigma)) for value in tool]
        if rng.random() < outliers:
            measured[rng.randrange(2)] += rng.gauss(0, size * 1e3)
        table.rows.append([f"{q1:.2f}", f"{q2:.2f}", *(f"{value:.4f}" for value in measured)])
    return table


def _postures(rng: random.Random, rows: int) -> list[tuple[float, float]]:
    """Postures [deg] of a design: at random, on a line, one joint still, few postures repeated, or a single one."""
    drawn = [(rng.uniform(-150, 150), rng.uniform(-150, 150)) for _ in range(rows)]
    design = rng.choice(
        ("random", "random", "random", "line", "still 1", "still 2", "repeated", "one", "near", "stretched")
    )
    if design == "line":
        return [(10 + 60 * q / 150, 20 + 60 * q / 150) for q, _ in drawn]
    if design.startswith("still"):
        return [(30, b) if design[-1] == "1" else (a, 40) for a, b in drawn]
    if design == "repeated":
        return [drawn[i % max(1, rows // 4)] for i in range(rows)]
    if design == "one":
        return drawn[:1] * rows
    if design == "near":
        return [(20 + a * 1e-4, 30 + b * 1e-4) for a, b in drawn]
    return [(a, 0.0) for a, _ in drawn] if design == "stretched" else drawn


def with_columns(rng: random.Random, table: Table) -> None:
    """Adds columns that measurements may have."""
    count = len(table.rows)
    groups = rng.choice((1, 2, 3, count))
    for name in ("pose", "goal", "target", "robot", "point"):
        if rng.random() < 0.12:
            table.add(name, [f"{name[0]}{i % groups}" for i in range(count)])
    for head, low, high in (("payload [kg]", 0, 5), ("temperature [degC]", 18, 30), ("time [s]", 0, 1e4)):
        if rng.random() < 0.15:
            still = rng.random() < 0.3
            table.add(head, [f"{low if still else rng.uniform(low, high):.1f}" for _ in range(count)])
    for joint in ("joint1", "joint2"):
        if rng.random() < 0.12:
            table.add(f"{joint}.approach", [rng.choice(("1", "-1", "-1", "")) for _ in range(count)])
    if rng.random() < 0.1:
        for name in ("qw", "qx", "qy", "qz"):
            table.add(name, [f"{rng.gauss(0, 1):.3f}" for _ in range(count)])
    if rng.random() < 0.15:
        table.add("z [mm]", [f"{rng.gauss(0, 0.05):.3f}" for _ in range(count)])
