"""One covariance, way by way."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from benchmarks.covariance import WAYS, line, pinocchio_loop
from benchmarks.results.section import Chart, Section

TEXT = """One position covariance of a UR10 with 30 independent sources, {count} random postures in one call. The
peers give the first order J Σ Jᵀ; posture_opt gives that and the exact covariance. The difference is that from
Pinocchio's first order: rounding, or the nonlinearity for the exact one."""


def measure(quick: bool) -> Iterator[Section]:
    count = 10_000 if quick else 100_000
    Q = np.random.default_rng(0).uniform(-np.pi, np.pi, (count, 6))
    truth = pinocchio_loop()(Q[:200])
    rows, notes = [], []
    for title, build in WAYS.items():
        try:
            rows.append(tuple(line(title, build, Q, truth, 3)))
        except Exception as error:  # a peer that fails is a row with its reason
            rows.append((title, None, None, None))
            notes.append(f"{title}: {type(error).__name__}: {error}")
    rows = [tuple(float(v) if isinstance(v, np.floating) else v for v in row) for row in rows]
    yield Section(
        "covariance", "One covariance", TEXT.format(count=f"{count:,}".replace(",", " ")).replace("\n", " "),
        ("way", "ns a covariance", "peak MB", "difference from first order"), tuple(rows), ("", ".0f", ".1f", ""),
        tuple(notes), Chart("ns a covariance", (1,)),
    )  # fmt: skip
