"""Whether a size is told from none, and what does not lead where it is not."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import posture_opt as po
from posture_opt.diagnosis.causes.causes import is_determined
from posture_opt.diagnosis.diagnose import _determined_first
from tests.helpers.planar_2r import position
from tests.helpers.planar_files import PROBLEM, write

NOISE = 2e-5  # m
QUANTILES = {1: 3.841, 2: 5.991, 3: 7.815}
"""The 95 % points of χ² by degrees of freedom, from any table."""


@pytest.mark.parametrize("k", list(QUANTILES))
def test_the_region_is_that_of_a_chi_square(k: int) -> None:
    rng = np.random.default_rng(k)
    A = rng.normal(size=(k, k))
    C = 1e-8 * A @ A.T
    direction = np.linalg.cholesky(C) @ np.eye(k)[0]  # χ² of it is one, in any units
    for factor, told in ((0.99, False), (1.01, True)):
        assert is_determined(factor * np.sqrt(QUANTILES[k]) * direction, C) is told


def test_of_a_wave_the_amplitude_counts_and_not_its_phase() -> None:
    """Sine and cosine both within two standard errors of zero, as a phase far from the data leaves them."""
    values = 1e-4 * np.array([0.6, 0.8])
    along, across = np.array([0.6, 0.8]), np.array([-0.8, 0.6])
    C = 1e-12 * (np.outer(along, along) + 1e4 * np.outer(across, across))
    assert np.all(np.abs(values) < 2 * np.sqrt(np.diag(C)))
    assert is_determined(values, C)
    assert not is_determined(np.array([-2e-3]), np.array([[46e-3**2]]))


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
    lead = " ".join(vague.report().split("Causes, largest contribution first")[0].split())
    assert lead.partition("One cause explains")[2].lstrip().startswith("the errors: joint2 has an eccentric gear")
    assert "Of a size that these data do not determine: joint1 has an eccentric gear" in lead
    nothing = replace(found, effects=tuple(replace(f, determined=False) for f in (first, second)))
    lead = nothing.report().split("Causes, largest contribution first")[0]
    assert "that no cause of known size explains" in " ".join(lead.split())
    assert "these data do not determine the size" in " ".join(nothing.report().split())
