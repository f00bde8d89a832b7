"""What has no name: curves are listed only as long as the names of the final model do not stand for them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import posture_opt as po
from posture_opt.diagnosis.scores.candidates import Candidate
from posture_opt.diagnosis.scores.unnamed_components import UnnamedComponent
from posture_opt.diagnosis.search.linearised_data import LinearisedData, linearise_calibration
from posture_opt.diagnosis.search.search import SearchResult, remaining_unnamed, search_effects
from posture_opt.model.effects.cyclic_error import CyclicError
from tests.helpers.planar_2r import position
from tests.helpers.planar_files import PROBLEM, write

NOISE = 2e-5  # m


def dent(q: np.ndarray, at: float) -> np.ndarray:
    return 5e-4 * np.exp(-0.5 * ((q - at) / 0.3) ** 2)


@pytest.fixture(scope="module")
def dented(tmp_path_factory: pytest.TempPathFactory) -> tuple[po.Problem, po.Measurements]:
    rng = np.random.default_rng(10)
    q = rng.uniform(-2.5, 2.5, (120, 2))
    true = q + np.stack([dent(q[:, 0], 0.7), dent(q[:, 1], -0.4)], axis=1)
    file = tmp_path_factory.mktemp("dented") / "data.csv"
    write(file, q, position(true) + rng.normal(0, NOISE, q.shape))
    problem = po.problem_from_dict(PROBLEM)
    return problem, po.read_measurements(file, problem)


@pytest.fixture(scope="module")
def scanned(dented: tuple[po.Problem, po.Measurements]) -> tuple[LinearisedData, SearchResult]:
    linearised = linearise_calibration(po.calibrate(*dented))
    return linearised, search_effects(linearised)


@pytest.mark.long
def test_what_the_names_stand_for_is_listed_no_more(scanned: tuple[LinearisedData, SearchResult]) -> None:
    linearised, found = scanned
    curves = [s for s in found.chosen if not s.named]
    assert {s.target for s in curves} == {"joint1", "joint2"}
    # A name that does all that the first curve does, under the name of a wave.
    stand_in = Candidate(CyclicError(joint=curves[0].target, cycles=3.0), curves[0].Z)
    others = [s for s in curves if s.target != curves[0].target]
    assert list(remaining_unnamed(linearised, replace(found, names=replace(found, chosen=(stand_in,))))) == others
    assert list(remaining_unnamed(linearised, replace(found, names=None))) == curves
    everything = tuple(Candidate(CyclicError(joint=s.target, cycles=3.0), s.Z) for s in curves)
    assert list(remaining_unnamed(linearised, replace(found, names=replace(found, chosen=everything)))) == curves


@pytest.mark.long
def test_the_document_tells_where_and_how_surely(dented: tuple[po.Problem, po.Measurements]) -> None:
    found = po.diagnose(*dented)
    assert found.verdict == "unexplained"
    told = found.to_json()["unexplained"]
    assert {place.rpartition(": ")[2] for place in told["place"]} == {"joint1", "joint2"}
    assert told["p_value"] < 1e-6
    assert all(isinstance(u, UnnamedComponent) for u in found.unexplained)
