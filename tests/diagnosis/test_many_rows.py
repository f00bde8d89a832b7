"""Diagnosis of many rows: sums over blocks are the dense answer, and memory stays within bounds."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from posture_opt.diagnosis.scores import score_tests
from posture_opt.diagnosis.scores.column_blocks import ColumnBlocks, ColumnStore
from posture_opt.diagnosis.scores.score_tests import ProjectedBaseline, ProjectedColumns

ROWS, WIDTHS = 300, (1, 3, 2, 1)


@pytest.fixture
def drawn() -> tuple[ProjectedBaseline, list[np.ndarray], np.ndarray, np.ndarray]:
    rng = np.random.default_rng(4)
    G, r = rng.normal(size=(ROWS, 5)) * [1, 1e3, 1e-3, 1, 1], rng.normal(size=ROWS)
    columns = [10.0**k * rng.normal(size=(ROWS, width)) for k, width in enumerate(WIDTHS)]
    columns[1][:, 2] = columns[1][:, 0] - columns[1][:, 1]  # one direction less than columns
    return ProjectedBaseline.of(r, G, np.arange(ROWS), 9, 0), columns, G, r


def rss(A: np.ndarray, r: np.ndarray) -> float:
    """What NumPy's least squares leave."""
    A = A / np.linalg.norm(A, axis=0)
    e = r - A @ np.linalg.lstsq(A, r, rcond=1e-12)[0]
    return float(e @ e)


def test_sums_over_blocks_explain_what_least_squares_of_all_rows_do(drawn, monkeypatch) -> None:  # type: ignore[no-untyped-def]
    monkeypatch.setattr(score_tests, "_ROWS", 64)
    baseline, columns, G, r = drawn
    found = ProjectedColumns.of(baseline, columns)
    assert found.sizes.tolist() == [1, 2, 2, 1]
    gains = [rss(G, r) - rss(np.concatenate([G, Z], axis=1), r) for Z in columns]
    np.testing.assert_allclose(found.gains, gains, rtol=1e-10)
    together = found.scores @ np.linalg.solve(found.gram, found.scores)
    assert together == pytest.approx(rss(G, r) - rss(np.concatenate([G, *columns], axis=1), r), rel=1e-10)


def test_columns_in_blocks_have_the_inner_products_of_columns_apart(drawn) -> None:  # type: ignore[no-untyped-def]
    _, _, _, r = drawn
    rng, store = np.random.default_rng(0), ColumnStore()
    columns = [rng.normal(size=(ROWS, 2)) for _ in range(150)]
    places = [store.keep("named" if i % 3 else "unnamed", Z) for i, Z in enumerate(columns)]
    named = [i for i in range(150) if i % 3]
    blocks = ColumnBlocks.of([columns[i] for i in named], [places[i] for i in named])
    assert all(block.base is not None for block in blocks.blocks)  # nothing was copied
    some = np.arange(0, ROWS, 7)
    for rows in (None, some):
        part = [columns[i] if rows is None else columns[i][rows] for i in named]
        np.testing.assert_allclose(blocks.grams(rows), [Z.T @ Z for Z in part], rtol=1e-5, atol=1e-3)
    np.testing.assert_allclose(
        blocks.products(r[:, None])[:, :, 0], [columns[i].T @ r for i in named], rtol=1e-5, atol=1e-3
    )
    apart = ColumnBlocks.of(columns, [None] * 150)
    np.testing.assert_allclose(apart.products(r[:, None])[:, :, 0], [Z.T @ r for Z in columns], rtol=1e-5, atol=1e-3)


SCRIPT = """
import resource
import numpy as np
import posture_opt as po
problem = po.load_problem("insert_planar_2r_measured")
rng = np.random.default_rng(0)
q = rng.uniform(-2.5, 2.5, (4000, 2))
s = np.cumsum(q + np.array([1e-3, -2e-3]) + 4e-4 * np.sin(q), axis=1)
p = np.stack([np.cos(s).sum(axis=1), np.sin(s).sum(axis=1)], axis=1) + rng.normal(0, 5e-5, (4000, 2))
names = [f"{name} [rad]" for name in problem.robot.joint_names]
table = dict(zip([*names, "x [m]", "y [m]"], [*q.T, *p.T]))
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
found = po.diagnose(problem, po.read_measurements(table, problem), plan=False)
print(found.verdict, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
"""


@pytest.mark.large
def test_memory_of_some_thousand_rows_is_bounded() -> None:
    done = subprocess.run([sys.executable, "-c", SCRIPT], capture_output=True, text=True, check=True)
    verdict, kilobytes = done.stdout.split()[-2:]
    assert verdict in ("effects_found", "unexplained")
    assert int(kilobytes) < 300_000
