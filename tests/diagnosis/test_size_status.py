"""Whether a size is told from none, and what does not lead where it is not."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import posture_opt as po
from posture_opt.diagnosis.causes.determined_sizes import is_determined
from posture_opt.diagnosis.diagnose import _determined_first
from tests.helpers.planar_2r import position
from tests.helpers.planar_files import PROBLEM, write

NOISE = 2e-5  # m


@pytest.mark.parametrize("spread", [[1.0], [1.0, 0.6], [1.0, 1.0, 0.1], [1.0] * 8, [30.0, *[1.0] * 7]], ids=str)
def test_a_size_exceeds_what_its_error_is_one_time_in_twenty(spread: list[float]) -> None:
    """Against drawn errors; satisfied by 1.96 errors in the worst direction at the least."""
    rng = np.random.default_rng(len(spread))
    k = len(spread)
    A, B = np.linalg.qr(rng.normal(size=(k, k)))[0] * spread, np.linalg.qr(rng.normal(size=(50, k)))[0]
    drawn = np.linalg.norm(rng.normal(size=(40_000, k)) @ (B @ A).T, axis=1)
    limit = np.quantile(drawn, 0.95)
    values = rng.normal(size=k)
    values *= limit / np.linalg.norm(B @ values)
    for factor, told in ((0.96, False), (1.04, True)):
        assert is_determined(1e-4 * factor * values, 1e-8 * A @ A.T, B) is told
    assert limit > 1.9 * np.linalg.norm(B @ A, 2)


def test_a_parameter_that_was_not_fitted_hides_no_wild_one() -> None:
    assert not is_determined(np.array([3.0, 0.0]), np.diag([4.0, 0.0]))
    assert is_determined(np.array([3.0, 0.0]), np.diag([1.0, 0.0]))
    assert is_determined(np.array([3.0]), np.zeros((1, 1)))


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
    lead = " ".join(vague.report().split("Causes, by what they explain")[0].split())
    assert lead.partition("One cause explains")[2].lstrip().startswith("the errors: joint2 has an eccentric gear")
    assert "Suspected, of a size that these data do not determine: joint1 has an eccentric gear" in lead
    amplitude = f"{first.cause.headline(first.sizes).partition(' ±')[0]} ±"
    assert amplitude in found.report()
    assert amplitude not in vague.report()
    nothing = replace(found, effects=tuple(replace(f, determined=False) for f in (first, second)))
    lead = nothing.report().split("Causes, by what they explain")[0]
    assert "that no cause of known size explains" in " ".join(lead.split())
    assert "these data do not determine the size: its uncertainty is as large" in " ".join(nothing.report().split())


def test_what_is_sure_beside_the_rest_alone_is_delivered_as_no_size(found: po.Diagnosis) -> None:
    place = found.effects[0].place
    assert place is not None
    among = replace(found, delivery=replace(found.delivery, together=(place,)))
    document = among.to_json()["delivered"]
    assert document["together"] == [{"kind": "gear_eccentricity", "target": "joint1"}]
    assert found.to_json()["delivered"]["together"] == []
    entries = {entry["joint"]: entry for entry in among.extended.to_dict()["effects"]}
    assert entries["joint1"].pop("size_undetermined") is True
    assert entries == {entry["joint"]: entry for entry in found.extended.to_dict()["effects"]}
    assert "no size of a cause (size_undetermined): gear_eccentricity(joint1)." in among.extended.to_yaml()
    words = [effect.stated_words for effect in po.problem_from_dict(without_files(among.extended.to_dict())).effects]
    assert words[0] == "gear eccentricity of joint1 (size undetermined)"
    assert "mrad" in words[1]
    assert "together with all else in extended.yaml" in " ".join(among.report(full=True).split())


def without_files(document: dict) -> dict:  # type: ignore[type-arg]
    """A problem without the covariance that stands beside it."""
    document = {**document, "uncertainty": {"sigma": {}}}
    document["effects"] = [{k: v for k, v in entry.items() if k != "covariance"} for entry in document["effects"]]
    return document
