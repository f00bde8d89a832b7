"""Diagnosis of many rows: memory stays within bounds."""

from __future__ import annotations

import subprocess
import sys

import pytest

SCRIPT = """
import resource
import numpy as np
import posture_opt as po
problem = po.load_problem("insert_planar_2r_measured")
rng = np.random.default_rng(0)
q = rng.uniform(-2.5, 2.5, (4000, 2))
s = np.cumsum(q + np.array([1e-3, -2e-3]) + 4e-4 * np.sin(q), axis=1)
p = np.stack([np.cos(s).sum(axis=1), np.sin(s).sum(axis=1)], axis=1) + rng.normal(0, 5e-5, (4000, 2))
names = [f"{name} [rad]" for name in problem.robot.joint_names]
table = dict(zip([*names, "x [m]", "y [m]"], [*q.T, *p.T]))
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
found = po.diagnose(problem, po.read_measurements(table, problem), plan=False)
print(found.verdict, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
"""


@pytest.mark.large
def test_memory_of_some_thousand_rows_is_bounded() -> None:
    done = subprocess.run([sys.executable, "-c", SCRIPT], capture_output=True, text=True, check=True)
    verdict, kilobytes = done.stdout.split()[-2:]
    assert verdict in ("effects_found", "unexplained")
    assert int(kilobytes) < 300_000
