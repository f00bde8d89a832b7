"""Programs beside the files of other commands: the same stops as their tables, with waits."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

from tests.export.programs import READERS
from tests.helpers.command_line import invoke

ENDS = {"urscript": (".script",), "krl": (".src", ".dat"), "rapid": (".mod",), "jointstate": (".yaml",)}


def read(folder: Path, kind: str, name: str) -> np.ndarray:
    files = {f"{name}{end}": (folder / f"{name}{end}").read_text() for end in ENDS[kind]}
    return np.array(READERS[kind](files, ["revolute"] * 6))


@pytest.mark.parametrize("kind", READERS)
def test_a_plan_is_visited_posture_by_posture_with_waits(kind: str, tmp_path: Path) -> None:
    words = ("plan-measurements", "--problem", "insert_ur10", "--count", 4, "--candidates", 60, "--repeats", 2)
    answer = invoke(*words, "--program", kind, "--wait", 3, "--speed", 20, "--out", tmp_path / "plan", "--no-plots")
    assert answer.exit_code == 0, answer.output
    rows = list(csv.reader((tmp_path / "plan" / "plan.csv").read_text().splitlines()[1:]))
    planned = np.radians([[float(cell) for cell in row[:6]] for row in rows])
    assert len(planned) == 8
    found = read(tmp_path / "plan", kind, "measure")
    # The table has all digits of the commands: the program goes to the very same ones.
    assert np.abs(found - planned).max() < 1e-6
    text = "".join((tmp_path / "plan" / f"measure{end}").read_text() for end in ENDS[kind])
    assert "posture 4, round 2" in text
    waits = {"urscript": "sleep(3.0)", "krl": "WAIT SEC 3.0", "rapid": "WaitTime\\InPos, 3.0;"}
    assert kind not in waits or text.count(waits[kind]) == 8


@pytest.mark.parametrize("kind", READERS)
def test_joints_arrive_from_the_sides_that_the_targets_state(kind: str, tmp_path: Path) -> None:
    """The last move of the joint with play before each target goes the way that its column says."""
    path = tmp_path / "targets.csv"
    sides = (1, -1, 1, -1, 1)
    places = ("600, 200, 300", "650, 150, 250", "620, -50, 300", "600, 200, 300", "650, 150, 250")
    rows = [f"{place}, {side}" for place, side in zip(places, sides, strict=True)]
    path.write_text("\n".join(["x [mm], y [mm], z [mm], shoulder_pan.approach", *rows]) + "\n")
    words = ("compensate", path, "--problem", "insert_ur10_extended", "--no-plots")
    answer = invoke(*words, "--out", tmp_path / "out", "--program", kind, "--wait", 2, "--approach", "0 mm")
    assert answer.exit_code == 0, answer.output
    table = list(csv.reader((tmp_path / "out" / "compensated.csv").read_text().splitlines()[1:]))
    targets = np.radians([[float(cell) for cell in row[:6]] for row in table])
    stops = read(tmp_path / "out", kind, "compensated")
    at = [int(np.flatnonzero(np.abs(stops - q).max(axis=1) < 1e-6)[0]) for q in targets]
    pan = stops[:, 0]
    assert [int(np.sign(pan[k] - pan[k - 1])) for k in at] == list(sides)
    assert all(np.abs(pan[k] - pan[k - 1]) > np.radians(1.9) for k in at)
    text = "".join((tmp_path / "out" / f"compensated{end}").read_text() for end in ENDS[kind])
    assert "must arrive" not in text  # the program does
    waits = {"urscript": "sleep(2.0)", "krl": "WAIT SEC 2.0", "rapid": "WaitTime\\InPos, 2.0;"}
    assert kind not in waits or text.count(waits[kind]) == len(sides)  # none at the stops in front
    assert "comes to lines 4, 5, 6 from another side" in " ".join(answer.output.split())


@pytest.mark.long
def test_compensated_targets_become_a_program(tmp_path: Path) -> None:
    path = tmp_path / "targets.csv"
    path.write_text("x [mm], y [mm], z [mm]\n600, 200, 300\n650, 150, 250\n620, -50, 300\n")
    words = ("compensate", path, "--problem", "insert_ur10_extended", "--no-plots")
    answer = invoke(*words, "--out", tmp_path / "out", "--program", "rapid", "--approach", "0 mm")
    assert answer.exit_code == 0, answer.output
    rows = list(csv.reader((tmp_path / "out" / "compensated.csv").read_text().splitlines()[1:]))
    q = np.radians([[float(cell) for cell in row[:6]] for row in rows])
    stops = read(tmp_path / "out", "rapid", "compensated")
    assert np.abs(stops[1:] - q).max() < 1e-12
    assert np.degrees(stops[1] - stops[0]) == pytest.approx([2, 0, 0, 0, 0, 0])  # the side that the task states
    assert "Keep the order of the stops" in (tmp_path / "out" / "compensated.mod").read_text()
    alone = invoke(*words, "--program", "rapid")
    assert alone.exit_code == 2
    assert "--program goes with --out" in alone.stderr
