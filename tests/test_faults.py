"""What the machine does to the program: memory that ends, clocks that go back; and the table of all such faults."""

from __future__ import annotations

import ast
import json
import os
import re
import signal
import subprocess
import sys
import time
import tomllib
from functools import cache
from pathlib import Path

import pytest

import posture_opt as po
from tests.conftest import SAMPLED
from tests.faults import ROOT, rows_of_the_page
from tests.helpers.command_line import invoke

posix = pytest.mark.skipif(os.name == "nt", reason="signals and limits of POSIX")


def marks_of(node: ast.AST) -> set[str]:
    """``pytest.mark.NAME`` anywhere in it."""
    return {
        found.attr
        for found in ast.walk(node)
        if isinstance(found, ast.Attribute) and isinstance(found.value, ast.Attribute) and found.value.attr == "mark"
    }


@cache
def marked_functions(file: str) -> dict[str, set[str]]:
    """The tests that pytest collects of a file, each with its marks and those of the file."""
    body = ast.parse((ROOT / file).read_text("utf-8")).body
    of_all = [node for node in body if isinstance(node, ast.Assign) and marks_of(node)]
    whole = set().union(*(marks_of(n) for n in of_all if getattr(n.targets[0], "id", "") == "pytestmark"))
    named = {getattr(node.targets[0], "id", ""): marks_of(node) for node in of_all}
    tests = [node for node in body if isinstance(node, ast.FunctionDef) and node.name.startswith("test_")]
    return {
        test.name: whole.union(*(marks_of(d) | named.get(getattr(d, "id", ""), set()) for d in test.decorator_list))
        for test in tests
    }


def test_every_row_of_the_page_names_tests_that_ci_runs() -> None:
    """None that is run for releases only, or as one of a sample; ``python -m tests.faults`` runs all."""
    rows = list(rows_of_the_page())
    assert len(rows) >= 22
    assert [what for what, tests in rows if not tests] == []
    config = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["tool"]["pytest"]["ini_options"]
    left_out = set(re.findall(r"\w+", config["addopts"].split("not (")[1])) - {"or"}
    taken = set(re.findall(r'pytest -m "([\w ]+)"', (ROOT / ".ci" / "run").read_text("utf-8"))[0].split(" or "))
    for _, tests in rows:
        for file, name in tests:
            assert Path(file).name.startswith("test_")
            assert name in marked_functions(file), f"{file}::{name} is not there"
            marks = marked_functions(file)[name] & left_out
            assert not marks or marks & (taken - {*SAMPLED}), f"no run of CI has {file}::{name}"


def run(script: str, *words: str, **environment: str) -> subprocess.CompletedProcess[str]:
    known = {**os.environ, "PYTHONPATH": str(ROOT), "OPENBLAS_NUM_THREADS": "1", **environment}
    return subprocess.run(
        [sys.executable, "-c", script, *words], capture_output=True, text=True, env=known, timeout=120, check=False
    )


def test_memory_that_does_not_suffice_is_exit_code_2(monkeypatch: pytest.MonkeyPatch) -> None:
    def short(*given: object, **named: object) -> None:
        raise MemoryError("Unable to allocate 7 GiB")

    monkeypatch.setattr(po, "propagate", short)
    result = invoke("uncertainty", "--problem", "insert_planar_2r", "--posture", "0.1 rad, 0.2 rad")
    assert result.exit_code == 2
    assert result.stderr.startswith("error: memory does not suffice – take fewer --workers")


LIMITED = """
import resource, sys
import numpy as np
import posture_opt.calibration.calibrate, posture_opt.report.results.calibration_report
from posture_opt.cli.main import main
np.linalg.svd(np.eye(200) @ np.eye(200))
used = int(open("/proc/self/statm").read().split()[0]) * 4096
resource.setrlimit(resource.RLIMIT_AS, (used + int(sys.argv[1]), -1))
main(sys.argv[2:])
"""


@pytest.mark.interrupts
@pytest.mark.skipif(sys.platform != "linux", reason="addresses are limited, and counted, as Linux does it")
@pytest.mark.parametrize("room", [2_000_000, 12_000_000, 30_000_000])
def test_a_calibration_that_gets_no_memory_says_so_and_leaves_nothing(room: int, tmp_path: Path) -> None:
    table, out = tmp_path / "d.csv", tmp_path / "out"
    lines = (ROOT / "problems" / "planar_2r_measured.csv").read_text("utf-8").splitlines()
    table.write_text("\n".join([lines[0], *lines[1:] * 400]))
    words = ["calibrate", str(table), "--problem", "insert_planar_2r_measured", "--no-plan", "--out", str(out)]
    found = run(LIMITED, str(room), *words)
    assert found.returncode in (1, 2), found.stderr  # 1 where OpenBLAS ends the process itself
    assert "Traceback" not in found.stderr
    assert "memory" in found.stderr.lower()
    assert not out.exists()


