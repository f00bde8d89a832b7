"""Cost against the number of sources of error."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

import posture_opt as po
from benchmarks import dh_ur10
from benchmarks.calibration import timed
from benchmarks.results.section import Chart, Section

TEXT = "A UR10 with 6 to 30 independent sources (five a joint: θ, d, a, α, β), {count} random postures in one call."


def measure(quick: bool) -> Iterator[Section]:
    Q = np.random.default_rng(0).uniform(-np.pi, np.pi, (10_000 if quick else 100_000, 6))
    rows = []
    for a_joint in range(1, 6):
        document: dict[str, Any] = dh_ur10.problem()
        kept = dh_ur10.PARAMETERS[:a_joint]
        sigma = document["uncertainty"]["sigma"]
        document["uncertainty"] = {"sigma": {k: v for k, v in sigma.items() if k.rpartition(".")[2] in kept}}
        spread = po.SpreadFunction(po.problem_from_dict(document))
        calls = (lambda s=spread: s(Q), lambda s=spread: s.first_order(Q))
        for call in calls:
            call()  # compiles
        rows.append((6 * a_joint, *(1e9 * timed(call, 5)[0] / len(Q) for call in calls)))
    yield Section(
        "sources", "Cost against sources", TEXT.format(count=f"{len(Q):,}".replace(",", " ")),
        ("sources", "exact, ns a covariance", "first order, ns a covariance"), tuple(rows), ("d", ".0f", ".0f"), (),
        Chart("ns a covariance", (1, 2), logarithmic=False),
    )  # fmt: skip
