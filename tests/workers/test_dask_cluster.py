"""A real Dask scheduler with worker processes: the bytes of one process, one worker killed in mid-run."""

from __future__ import annotations

import json
import os
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import posture_opt as po
from posture_opt.workers import opened
from posture_opt.workers.dask_cluster import scheduled
from tests.helpers.command_line import invoke
from tests.workers.parts import deadly, failing, squared

pytestmark = pytest.mark.filterwarnings("default")  # Dask's own, of sockets that a killed worker leaves open
GRID: dict[str, Any] = {"counts": (9, 9), "low": (-0.4, -0.4, -0.08), "high": (0.4, 0.4, -0.08)}


@pytest.fixture(scope="module")
def cluster() -> Iterator[Any]:
    distributed = pytest.importorskip("distributed", reason="the extra cluster is not installed")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, silence_logs=50
    ) as found:
        yield found


@pytest.fixture(scope="module")
def client(cluster: Any) -> Iterator[Any]:
    with cluster.get_client() as found:
        yield found


def plain(document: Any) -> str:
    return re.sub(r'"seconds": [^,}]*', "", json.dumps(document))


def test_parts_and_their_errors(client: Any) -> None:
    pool = opened(executor=client)
    assert pool.in_order(squared, 3, range(20)) == [[3 * k * k] for k in range(20)]
    with pytest.raises(ValueError, match="two is no number"):
        pool.in_order(failing, None, range(5))


@pytest.mark.interrupts
def test_a_worker_killed_over_a_part_is_survived(client: Any, tmp_path: Path) -> None:
    assert opened(executor=client).in_order(deadly, tmp_path / "killed", range(8)) == [2 * k for k in range(8)]
    assert (tmp_path / "killed").exists()


@pytest.mark.interrupts
def test_a_map_is_that_of_one_process_though_a_worker_is_killed(client: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    problem = po.load_problem("insert_scara")
    alone = po.map_targets(problem, **GRID)
    pids = list(client.run(os.getpid).values())

    def kill(done: int, total: int) -> None:
        if pids and done > total // 4:
            os.kill(pids.pop(), signal.SIGKILL)

    shared = po.map_targets(problem, executor=client, progress=kill, **GRID)
    assert len(pids) < 2
    assert plain(shared.to_json()) == plain(alone.to_json())


@pytest.mark.conformance  # always: a map, on the command line
def test_batch_and_plan_are_those_of_one_process(client: Any) -> None:
    problems = {name: po.load_problem(name) for name in ("insert_planar_2r", "insert_planar_2r_fixed_hole")}
    alone, shared = (po.select_postures(problems, executor=executor) for executor in (None, client))
    assert plain(shared.to_json()) == plain(alone.to_json())
    measured = po.load_problem("insert_planar_2r_measured")
    plans = [po.plan_measurements(measured, 10, candidates=200, executor=executor).q for executor in (None, client)]
    np.testing.assert_array_equal(*plans)


def test_the_command_takes_the_address_of_a_scheduler(client: Any, cluster: Any) -> None:
    words = ["map", "--problem", "insert_scara", "--grid", "6x6", "--json"]
    alone, shared = invoke(*words), invoke(*words, "--scheduler", cluster.scheduler_address)
    assert shared.exit_code == alone.exit_code == 0, shared.stderr
    assert plain(json.loads(shared.stdout)) == plain(json.loads(alone.stdout))


def test_a_worker_of_another_version_is_refused(client: Any, cluster: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("posture_opt.workers.dask_cluster.__version__", "99")
    with pytest.raises(po.errors.InputError, match="here is 99 – install the same version"):
        scheduled(cluster.scheduler_address)


@pytest.mark.parametrize(
    ("address", "told"),
    [
        ("bogus", "no address of a scheduler – write tcp://HOST:PORT"),
        ("tcp://127.0.0.1:99999", "no address of a scheduler"),
    ],
)
def test_an_address_that_is_none(address: str, told: str) -> None:
    pytest.importorskip("distributed", reason="the extra cluster is not installed")
    result = invoke("map", "--problem", "insert_scara", "--grid", "3x3", "--scheduler", address)
    assert result.exit_code == 2
    assert told in result.stderr


@pytest.mark.long
def test_nobody_there_is_told_at_once() -> None:
    pytest.importorskip("distributed", reason="the extra cluster is not installed")
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        address = f"tcp://127.0.0.1:{taken.getsockname()[1]}"
    began = time.monotonic()
    result = invoke("map", "--problem", "insert_scara", "--grid", "3x3", "--scheduler", address)
    assert time.monotonic() - began < 5
    assert result.exit_code == 2
    assert "no scheduler answers (connection refused) – start one" in result.stderr


@pytest.mark.long
def test_without_dask_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    result = invoke("map", "--problem", "insert_scara", "--grid", "3x3", "--scheduler", "local")
    assert result.exit_code == 2
    assert "pip install 'posture_opt[cluster]'" in result.stderr


LOCAL = """
import os, signal, sys
import posture_opt.workers.dask_cluster as cluster
from posture_opt.errors import InputError
from tests.workers.parts import squared

if __name__ == "__main__":
    with cluster.scheduled("local") as pool:
        assert pool.in_order(squared, 3, range(4)) == [[3 * k * k] for k in range(4)]
    import distributed
    class Killed(distributed.LocalCluster):
        def __init__(self, **given):
            raise RuntimeError("Nanny failed to start.")
    distributed.LocalCluster = Killed
    try:
        cluster.scheduled("local")
    except InputError as error:
        print(error)
"""


@pytest.mark.interrupts
def test_local_workers_leave_nothing_behind_and_say_that_they_did_not_start(tmp_path: Path) -> None:
    pytest.importorskip("distributed", reason="the extra cluster is not installed")
    scratch, script = tmp_path / "scratch", tmp_path / "run.py"
    scratch.mkdir()
    script.write_text(LOCAL)
    path = os.pathsep.join([str(Path(po.__file__).parents[1]), os.environ.get("PYTHONPATH", "")])
    env = {**os.environ, "TMPDIR": str(scratch), "PYTHONPATH": path}
    done = subprocess.run([sys.executable, str(script)], env=env, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("--scheduler: the workers did not start (RuntimeError) – start it again with fewer")
    assert [*scratch.iterdir()] == []
