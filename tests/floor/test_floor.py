"""One draw of each circumstance: what is named, what is left open, and sizes. Shares belong to the hunt."""

from __future__ import annotations

import pytest

from tests.floor.hunt import ask, draw, score
from tests.helpers.variants import conformance

SEED = 2042
NAMED = ("soft", "tilting_base", "other_sigma")
OPEN = ("two_arms", "scatter_between_stays", "other_nest")


@pytest.mark.parametrize("name", conformance(NAMED, NAMED))
def test_the_cause_is_named_with_its_size(name: str) -> None:
    case = draw(name, SEED, 0)
    found = score(case, ask(case))
    assert found["right"], found
    assert not found["false"], found
    assert all(abs(z) < 3 for z in found["z"]), found


@pytest.mark.parametrize("name", conformance(OPEN, ("two_arms", "scatter_between_stays")))
def test_what_no_name_explains_is_left_open(name: str) -> None:
    case = draw(name, SEED, 0)
    assert ask(case)["verdict"] == "unexplained"


@pytest.mark.parametrize("name", conformance(("clean_visits", "clean_readings", "clean_single"), ("clean_readings",)))
def test_nothing_is_said_of_an_arm_that_errs_by_its_geometry_alone(name: str) -> None:
    case = draw(name, SEED, 0)
    answer = ask(case)
    assert answer["verdict"] == "effects_found"
    assert not score(case, answer)["named"]
