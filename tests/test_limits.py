"""What goes beyond a limit is refused with the number that is accepted, and what is below it has a known cost."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
import yaml

import posture_opt as po
from posture_opt import limits
from posture_opt.limits import LIMITS, Budget
from tests.helpers.shipped import PROBLEMS

PLANAR: dict[str, Any] = yaml.safe_load((PROBLEMS / "insert_planar_2r.yaml").read_text("utf-8"))
MEASURED = "insert_planar_2r_measured"
ROW = {"joint1 [deg]": 10.0, "joint2 [deg]": 20.0, "x [mm]": 1800.0, "y [mm]": 700.0}


def problem(**changes: Any) -> po.Problem:
    return po.problem_from_dict({**PLANAR, **changes})


def table(rows: int, **columns: Callable[[int], object]) -> dict[str, list[object]]:
    plain: dict[str, list[object]] = {head: [value] * rows for head, value in ROW.items()}
    return plain | {name: [of(k) for k in range(rows)] for name, of in columns.items()}


def measured(rows: int, **columns: Callable[[int], object]) -> po.Measurements:
    return po.read_measurements(table(rows, **columns), po.load_problem(MEASURED))


def capsule(k: int) -> dict[str, Any]:
    return {"joint": "tool", "from": [f"{-k} mm", "0 m", "0 m"], "to": ["0 m", "0 m", "0 m"], "radius": "1 mm"}


def beyond_joints(count: int) -> None:
    one = PLANAR["robot"]["joints"][0]
    problem(robot={"kind": "dh", "joints": [{**one, "name": f"j{k}"} for k in range(count)]}, uncertainty={}, task=None)


def obstacles(count: int) -> None:
    spheres = [
        {"name": f"o{k}", "kind": "sphere", "radius": "1 mm", "xyz": ["9 m", "0 m", "0 m"]} for k in range(count)
    ]
    problem(cell={"obstacles": spheres})


def features(count: int) -> None:
    found = [{"name": f"f{k}", "position": [f"{k} mm", "0 m", "0 m"]} for k in range(count)]
    problem(task={"kind": "probe", "workpiece": {"x": "1 m", "y": "0 m", "z": "0 m"}, "features": found})


def effects(count: int) -> None:
    lines = [
        {"kind": "cyclic_error", "joint": "joint1", "cycles": 3 + k, "estimate": {"cos": "0 mrad", "sin": "1 mrad"}}
        for k in range(count)
    ]
    problem(effects=lines)


def folds(count: int) -> None:
    from posture_opt.calibration.estimation.error_statistics import folds_of

    folds_of(rows_of(count), count, "pose")


def pixels(count: int) -> None:
    """Refused by its header: the picture is not unpacked."""
    from io import BytesIO
    from pathlib import Path

    from PIL import Image

    from posture_opt.measurements.board_detection import picture_of

    held = BytesIO()
    Image.new("1", (count, 1)).save(held, "png")
    picture_of(held.getvalue(), Path("wide.png"))


def board_points(count: int) -> None:
    from posture_opt.measurements.board_detection import Board

    try:
        Board.of(f"grid:2x{count}:25mm", "5X5_1000")
    except po.errors.BadValueError as error:
        raise po.errors.InputError(error.issue(("--board",))) from None


def rows_of(count: int) -> Any:
    import numpy as np

    return np.arange(count)


ASKED: dict[str, Callable[[int], object]] = {
    "MOST_JOINTS": beyond_joints,
    "MOST_CAPSULES": lambda n: problem(robot={**PLANAR["robot"], "shape": [capsule(k) for k in range(n)]}),
    "MOST_OBSTACLES": obstacles,
    "MOST_EFFECTS": effects,
    "MOST_FEATURES": features,
    "MOST_PATH_POINTS": lambda n: problem(
        task={"kind": "trace", "points": [["1 m", "0 m", f"{k} mm"] for k in range(n)]}
    ),
    "MOST_STARTS": lambda n: problem(solver={"kind": "ipopt", "starts": n}),
    "MOST_MAP_TARGETS": lambda n: po.map_targets(problem(), counts=(n, 1, 1)),
    "MOST_SAMPLES": lambda n: po.simulate(problem(), (0.1, 0.2), n=n),
    "MOST_PROBLEM_FILES": lambda n: po.select_postures(dict.fromkeys(map(str, range(n)), problem())),
    "MOST_PLACES": lambda n: measured(n, target=str),
    "MOST_ROBOTS": lambda n: measured(n, robot=str),
    "MOST_FOLDS": folds,
    "MOST_PLANNED": lambda n: po.plan_measurements(po.load_problem(MEASURED), n),
    "MOST_CANDIDATES": lambda n: po.plan_measurements(po.load_problem(MEASURED), 5, candidates=n),
    "MOST_COMPENSATED": lambda n: po.compensate(po.load_problem("insert_planar_2r_calibrated"), table(n)),
    "MOST_PIXELS": pixels,
    "MOST_BOARD_POINTS": board_points,
}
THINNED = ("MOST_FITTED", "MOST_SEARCHED")
STREAMED = ("MOST_CELLS",)


def limit_of(name: str) -> Budget:
    found: Budget = getattr(limits, name)
    return found


def test_every_limit_is_listed_and_asked_about() -> None:
    names = {name for name, value in vars(limits).items() if isinstance(value, Budget)}
    assert names == {*ASKED, *THINNED, *STREAMED}
    assert {id(limit_of(name)) for name in names} == {id(limit) for limit in LIMITS}


@pytest.mark.parametrize("name", ASKED)
def test_one_more_is_refused_with_the_number_that_is_accepted(name: str) -> None:
    limit = limit_of(name)
    with pytest.raises(po.errors.InputError) as caught:
        ASKED[name](limit.most + 1)
    assert str(limit.most) in str(caught.value)


def test_tables_are_not_read_beyond_the_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("posture_opt.measurements.columns.MOST_CELLS", Budget("cells", 40, "", "", "thin them out"))
    assert len(measured(10)) == 10
    with pytest.raises(po.errors.InputError, match="more than the 40 cells that are accepted – thin them out"):
        measured(11)


@pytest.mark.parametrize(("joints", "rows"), [(2, 100_000), (6, 100_000), (20, 30_000)])
def test_rows_to_fit_are_fewer_for_more_joints(joints: int, rows: int) -> None:
    assert limits.MOST_FITTED.rows(100_000, joints) == rows
