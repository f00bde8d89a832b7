"""An interrupt from the keyboard ends a map with workers: soon, whole, and with everything that it started."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.helpers.fresh import ROOT

SOON = 2.0  # s


def children(pid: int) -> list[int]:
    try:
        return [int(word) for word in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]
    except OSError:
        return []


def alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="processes are looked up in /proc")
@pytest.mark.parametrize("wait", [0.4, *(pytest.param(wait, marks=pytest.mark.interrupts) for wait in (0.0, 1.1))])
def test_an_interrupt_ends_a_map_and_its_workers(tmp_path: Path, wait: float) -> None:
    out = tmp_path / "out"
    words = ["map", "--problem", "insert_ur10", "--grid", "90x90", "--workers", "2", "--out", str(out)]
    command = [sys.executable, "-m", "posture_opt", *words]
    with subprocess.Popen(
        command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    ) as run:
        while len(started := children(run.pid)) < 2:
            assert run.poll() is None, run.communicate()
            time.sleep(0.02)
        time.sleep(wait)
        os.killpg(run.pid, signal.SIGINT)
        began = time.monotonic()
        told, error = run.communicate(timeout=30)
        seconds = time.monotonic() - began
    assert run.returncode == 130, error
    assert seconds < SOON
    assert told == ""
    assert error.strip() == "interrupted"
    assert not any(map(alive, started))
    assert not out.exists()
    assert not list(tmp_path.iterdir())
