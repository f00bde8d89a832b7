"""One file of several instruments, of a simulator of its own: every row counts by its own σ and teaches one arm."""

from __future__ import annotations

import numpy as np
import pytest

import posture_opt as po
from tests.helpers.instruments import (
    ANCHORS,
    SOCKETS,
    TrueArm,
    distance_table,
    level_table,
    misplaced,
    mixed_table,
    plane_table,
    postures,
    socket_table,
    tracker_table,
)
from tests.helpers.pairs import ur10_problem

SIGMAS = {"position": 3e-5, "plane": 2e-5, "distance": 2e-5, "level": 3e-5}
TURNED = np.array([[0.8, -0.6, 0, 1.0], [0.6, 0.8, 0, -2.0], [0, 0, 1, 0.5], [0, 0, 0, 1]])  # T_tracker_base


def problem(**robot: object) -> po.Problem:
    units = {name: f"{1e3 * s:g} {'mrad' if name == 'level' else 'mm'}" for name, s in SIGMAS.items()}
    return ur10_problem(units, **robot)


def tables(arm: TrueArm, rng: np.random.Generator, T: np.ndarray) -> dict[str, dict[str, object]]:
    found = {
        "plates": plane_table(arm, rng, 25, SIGMAS["plane"], 0.0),
        "wire": distance_table(arm, rng, 10, SIGMAS["distance"]),
        "tracker": tracker_table(arm, rng, 10, SIGMAS["position"], T),
        "bubble": level_table(arm, rng, 10, SIGMAS["level"]),
    }
    return {name: {k: v for k, v in t.items() if not k.endswith(".approach")} for name, t in found.items()}


def test_four_instruments_teach_one_arm() -> None:
    rng = np.random.default_rng(21)
    arm = TrueArm.drawn(rng)
    given = problem(base="free")
    table = mixed_table(tables(arm, rng, TURNED))
    data = po.read_measurements(table, given)
    assert len(data) == 75 + 40 + 3 * 10 + 2 * 10
    found = po.calibrate(given, data, plan=False)
    assert 0.8 < found.variance < 1.25
    truth = np.array([arm.error_of(p.name) if p.group == "geometry" else np.nan for p in found.parameters])
    z = ((found.x - truth) / found.std)[found.assumed]
    assert 0.5 < np.sqrt(np.mean(z**2)) < 1.5
    values = {p.name: p.nominal + v for p, v in zip(found.parameters, found.x, strict=True)}
    q = postures(np.random.default_rng(99), 60)
    assert misplaced(values, q, arm.point(q)) < 6e-5
    document = found.estimates_json()["instruments"]
    rows = {name: (one["kind"], one["rows"]) for name, one in document.items()}
    assert rows == {
        "plates": ("plane", 75),
        "wire": ("distance", 40),
        "tracker": ("position", 10),
        "bubble": ("level", 10),
    }
    for name, key in (("plates", "plane"), ("wire", "distance"), ("tracker", "position"), ("bubble", "level")):
        assert document[name]["scatter"] == pytest.approx(SIGMAS[key], rel=0.4)
        assert document[name]["p_value"] > 1e-3
    post = document["wire"]["unknowns"]["anchor[bar0]"]
    assert np.allclose([post[a] for a in "xyz"], ANCHORS[0], atol=4e-3)
    # T_world_tracker is the inverse of the tracker's.
    frame = document["tracker"]["unknowns"]["tracker"]
    assert np.allclose([frame[a] for a in "xyz"], -TURNED[:3, :3].T @ TURNED[:3, 3], atol=6e-3)


@pytest.mark.long
def test_a_diagnosis_names_the_instrument_whose_sigma_is_wrong() -> None:
    rng = np.random.default_rng(22)
    arm = TrueArm.drawn(rng)
    own = tables(arm, rng, np.eye(4))
    given = problem()
    sound = po.diagnose(given, po.read_measurements(mixed_table(own), given), plan=False)
    assert not sound.uneven
    own["wire"]["distance [m]"] = own["wire"]["distance [m]"] + rng.normal(0, 8e-5, 40)
    found = po.diagnose(given, po.read_measurements(mixed_table(own), given), plan=False)
    assert [(u.effect.kind, u.effect.target) for u in found.uneven] == [("stated_sigma", "wire")]
    assert found.uneven[0].effect.factor == pytest.approx(np.hypot(2e-5, 8e-5) / 2e-5, rel=0.4)
    assert "the wire errors are larger" in found.report().lower().replace("\n", " ")


@pytest.mark.conformance
def test_a_known_distance_of_sockets_beside_plates_gives_the_size() -> None:
    rng = np.random.default_rng(25)
    arm = TrueArm.drawn(rng)
    table = mixed_table({"ball": socket_table(arm, rng, 12, 2e-5), "plates": plane_table(arm, rng, 12, 2e-5, 0.0)})
    length = float(np.linalg.norm(SOCKETS[0] - SOCKETS[2]))
    errors = []
    for known in ([], [["socket0", "socket2", f"{1e3 * length:.6f} mm"]]):
        text = problem().to_dict()
        text["uncertainty"]["measurement"]["position"] = "0.02 mm"
        given = po.problem_from_dict({**text, "data": {"distances": known}})
        data = po.read_measurements({k: v for k, v in table.items() if not k.endswith("approach")}, given)
        assert not data.warnings
        found = po.calibrate(given, data, plan=False)
        values = {p.name: p.nominal + v for p, v in zip(found.parameters, found.x, strict=True)}
        q = postures(np.random.default_rng(99), 60)
        errors.append(misplaced(values, q, arm.point(q)))
        assert ("the size of the arm" in " ".join(found.report().split())) is not bool(known)
    assert errors[1] < 0.4 * errors[0]
    text["data"] = {"distances": [["socket0", "socket9", "1 m"]]}
    wrong = po.problem_from_dict(text)
    with pytest.raises(po.errors.InputError, match="no row touches 'socket9'"):
        po.calibrate(wrong, data, plan=False)


def test_rows_come_back_from_a_data_frame_and_half_readings_are_refused() -> None:
    rng = np.random.default_rng(23)
    given = problem()
    table = mixed_table(tables(TrueArm(), rng, np.eye(4)))
    data = po.read_measurements(table, given)
    again = po.read_measurements(data.to_dataframe(), given)
    assert np.array_equal(again.reading, data.reading)
    assert np.array_equal(again.part, data.part)
    assert again.point_names == data.point_names
    both = {**table, "plane": ["a"] * len(table["instrument"])}
    with pytest.raises(
        po.errors.InputError, match="the instrument 'wire' fill columns of touches of planes, distances"
    ):
        po.read_measurements(both, given)
    gap = {**table, "anchor": ["" if k == 80 else v for k, v in enumerate(table["anchor"])]}
    with pytest.raises(po.errors.InputError, match="the cell is empty"):
        po.read_measurements(gap, given)
