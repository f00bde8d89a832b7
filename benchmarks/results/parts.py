"""Running a part of the measurements in a process of its own."""

from __future__ import annotations

import importlib
import json
import os
import subprocess
import sys
import time
from dataclasses import dataclass

from benchmarks.results.section import Section

BEGIN = "== sections =="  # what a library prints goes before it


@dataclass(frozen=True)
class Outcome:
    """The sections of a part, or why there are none."""

    part: str
    sections: tuple[Section, ...]
    seconds: float
    reason: str = ""


def measured(part: str, quick: bool) -> str:
    """The sections of a part as JSON, measured in this process."""
    module = importlib.import_module(f"benchmarks.results.{part}_part")
    return json.dumps([section.to_json() for section in module.measure(quick)])


def run(part: str, quick: bool, limit: float) -> Outcome:
    """The same in another process, of one thread as every way is, given up after ``limit`` seconds."""
    command = [sys.executable, "-m", "benchmarks.results", "--part", part, *(["--quick"] if quick else [])]
    threads = {f"{name}_NUM_THREADS": "1" for name in ("OMP", "OPENBLAS", "MKL")}
    began = time.perf_counter()
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, timeout=limit, check=False, env={**os.environ, **threads}
        )
    except subprocess.TimeoutExpired:
        return Outcome(part, (), limit, f"given up after {limit:.0f} s")
    seconds = time.perf_counter() - began
    if done.returncode or BEGIN not in done.stdout:
        said = (done.stderr.strip() or "no message").splitlines()[-1]
        return Outcome(part, (), seconds, f"ended with code {done.returncode}: {said}")
    sections = json.loads(done.stdout.split(BEGIN)[1])
    return Outcome(part, tuple(map(Section.from_json, sections)), seconds)
