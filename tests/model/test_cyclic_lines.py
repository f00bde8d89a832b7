"""Several lines of one joint as one error: which of them leads, and how it is told."""

from __future__ import annotations

import numpy as np
import pytest

from posture_opt.model.effects.cyclic_error import CyclicError


def lines(*cycles: float) -> list[CyclicError]:
    return [CyclicError(joint="elbow", cycles=k) for k in cycles]


@pytest.mark.parametrize("cycles", [(101.0, 202.0, 303.0), (202.0, 303.0, 101.0), (57.0, 202.0, 101.0, 404.0, 303.0)])
def test_the_fundamental_leads(cycles: tuple[float, ...]) -> None:
    found = CyclicError.joined(lines(*cycles))
    assert found.cycles == 101.0
    assert found.further == tuple(k for k in cycles if k != 101.0)


@pytest.mark.parametrize("count", [3, 6, 9])
def test_lines_without_a_fundamental_are_led_by_the_strongest(count: int) -> None:
    rng = np.random.default_rng(count)
    n = 400
    drawn = [np.exp(rng.uniform(np.log(2.5), np.log(300), count)) for _ in range(n)]
    wrong = sum(CyclicError.joined(lines(*cycles)).cycles != cycles[0] for cycles in drawn)
    # At most one in twenty by construction; three standard errors of the count beyond that.
    assert wrong <= 0.05 * n + 3 * (0.05 * 0.95 * n) ** 0.5


def test_a_sentence_names_the_first_of_many_lines() -> None:
    found = CyclicError.joined(lines(10, 20, 30, 40, 50, 60, 7.3, 131))
    assert found.words == (
        "elbow has a cyclic error of 10.00 cycles per revolution with harmonics 2, 3, 4 and 2 more "
        "and further lines at 7.30 and 131"
    )
    assert "harmonics 2, 3, 4, 5 and 6" in found.qualifier  # in documents, all of them
