"""Errors of several targets of one posture that agree are the arm's, and no outliers."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from posture_opt.calibration.estimation.fit import agreeing_rows

SAG = np.array([0.0, 0.0, -2.0])


class Rows(SimpleNamespace):
    """Columns of a table."""

    q: np.ndarray

    def __len__(self) -> int:
        return len(self.q)


def session(postures: int = 12, targets: int = 3) -> tuple[Any, np.ndarray]:
    """Each target in each posture, off by noise."""
    rng = np.random.default_rng(1)
    q = np.repeat(rng.uniform(-1, 1, (postures, 6)), targets, axis=0)
    data: Any = Rows(
        q=q, pose=np.repeat(np.arange(postures), targets), target=np.tile(np.arange(targets), postures),
        target_names=[f"t{i}" for i in range(targets)],
    )  # fmt: skip
    return data, rng.normal(0, 0.02, (len(q), 3))


def test_three_reflectors_that_sag_together_are_kept() -> None:
    data, errors = session()
    errors[3:6] += SAG
    gross = np.linalg.norm(errors, axis=1) > 0.2
    assert agreeing_rows(data, errors, gross).tolist() == gross.tolist()


def test_one_reflector_that_was_knocked_is_an_outlier() -> None:
    data, errors = session()
    errors[3] += SAG
    errors[7] += SAG  # another posture
    gross = np.linalg.norm(errors, axis=1) > 0.2
    assert not agreeing_rows(data, errors, gross).any()


def test_errors_that_point_elsewhere_do_not_agree() -> None:
    data, errors = session()
    errors[3:6] += 2 * np.eye(3)
    gross = np.linalg.norm(errors, axis=1) > 0.2
    assert not agreeing_rows(data, errors, gross).any()


def test_repeats_that_agree_are_no_outliers_and_copies_say_nothing() -> None:
    data, errors = session(targets=1)
    data.pose = np.arange(12) // 3
    errors[3:6] += SAG
    gross = np.linalg.norm(errors, axis=1) > 0.2
    assert agreeing_rows(data, errors, gross).tolist() == gross.tolist()
    errors[4] = errors[5] = errors[3]
    assert not agreeing_rows(data, errors, gross).any()
    data.pose = np.arange(12)
    assert not agreeing_rows(data, errors, gross).any()
