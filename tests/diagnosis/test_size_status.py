"""Whether a size is told from none, and what does not lead where it is not."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import posture_opt as po
from posture_opt.diagnosis.causes.determined_sizes import is_determined
from posture_opt.diagnosis.diagnose import _determined_first
from posture_opt.report.measured_parts.diagnosis_sizes import fitted_sizes
from tests.helpers.planar_2r import position
from tests.helpers.planar_files import PROBLEM, write

NOISE = 2e-5  # m
QUANTILES = {1: 3.841, 2: 5.991, 3: 7.815}
"""The 95 % points of χ² by degrees of freedom, from any table."""


@pytest.mark.parametrize("k", list(QUANTILES))
def test_the_region_is_a_ball_as_wide_as_that_of_a_chi_square_at_most(k: int) -> None:
    rng = np.random.default_rng(k)
    A, B = rng.normal(size=(k, k)), rng.normal(size=(50, k))
    C = 1e-8 * A @ A.T
    worst = np.linalg.norm(B @ np.linalg.cholesky(C), 2)  # moves the tool points by one standard error at most
    values = rng.normal(size=k)
    values *= np.sqrt(QUANTILES[k]) * worst / np.linalg.norm(B @ values)
    for factor, told in ((0.99, False), (1.01, True)):
        assert is_determined(factor * values, C, B) is told


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> po.Diagnosis:
    """An arm with two eccentric gears, the heavier one in joint1."""
    folder: Path = tmp_path_factory.mktemp("status")
    rng = np.random.default_rng(61123)
    q = rng.uniform(-2.5, 2.5, (120, 2))
    turned = q + np.stack([6e-4 * np.sin(q[:, 0]), 3e-4 * np.sin(q[:, 1] + 1.0)], axis=1)
    write(folder / "data.csv", q, position(turned) + rng.normal(0, NOISE, q.shape))
    problem = po.problem_from_dict(PROBLEM)
    return po.diagnose(problem, po.read_measurements(folder / "data.csv", problem), flips=99, plan=False)


def test_what_is_determined_is_said_to_be(found: po.Diagnosis) -> None:
    first, second = (f for f in found.effects if f.effect is not None)
    assert (first.target, second.target) == ("joint1", "joint2")
    assert [entry["status"] for entry in found.to_json()["effects"]] == ["determined"] * len(found.effects)


def test_an_undetermined_size_never_leads(found: po.Diagnosis) -> None:
    first, second, *rest = found.effects
    vague = replace(found, effects=(*_determined_first(replace(first, determined=False), second), *rest))
    assert [entry["status"] for entry in vague.to_json()["effects"]][:2] == ["determined", "size_undetermined"]
    assert [bool(entry["estimate"]) for entry in vague.to_json()["effects"]][:2] == [True, False]
    assert "tool_shift_rms" not in vague.to_json()["effects"][1]
    lead = " ".join(vague.report().split("Causes, the largest first, geometry last")[0].split())
    assert lead.partition("One cause explains")[2].lstrip().startswith("the errors: joint2 has an eccentric gear")
    assert "Of a size that these data do not determine: joint1 has an eccentric gear" in lead
    amplitude = f"{first.cause.headline(fitted_sizes(found, first)).partition(' ±')[0]} ±"
    assert amplitude in found.report()
    assert amplitude not in vague.report()
    nothing = replace(found, effects=tuple(replace(f, determined=False) for f in (first, second)))
    lead = nothing.report().split("Causes, the largest first, geometry last")[0]
    assert "that no cause of known size explains" in " ".join(lead.split())
    assert "these data do not determine the size: its error is as large" in " ".join(nothing.report().split())
