"""Small numerical tools that every room shares, against their formulas."""

from __future__ import annotations

import numpy as np
import pytest

from posture_opt.errors import enumerated
from posture_opt.numerics import rms, rms_length, stacked_rows, turn_of


def test_root_mean_squares_of_numbers_and_of_vectors() -> None:
    vectors = np.array([[3.0, 4.0], [0.0, 1.0]])
    assert rms(vectors) == pytest.approx(np.sqrt((9 + 16 + 0 + 1) / 4))
    assert rms_length(vectors) == pytest.approx(np.sqrt((25 + 1) / 2))


def test_numbers_and_columns_are_stacked_as_rows() -> None:
    assert stacked_rows((1.0, np.array([2.0, 3.0])), 2).tolist() == [[1.0, 2.0], [1.0, 3.0]]


def test_a_turn_to_the_left_is_positive() -> None:
    a, b, c = np.array([0.0, 0.0]), np.array([2.0, 0.0]), np.array([0.0, 1.0])
    assert turn_of(a, b, c) == 2.0
    assert turn_of(a, c, b) == -2.0


def test_words_are_enumerated() -> None:
    assert [enumerated("abc"[:n]) for n in range(4)] == ["", "a", "a and b", "a, b and c"]
    assert enumerated(("a", "b", "c"), "or") == "a, b or c"
