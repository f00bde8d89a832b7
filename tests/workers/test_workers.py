"""Whoever works, the results are the same; who is lost is replaced, and nobody outlives the parent."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

import posture_opt as po
from posture_opt.workers import Serial, Workers, opened
from posture_opt.workers.processes import ProcessWorkers
from tests.helpers.fresh import ROOT
from tests.workers.parts import always_deadly, deadly, failing, slow


def alive(pid: int) -> bool:
    """Whether a process is there and no zombie."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def until(condition: Any, seconds: float) -> bool:
    end = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > end:
            return False
        time.sleep(0.02)
    return True


@pytest.fixture(params=["serial", "processes", "threads", "pool"])
def workers(request: pytest.FixtureRequest) -> Iterator[Workers]:
    made: dict[str, Any] = {"threads": ThreadPoolExecutor, "pool": ProcessPoolExecutor}
    if request.param in made:
        with made[request.param](2) as pool, opened(executor=pool) as found:
            yield found
    else:
        with opened(1 if request.param == "serial" else 2) as found:
            yield found


def test_an_error_of_a_part_is_that_of_the_call(workers: Workers) -> None:
    with pytest.raises(ValueError, match="two is no number"):
        workers.in_order(failing, None, range(5))
    assert workers.in_order(failing, None, [1]) == [1]


def test_a_lost_worker_is_replaced_and_its_part_done_again(tmp_path: Path) -> None:
    with ProcessWorkers(2) as workers:
        assert workers.in_order(deadly, tmp_path / "killed", range(8)) == [2 * k for k in range(8)]
    assert (tmp_path / "killed").exists()


def test_a_part_that_ends_every_worker_is_told() -> None:
    with ProcessWorkers(2) as workers, pytest.raises(po.errors.InputError, match="3 worker processes were ended"):
        workers.in_order(always_deadly, None, range(4))


def test_a_pool_that_broke_is_told() -> None:
    with ProcessPoolExecutor(1) as pool, pytest.raises(po.errors.InputError, match="the executor lost its workers"):
        opened(executor=pool).in_order(always_deadly, None, range(4))


def test_no_worker_is_left_when_work_is_given_up() -> None:
    with ProcessWorkers(2) as workers:
        results = workers.run(slow, 0.05, range(50))
        pids = {next(results)[1] for _ in range(6)}
        del results
    assert pids
    assert until(lambda: not any(map(alive, pids)), 2)


PARENT = """
import sys, time
from posture_opt.workers.processes import ProcessWorkers
from tests.workers.parts import slow
if __name__ == "__main__":
    with ProcessWorkers(2) as workers:
        for _, pid in workers.run(slow, 0.2, range(1000)):
            print(pid, flush=True)
"""


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="processes are looked up in /proc")
@pytest.mark.parametrize(
    "number",
    [signal.SIGKILL, *(pytest.param(n, marks=pytest.mark.interrupts) for n in (signal.SIGINT, signal.SIGTERM))],
)
def test_workers_do_not_outlive_their_parent(number: signal.Signals) -> None:
    command = [sys.executable, "-c", PARENT]
    with subprocess.Popen(
        command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, start_new_session=True
    ) as parent:
        assert parent.stdout is not None
        pids = {int(parent.stdout.readline()) for _ in range(4)}
        # As a terminal does it: to the whole group.
        (os.killpg if number == signal.SIGINT else os.kill)(parent.pid, number)
        parent.wait(10)
    assert until(lambda: not any(map(alive, pids)), 2)


GRID: dict[str, Any] = {"counts": (9, 9), "low": (-0.4, -0.4, -0.08), "high": (0.4, 0.4, -0.08)}


def test_a_map_is_the_same_whoever_makes_it() -> None:
    problem = po.load_problem("insert_scara")
    alone, *others = (
        po.map_targets(problem, executor=executor, **GRID).to_json() | {"seconds": 0.0}
        for executor in (Serial(), ProcessWorkers(3))
    )
    for other in others:
        assert other == alone
