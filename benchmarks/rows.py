"""What many rows cost: ``python -m benchmarks.rows --rows 150 1000 10000 --arm ur10 --task diagnose``.

Files of the simulator of the hidden tests, which shares no code with the package, through the command line: processor
seconds of the whole command and its peak memory.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from benchmarks.machine import machine_line
from benchmarks.tables import table
from tests.hidden.arms import ARMS
from tests.hidden.designs import Plan, draw_session
from tests.hidden.draw import geometry, place
from tests.hidden.effects import FORMS, Effect, Perturbation, Site
from tests.hidden.families import Setting
from tests.hidden.files import document
from tests.hidden.mechanics import Array, walk
from tests.hidden.true_arm import quaternions

SEED = 77
SIGMA, TURN = 0.05e-3, 0.1e-3  # m and rad of the instrument
ELBOW = {"planar": "joint2", "ur10": "joint3", "seven": "a4"}
FIRST = {"planar": "joint1", "ur10": "joint1", "seven": "a1"}
HEADERS = ("task", "arm", "data", "rows", "CPU s", "MB", "verdict")
FORMATS = ("", "", "", "d", ".1f", ".0f", "")
SIZES, TASKS = (150, 1000, 10_000), ("calibrate", "diagnose")


@dataclass(frozen=True)
class Cost:
    """What one command took: processor seconds [s] and peak memory [MB], and how it ended."""

    task: str
    arm: str
    data: str
    rows: int
    seconds: float
    megabytes: float
    verdict: str

    @property
    def row(self) -> tuple[str, str, str, int, float, float, str]:
        return self.task, self.arm, self.data, self.rows, self.seconds, self.megabytes, self.verdict


def write_files(folder: Path, kind: str, rows: int, turned: bool, clean: bool = False) -> None:
    """problem.yaml and data.csv of an arm with errors of 0.4 mm and mrad, a soft elbow and backlash in its first joint.

    Every tenth posture comes back twice, as an engineer would do it; ``turned`` adds orientations. ``clean`` leaves
    soft elbow and backlash out: residuals are independent then, and another branch of the check of the spread is run.
    """
    rng = np.random.default_rng(SEED)
    arm = place(rng, ARMS[kind]())
    free = kind != "planar"
    again = rows // 15
    plan = Plan(rows=rows, repeated=again, visits=3, payloads=(0.0,) if kind == "planar" else (0.0, 10.0))
    session = draw_session(rng, arm, replace(plan, sides=True, logged=True))
    site = Site(arm, session, geometry(rng, arm, Setting(kind)))
    effects = (
        Effect("joint_compliance", ELBOW[kind], {"c": 4e-6}),
        Effect("backlash", FIRST[kind], {"b": 2e-4}),
    )
    p, R = _poses(site, () if clean else effects)
    p = p + rng.normal(0, SIGMA, p.shape)
    (folder / "problem.yaml").write_text(yaml.safe_dump(_problem(arm, free, turned), sort_keys=False))
    if arm.urdf:
        (folder / "arm.urdf").write_text(arm.urdf)
    heads = [f"{name} [deg]" for name in arm.joints] + [f"{'xyz'[i]} [mm]" for i in arm.measured]
    columns = [*np.degrees(session.q).T, *(1e3 * p[:, list(arm.measured)]).T]
    formats = ["%.6f"] * arm.n + ["%.4f"] * len(arm.measured)
    if turned:
        heads += ["qw", "qx", "qy", "qz"]
        columns += [*quaternions(R, rng.normal(0, TURN, p.shape)).T]
        formats += ["%.8f"] * 4
    heads += ["pose", *(f"{name}.approach" for name in arm.joints), "temperature [degC]", "time [s]"]
    columns += [session.pose, *session.side.T, session.temperature, session.time]
    formats += ["%d"] * (1 + arm.n) + ["%.2f", "%.2f"]
    if session.payload.any():
        heads, columns, formats = [*heads, "payload [kg]"], [*columns, session.payload], [*formats, "%g"]
    np.savetxt(folder / "data.csv", np.column_stack(columns), formats, ",", header=",".join(heads), comments="")


def _poses(site: Site, effects: Iterable[Effect]) -> tuple[Array, Array]:
    out = Perturbation()
    for effect in effects:
        FORMS[effect.kind](site, effect, out)
    q = site.session.q.copy()
    for j, dq in out.dq.items():
        q[:, j] += dq
    reached = walk(site.arm, q, site.deviations)
    return reached.p, reached.R_link[:, -1]


def _problem(arm, free: bool, turned: bool) -> dict:  # type: ignore[no-untyped-def]
    from types import SimpleNamespace

    case = SimpleNamespace(nominal=arm, free=free, word=False, priors={}, truth={"sigma": SIGMA})
    found = document(case)  # type: ignore[arg-type]
    if turned:
        found["uncertainty"]["measurement"]["orientation"] = f"{TURN} rad"
    return found


def cost(task: str, kind: str, rows: int, turned: bool, *options: str, clean: bool = False) -> Cost:
    """One command on fresh files, cold."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_files(folder, kind, rows, turned, clean)
        command = [sys.executable, "-m", "posture_opt", task, str(folder / "data.csv"), "--quiet"]
        command += ["--problem", str(folder / "problem.yaml"), "--json", *options]
        seconds, megabytes, told = measured_run(command)
    effects = " ".join(f"{e['kind']}({e['target']})" for e in told.get("effects", ()))
    said = told.get("verdict", "done")
    measured = ("pose" if turned else "position") + ", clean" * clean
    return Cost(task, kind, measured, rows, seconds, megabytes, f"{said} {effects}".strip())


def measured_run(command: Sequence[str]) -> tuple[float, float, dict[str, Any]]:
    """Processor seconds and peak memory [MB] of a command, and the document that it writes; its message as verdict."""
    with tempfile.TemporaryFile() as out:
        process = subprocess.Popen(command, stdout=out, stderr=subprocess.PIPE)
        _, status, used = os.wait4(process.pid, 0)
        out.seek(0)
        if os.waitstatus_to_exitcode(status):
            told = {"verdict": process.stderr.read().decode()[-300:]}  # type: ignore[union-attr]
        else:
            told = json.load(out)
    return used.ru_utime + used.ru_stime, used.ru_maxrss / 1024, told


def costs(
    sizes: Iterable[int] = SIZES, arms: Iterable[str] = tuple(ELBOW), tasks: Iterable[str] = TASKS, clean: bool = False
) -> Iterable[Cost]:
    """Every task, arm, kind of data and number of rows, one by one."""
    for rows in sizes:
        for task in tasks:
            for kind in arms:
                for turned in (False, True)[: 1 + (kind != "planar")]:
                    yield cost(task, kind, rows, turned, clean=clean)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rows", type=int, nargs="+", default=SIZES)
    parser.add_argument("--arm", nargs="+", choices=tuple(ELBOW), default=tuple(ELBOW))
    parser.add_argument("--task", nargs="+", choices=TASKS, default=TASKS)
    parser.add_argument("--clean", action="store_true", help="an arm without hidden effects")
    options = parser.parse_args()
    found = []
    for one in costs(options.rows, options.arm, options.task, options.clean):
        print(*one.row, file=sys.stderr, flush=True)
        found.append(one.row)
    print(machine_line("numpy", "scipy"))
    print(table(HEADERS, found, FORMATS))


if __name__ == "__main__":
    main()
