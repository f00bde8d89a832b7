"""Whether a size is told from none, and what does not lead where it is not."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import posture_opt as po
from tests.helpers.planar_2r import position
from tests.helpers.planar_files import PROBLEM, write

NOISE = 2e-5  # m


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
