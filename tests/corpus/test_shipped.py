"""Every problem and every data file that is shipped, through every command that fits it, with ``--out``.

In every run of the tests: all that is answered in a second or two. The rest, which searches, and figures of
one problem of each kind by ``pytest -m exhaustive``, some ten minutes of processor time.
"""

from __future__ import annotations

import math
import shlex
from collections.abc import Iterable
from pathlib import Path

import pytest

import posture_opt as po
from tests.helpers.command_server import CommandServer
from tests.helpers.shipped import PROBLEMS, builtin_names
from tests.helpers.variants import conformance

QUICK = {
    "uncertainty": "uncertainty --problem NAME --posture POSTURE --out out --no-plots --json",
    "simulate": "simulate --problem NAME --posture POSTURE -n 50 --out out --no-plots --json",
    "dh": "export --problem NAME --to dh --out out --json",
    "urdf": "export --problem NAME --to urdf --out out --json",
}
SLOW = {
    "solve": "--problem NAME --out out --no-plots --json",
    "map": "map --problem NAME --grid 3x3 --out out --no-plots --json",
    "accuracy": "map --problem NAME --grid 3x3 --quantity accuracy --out out --no-plots --json",
    "plan": "plan-measurements --problem NAME --count 30 --candidates 300 --out out --no-plots --json",
    "compare": "compare NAME insert_planar_2r_calibrated --out out --no-plots --json",
    "c": "export --problem NAME --to c --out out --json",
    "krl": "export --problem NAME --to krl --out out --json",
}
OF_EACH_KIND = ("insert_planar_2r", "insert_scara_tray", "trace_scara", "insert_urdf_arm", "insert_ur10_extended")
"""In the plane and in space, of one hole, of several and along a path: their figures are drawn, too."""
"""What can be asked of a problem -> the words; NAME is its name, POSTURE the middle of its joints."""
MEASURED = {
    # shipped measurements -> the problems that they are of
    "kuka_iiwa14_sockets.csv": ("kuka_iiwa14_sockets",),
    "planar_2r_batch.csv": ("insert_planar_2r_measured",),
    "planar_2r_measured.csv": ("insert_planar_2r_measured",),
    "ur10_draw_wire.csv": ("ur10_draw_wire",),
    "ur10_camera.csv": ("ur10_camera",),
    "ur10_mixed.csv": ("ur10_mixed",),
    "ur10_two_arms.csv": ("ur10_two_arms",),
    "ur10_level.csv": ("ur10_level",),
    "ur10_touched_plates.csv": ("ur10_touched_plates",),
    "ur10_another_day.csv": ("insert_ur10_measured", "insert_ur10_extended"),
    "ur10_measured.csv": ("insert_ur10_measured", "insert_ur10_extended"),
}
READ = {"panda_bead.csv", "scara_bead.csv", "ur10_seam.csv", "planar_2r_calibrated.csv"}
"""Those that a shipped problem names itself."""
OF_DATA = {
    "calibrate": "calibrate DATA --problem NAME",
    "calibrate by block": "calibrate DATA --problem NAME --by block",
    "calibrate, tested": "calibrate DATA --problem NAME --test DATA",
    "diagnose": "diagnose DATA --problem NAME",
    "diagnose by pose": "diagnose DATA --problem NAME --by pose",
    "diagnose by block": "diagnose DATA --problem NAME --by block",
    "diagnose in two": "diagnose DATA --problem NAME --folds 2",
    "plan": "plan-measurements --problem NAME --given DATA --count 10 --candidates 300",
    "compensate": "compensate DATA --problem NAME",
    "recheck": "recheck DATA --problem NAME",
}


def ask(server: CommandServer, words: str, folder: Path, **stands_for: str) -> str:
    """What is wrong with the answer; empty where it is one of those that may be."""
    folder.mkdir()
    answer = server.call([stands_for.get(word, word) for word in shlex.split(words)], folder, cpu=120, seconds=600)
    found = [fault for fault in answer.defects(folder) if "processor time" not in fault]
    if answer.code == 0 and "--out" in answer.words and not any((folder / "out").iterdir()):
        found.append("nothing was written")
    return "".join(f"{' '.join(answer.words)}: {fault}: {answer.err[:300]}\n" for fault in found)


def posture_of(name: str) -> str:
    joints = po.load_problem(name).robot.joints
    middles = [(j.lower + j.upper) / 2 if math.isfinite(j.lower + j.upper) else 0.0 for j in joints]
    return ", ".join(
        f"{m + 0.1} {j.unit}" if j.unit == "rad" else f"{m} m" for j, m in zip(joints, middles, strict=True)
    )


def check_problem(server: CommandServer, name: str, asked: dict[str, str], folder: Path) -> None:
    posture = posture_of(name)
    wrong = [ask(server, words, folder / what, NAME=name, POSTURE=posture) for what, words in asked.items()]
    assert not any(wrong), "".join(wrong)


@pytest.mark.parametrize("name", conformance(builtin_names(), OF_EACH_KIND))
def test_a_shipped_problem_is_answered(name: str, server: CommandServer, tmp_path: Path) -> None:
    check_problem(server, name, QUICK, tmp_path)


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", builtin_names())
def test_a_shipped_problem_is_searched(name: str, server: CommandServer, tmp_path: Path) -> None:
    check_problem(server, name, SLOW, tmp_path)


def check_data(server: CommandServer, file: str, folder: Path, further: str, whats: Iterable[str] = OF_DATA) -> None:
    data = str(PROBLEMS / file)
    asked = [(name, what) for name in MEASURED[file] for what in whats]
    wrong = [
        ask(server, f"{OF_DATA[what]} --out out --json {further}", folder / f"{name} {what}", NAME=name, DATA=data)
        for name, what in asked
    ]
    assert not any(wrong), "".join(wrong)


@pytest.mark.parametrize("file", ["planar_2r_measured.csv"])
def test_shipped_data_are_answered(file: str, server: CommandServer, tmp_path: Path) -> None:
    check_data(server, file, tmp_path, "--no-plots", ("diagnose by block", "compensate", "recheck"))


@pytest.mark.exhaustive
@pytest.mark.parametrize("file", MEASURED)
def test_shipped_data_are_answered_by_every_command(file: str, server: CommandServer, tmp_path: Path) -> None:
    check_data(server, file, tmp_path, "--no-plots")


def test_every_shipped_file_is_asked_about() -> None:
    there = {path.name for path in PROBLEMS.iterdir() if path.suffix == ".csv"}
    assert there == {*MEASURED, *READ}
    documents = "".join(path.read_text(encoding="utf-8") for path in PROBLEMS.glob("*.yaml"))
    assert not [name for name in READ if name not in documents]
