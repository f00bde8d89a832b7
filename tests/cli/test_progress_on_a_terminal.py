"""Whole commands under a pseudo-terminal: the line goes on until the answer is there, and is gone then."""

from __future__ import annotations

import os
import re
import select
import subprocess
import sys
import time
from dataclasses import dataclass
from itertools import pairwise

import pytest

from tests.helpers.fresh import ROOT

pty = pytest.importorskip("pty", reason="pseudo-terminals belong to Unix")
SILENT = 2.0
"""s without a change of the line that a person waits for."""
LATE = 2.5
"""s more, for a machine that does other things beside the tests."""


@dataclass(frozen=True)
class Told:
    """What a command wrote to its terminal, and when [s]; ``end`` is when it was done."""

    texts: tuple[str, ...]
    times: tuple[float, ...]
    end: float

    @property
    def gaps(self) -> list[float]:
        marks = [*self.times, self.end]
        return [b - a for a, b in pairwise(marks)]


def run(*words: str) -> Told:
    master, slave = pty.openpty()
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "COLUMNS": "100"}
    command = [sys.executable, "-m", "posture_opt", *words]
    begun = time.monotonic()
    process = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.DEVNULL, stderr=slave, env=environment)
    os.close(slave)
    texts, times = [], []
    try:
        while process.poll() is None or select.select([master], [], [], 0)[0]:
            if select.select([master], [], [], 0.05)[0]:
                try:
                    texts.append(os.read(master, 65536).decode(errors="replace"))
                except OSError:  # the other end is closed
                    break
                times.append(time.monotonic() - begun)
        assert process.wait(timeout=60) == 0
    finally:
        process.kill()
        os.close(master)
    return Told(tuple(texts), tuple(times), time.monotonic() - begun)


@pytest.mark.long
def test_no_silence_until_the_answer_is_there() -> None:
    told = run("--problem", "weld_ur10")
    assert told.times, f"nothing was shown in {told.end:.1f} s"
    assert max(told.gaps) < SILENT + LATE, [f"{t:.1f}" for t in told.times]
    text = "".join(told.texts)
    assert "searching: " in text
    assert re.search(r"█{30} (\d+)/\1\b", text), "a bar is full before it goes"
    assert re.search(r"\r +\r$", text), "the line is left as it was found"


def test_nothing_at_all_where_nobody_looks() -> None:
    assert run("--problem", "insert_scara_tray", "--quiet").texts == ()
