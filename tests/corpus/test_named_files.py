"""Wherever a file can be named, what is no file, or no file's name, is refused: at once, and by its name and key."""

from __future__ import annotations

import json
import os
import shlex
from pathlib import Path

import pytest

from tests.helpers.command_server import CommandServer

SECONDS = 20  # a pipe without a writer would be waited for, a device without an end read
PLACES = {
    # a place where a file is named -> words of the command line, and what the problem file there says of it
    "--problem": ("--problem NAME", ""),
    "--robot": ("--task insert --robot NAME", ""),
    "robot of uncertainty": ('uncertainty --robot NAME --posture "0 deg"', ""),
    "compare": ("compare insert_planar_2r NAME", ""),
    "new": ("new NAME", ""),
    "map": ("map --problem NAME", ""),
    "calibrate": ("calibrate NAME --problem insert_planar_2r_measured", ""),
    "of a robot": ("diagnose NAME --robot planar_2r", ""),
    "--test": ("diagnose DATA --problem insert_planar_2r_measured --test NAME", ""),
    "--given": ("plan-measurements --problem insert_planar_2r_measured --count 5 --given NAME", ""),
    "compensate": ("compensate NAME --problem insert_planar_2r", ""),
    "recheck": ("recheck NAME --problem insert_planar_2r_calibrated", ""),
    "robot.file": ("--problem HERE", "robot: {kind: urdf, file: NAME}\ntask: {kind: insert}"),
    "uncertainty.covariance": ("--problem HERE", "robot: {kind: preset, name: scara}\nuncertainty: {covariance: NAME}"),
    "effects[0].covariance": (
        "--problem HERE",
        "robot: {kind: preset, name: scara}\neffects: [{kind: joint_scale, joint: joint1, covariance: NAME}]",
    ),
    "task.path": ("--problem HERE", "robot: {kind: preset, name: scara}\ntask: {kind: trace, path: NAME}"),
}
NAMES = {
    "a pipe": "./pipe.ENDING",
    "a home of nobody": "~nosuchuser/f.ENDING",
    "nothing": "./nothing.ENDING",
    "a device": "/dev/zero",
    "a folder": "./folder.ENDING",
    "a file of no size": "/proc/self/environ",
    "a long name": "./" + "n" * 300 + ".ENDING",
    "a name in Latin-1": "./caf\udce9.ENDING",
}
ALL_NAMES = ("--problem", "calibrate", "uncertainty.covariance")
"""Places where each name is tried; elsewhere the first three show that the place asks."""
ENDINGS = {"--robot": "urdf", "robot of uncertainty": "urdf", "new": "urdf", "robot.file": "urdf"}
DATA = Path(__file__).parents[2] / "problems" / "planar_2r_measured.csv"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("files") / "run"
    for ending in ("csv", "urdf", "yaml"):
        (folder / f"folder.{ending}").mkdir(parents=True)
        os.mkfifo(folder / f"pipe.{ending}")
        for name in ("café", "\udce9"):
            (folder / f"{name}.{ending}").write_bytes(b"")
    return folder


def ending_of(place: str) -> str:
    written = PLACES[place][1] or PLACES[place][0]
    return ENDINGS.get(place) or ("yaml" if "--problem NAME" in written or place == "compare" else "csv")


@pytest.mark.parametrize("place", PLACES)
def test_what_is_no_file_is_refused(place: str, server: CommandServer, folder: Path) -> None:
    words, written = PLACES[place]
    line = written[: written.find("NAME")].count("\n") + 1
    wrong = []
    for kind, pattern in list(NAMES.items())[: None if place in ALL_NAMES else 3]:
        name = pattern.replace("ENDING", ending_of(place))
        if written and kind == "a name in Latin-1":
            continue  # a problem file is UTF-8
        (folder / "here.yaml").write_text(written.replace("NAME", json.dumps(name)), encoding="utf-8")
        stands_for = {"NAME": name, "HERE": "here.yaml", "DATA": DATA}
        answer = server.call([stands_for.get(word, word) for word in shlex.split(words)], folder, seconds=SECONDS)
        found = [*answer.defects(folder), f"exit code {answer.code}"]
        if written and f"here.yaml:{line}: {place}: " not in answer.err and name not in answer.err:
            found.append("the key is not named")
        wrong += [f"{kind}: {fault}: {answer.err[:300]}" for fault in found if fault != "exit code 2"]
    assert not wrong, "\n".join(wrong)
