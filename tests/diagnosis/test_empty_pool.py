"""A pool without candidates: nothing can be added to nothing."""

from __future__ import annotations

import numpy as np

from posture_opt.diagnosis.scores.score_tests import ProjectedColumns
from posture_opt.diagnosis.scores.subset_selection import Pool


def test_nothing_is_added_from_an_empty_pool() -> None:
    e = np.array([1.0, -2.0, 0.5])
    nothing = ProjectedColumns(np.zeros(1, dtype=np.intp), np.zeros((0, 0)), np.zeros(0))
    pool = Pool(nothing, float(e @ e), 2.0, np.zeros(0), np.zeros(0, dtype=np.intp))
    assert pool.additions(()) == []
    assert np.isfinite(pool.criterion(()))