def test_a_clock_that_goes_back_changes_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    problem = po.load_problem("insert_planar_2r_fixed_hole")
    before = po.select_posture(problem).to_json()
    clock = iter(range(2_000_000_000, 0, -3600))
    monkeypatch.setattr(time, "time", lambda: float(next(clock)))
    after = po.select_posture(problem).to_json()
    for document in (before, after):
        document["solver"].pop("seconds")
    assert after == before


FORKED = """
import json, os, sys
import posture_opt as po
problem = po.load_problem("insert_planar_2r_fixed_hole")
def answer():
    return json.dumps(po.select_posture(problem).to_json()["posture"])
first, (read, write) = answer(), os.pipe()
if os.fork() == 0:
    os.write(write, answer().encode())
    os._exit(0)
assert os.read(read, 1000).decode() == first == answer()
assert os.wait()[1] == 0
"""


@pytest.mark.interrupts
@posix
def test_a_process_that_was_forked_after_a_solve_solves() -> None:
    found = run(FORKED)
    assert (found.returncode, found.stderr) == (0, "")


NANNY = """
from posture_opt.errors import InputError
from posture_opt.workers.dask_cluster import scheduled
if __name__ == "__main__":
    try:
        with scheduled("local", 2):
            print("begun")
    except InputError as error:
        print(error)
"""


@pytest.mark.interrupts
@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="processes are looked up in /proc")
def test_workers_of_dask_killed_while_they_start_are_told(tmp_path: Path) -> None:
    pytest.importorskip("distributed", reason="the extra cluster is not installed")
    script, scratch = tmp_path / "run.py", tmp_path / "scratch"
    scratch.mkdir()
    script.write_text(NANNY)
    known = {**os.environ, "PYTHONPATH": str(ROOT), "TMPDIR": str(scratch)}
    with subprocess.Popen(
        [sys.executable, str(script)], env=known, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        end = time.monotonic() + 60
        while process.poll() is None and time.monotonic() < end:
            for child in children(process.pid):
                if b"spawn_main" in command_of(child):
                    os.kill(child, signal.SIGKILL)
            time.sleep(0.01)
        process.kill()
        out, err = process.communicate()
    assert "the workers did not start" in out, err
    assert "Traceback" not in err
    assert [*scratch.iterdir()] == []


def children(pid: int) -> list[int]:
    """Of every thread: Dask starts its workers in one of its own."""
    try:
        lists = [path.read_text() for path in Path(f"/proc/{pid}/task").glob("*/children")]
    except OSError:
        return []
    return [int(one) for text in lists for one in text.split()]


def command_of(pid: int) -> bytes:
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes()
    except OSError:
        return b""


@pytest.mark.interrupts
def test_a_scheduler_that_is_killed_is_told(tmp_path: Path) -> None:
    pytest.importorskip("distributed", reason="the extra cluster is not installed")
    file = tmp_path / "scheduler.json"
    known = {**os.environ, "PYTHONPATH": str(ROOT)}
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "env": known, "cwd": tmp_path}
    dask = [sys.executable, "-m", "distributed.cli.dask_scheduler"]
    scheduler = subprocess.Popen(
        [*dask, "--port", "0", "--no-dashboard", "--scheduler-file", str(file), "--host", "127.0.0.1"], **quiet
    )
    worker = subprocess.Popen(
        [sys.executable, "-m", "distributed.cli.dask_worker", "--scheduler-file", str(file), "--no-nanny"], **quiet
    )
    try:
        address = scheduler_address(file)
        words = ["map", "--problem", "insert_scara", "--grid", "200x200", "--scheduler", address, "--out", "out"]
        with subprocess.Popen(
            [sys.executable, "-m", "posture_opt", *words], cwd=tmp_path, env=known, stderr=subprocess.PIPE, text=True
        ) as mapped:
            time.sleep(6)  # well within the map: it takes a minute
            scheduler.kill()
            _, err = mapped.communicate(timeout=90)
        assert mapped.returncode == 2, err
        assert "--scheduler: " in err
        assert "Traceback" not in err
        assert not (tmp_path / "out").exists()
    finally:
        for process in (worker, scheduler):
            process.kill()
            process.wait()


def scheduler_address(file: Path) -> str:
    end = time.monotonic() + 60
    while time.monotonic() < end:
        try:
            return str(json.loads(file.read_text())["address"])
        except (OSError, ValueError, KeyError):
            time.sleep(0.1)
    raise AssertionError("the scheduler did not start")
