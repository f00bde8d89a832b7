"""Every listed kind of measurement: derivatives against differences, words, columns, and faulty files."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import posture_opt as po
from posture_opt.measurements.data_section import DataSpec
from posture_opt.measurements.kinds import KINDS, Kind, PairSpec, Pose, Position, Seen
from posture_opt.measurements.kinds.kind import stacked
from tests.helpers.instruments import JOINTS, TrueArm, distance_table, level_table, plane_table

ROWS, PLACES = 12, 3
SAID = DataSpec(pairs={"right": PairSpec(problem="right.yaml").with_arm(po.load_problem("drill_ur5e").arm, {})})
"""What a file may say of places."""
UP = np.array([0.6, 0.0, 0.8])


READING = np.full((ROWS, 7), 0.9) + 0.02 * np.arange(7.0 * ROWS).reshape(ROWS, 7) % 0.7
"""About a metre, or a radian."""


def seen_by(position: np.ndarray, R: np.ndarray, values: np.ndarray, reading: np.ndarray = READING) -> Seen:
    """Rows of three places."""
    place = np.arange(ROWS) % PLACES
    return Seen(list(position.T), [list(R[:, :, j].T) for j in range(3)], reading, place, values[place])


def readings_of(kind: Kind, position: np.ndarray, R: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Readings whose orientations are those of the tool, as errors of orientations are small."""
    if not kind.oriented:
        return READING
    none = np.concatenate([READING[:, :3], np.tile([1.0, 0, 0, 0], (ROWS, 1))], axis=1)
    frame = kind.orientations(seen_by(position, R, values, none))
    turned = Rotation.from_matrix(np.swapaxes(frame, 1, 2) @ R).as_quat(scalar_first=True)
    return np.concatenate([READING[:, :3], turned], axis=1)


def a_kind(
    listed: type[Kind], framed: bool, rng: np.random.Generator
) -> tuple[Kind, np.ndarray, np.ndarray, np.ndarray]:
    """A kind prepared for random rows, their points (N, 3), rotations (N, 3, 3), and unknowns (P, u)."""
    names = tuple("abc")
    position, R = rng.uniform(-1, 1, (ROWS, 3)), Rotation.from_quat(rng.normal(size=(ROWS, 4))).as_matrix()
    kind = replace(listed.of(SAID, names), names=names)
    kind = kind.in_own_frame() if framed else kind
    kind = kind.prepared(seen_by(position, R, np.zeros((PLACES, 0))), np.ones(3, dtype=bool), UP)
    return kind, position, R, rng.uniform(-0.2, 0.2, (PLACES, kind.width))


def small_turn(w: np.ndarray) -> np.ndarray:
    """(3, 3) the rotation by a vector w, by its series."""
    W = np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])
    return np.eye(3) + W + W @ W / 2


@pytest.mark.parametrize(
    ("listed", "framed"),
    [*((kind, False) for kind in KINDS if not kind.second_label), (Position, True), (Pose, True)],
)
def test_derivatives_are_those_of_differences(listed: type[Kind], framed: bool) -> None:
    rng = np.random.default_rng(3)
    kind, position, R, values = a_kind(listed, framed, rng)
    h, n, seen = 1e-6, 6, readings_of(kind, position, R, values)

    def reading(shift: np.ndarray, turn: np.ndarray, more: np.ndarray) -> np.ndarray:
        moved = np.einsum("ij,njk->nik", small_turn(turn), R)
        slots = kind.error(seen_by(position + shift, moved, values + more, seen))
        return stacked([*slots, *[0.0] * (n - len(slots))], ROWS)

    zero, none = np.zeros(3), np.zeros_like(values)
    at = seen_by(position, R, values, seen)
    for v, w in ((rng.normal(size=3), zero), (zero, rng.normal(size=3))):
        slots = kind.slope(at, v, w)
        numeric = (reading(h * v, h * w, none) - reading(-h * v, -h * w, none)) / (2 * h)
        assert np.allclose(stacked([*slots, *[0.0] * (n - len(slots))], ROWS), numeric, atol=1e-7)
    for axis in range(len(kind.unknowns("a"))):
        step = none.copy()
        step[:, axis] = h
        slots = kind.unknown_slope(at, axis)
        numeric = (reading(zero, zero, step) - reading(zero, zero, -step)) / (2 * h)
        assert np.allclose(stacked([*slots, *[0.0] * (n - len(slots))], ROWS), numeric, atol=1e-7)


def problem(**data: object) -> po.Problem:
    return po.problem_from_dict({"robot": {"kind": "preset", "name": "ur10"}, "data": data})


def test_a_table_of_each_kind_comes_back_from_a_data_frame() -> None:
    rng = np.random.default_rng(0)
    makers = (plane_table, distance_table, level_table)
    for table in (make(TrueArm(), rng, 3, 0.0) for make in makers):
        data = po.read_measurements(table, problem())
        again = po.read_measurements(data.to_dataframe(), problem())
        assert again.kind.kind == data.kind.kind
        assert again.point_names == data.point_names
        assert np.array_equal(again.reading, data.reading)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("distance [m]",), "distance is given without anchor|anchor is given without distance"),
        (("anchor",), "distance is given without anchor"),
        (("distance [m]", "anchor"), "nothing is measured"),
    ],
)
def test_a_file_with_half_a_reading_is_refused(change: tuple[str, ...], words: str) -> None:
    table = distance_table(TrueArm(), np.random.default_rng(0), 2, 0.0)
    with pytest.raises(po.errors.InputError, match=words):
        po.read_measurements({key: value for key, value in table.items() if key not in change}, problem())


def test_two_kinds_in_one_file_are_refused_and_idle_places_reported() -> None:
    table = distance_table(TrueArm(), np.random.default_rng(0), 2, 0.0)
    with pytest.raises(po.errors.InputError, match=r"both .*plane.* are given"):
        po.read_measurements({**table, "plane": np.array(["a"] * len(table["anchor"]))}, problem())
    data = po.read_measurements(table, problem(anchors={"bar0": {"offset": "free"}, "baz1": {}}))
    assert [w for w in data.warnings if "data.anchors names 'baz1'" in w and "bar1" in w]
    assert data.joint_names == JOINTS
