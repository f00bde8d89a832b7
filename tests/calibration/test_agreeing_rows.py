"""Errors of several targets of one posture that agree are the arm's, and no outliers."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from posture_opt.calibration.estimation.fit import agreeing_rows

SAG = np.array([0.0, 0.0, -2.0])
POSTURES = 12


class Rows(SimpleNamespace):
    """Columns of a table."""

    def __len__(self) -> int:
        return len(self.q)


def kept(off: dict[int, Any], targets: int, pose: np.ndarray) -> list[int]:
    """The gross rows that are kept, of each target in each posture off by noise, some rows by ``off`` more."""
    rng, n = np.random.default_rng(1), POSTURES * targets
    q = np.repeat(rng.uniform(-1, 1, (POSTURES, 6)), targets, axis=0)
    names = [f"t{i}" for i in range(targets)]
    data: Any = Rows(q=q, pose=pose, target=np.tile(np.arange(targets), POSTURES), target_names=names)
    errors = rng.normal(0, 0.02, (n, 3))
    for row, more in off.items():
        errors[row] += more
    return np.flatnonzero(agreeing_rows(data, errors, np.linalg.norm(errors, axis=1) > 0.2)).tolist()


THREE = np.repeat(np.arange(POSTURES), 3)


@pytest.mark.parametrize(
    ("off", "targets", "pose", "rows"),
    [
        ({3: SAG, 4: SAG, 5: SAG}, 3, THREE, [3, 4, 5]),  # reflectors that sag together
        ({3: SAG, 7: SAG}, 3, THREE, []),  # one that was knocked, and another in another posture
        (dict(zip((3, 4, 5), 2 * np.eye(3), strict=True)), 3, THREE, []),  # errors that point elsewhere
        ({3: SAG, 4: SAG, 5: SAG}, 1, np.arange(POSTURES) // 3, [3, 4, 5]),  # repeats of one posture
        ({3: SAG, 4: SAG, 5: SAG}, 1, np.arange(POSTURES), []),  # three postures
    ],
)
def test_errors_of_one_posture_that_agree_are_kept(off: Any, targets: int, pose: np.ndarray, rows: list[int]) -> None:
    assert kept(off, targets, pose) == rows


def test_copies_of_a_row_say_nothing() -> None:
    data: Any = Rows(q=np.zeros((12, 6)), pose=np.arange(12) // 3, target=np.zeros(12, dtype=int), target_names=["t"])
    errors = np.random.default_rng(1).normal(0, 0.02, (12, 3))
    errors[3:6] = SAG
    assert not agreeing_rows(data, errors, np.linalg.norm(errors, axis=1) > 0.2).any()
