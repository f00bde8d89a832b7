"""Rows without any noise, as a first simulation has them: what was put in is found, and nothing beside it."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

import posture_opt as po


def _rows(offset: float, seed: int) -> dict[str, np.ndarray]:
    """A planar arm of two links of 1 m, whose second joint is off by an offset [rad]."""
    first, second = np.random.default_rng(seed).uniform(-2.0, 2.0, (2, 30))
    both = first + second + offset
    x, y = np.cos(first) + np.cos(both), np.sin(first) + np.sin(both)
    return {"joint1 [rad]": first, "joint2 [rad]": second, "x [m]": x, "y [m]": y}


@pytest.mark.parametrize(("offset", "causes"), [(0.0, []), (1e-3, ["joint_offset"])])
def test_what_a_simulation_without_noise_holds_is_found_alone(offset: float, causes: list[str]) -> None:
    problem = po.load_problem("insert_planar_2r_measured")
    found = po.diagnose(problem, po.read_measurements(_rows(offset, 5), problem), plan=False)
    assert [finding.kind for finding in found.effects] == causes
    assert "1 nm" in found.report(full=True)
    if offset:
        (size,) = found.effects[0].estimate.values()
        assert size[0] == pytest.approx(offset, abs=1e-8)


def test_turned_orientations_stay_unit_quaternions() -> None:
    problem = po.load_problem("insert_planar_2r_measured")
    rows = _rows(0.0, 6)
    yaw = rows["joint1 [rad]"] + rows["joint2 [rad]"]
    half = {"qw": np.cos(yaw / 2), "qx": 0 * yaw, "qy": 0 * yaw, "qz": np.sin(yaw / 2)}
    found = po.diagnose(problem, po.read_measurements({**rows, "z [m]": 0 * yaw, **half}, problem), plan=False)
    assert not found.effects


# --- Diagnosis of many rows: memory stays within bounds ---------------------------------------------------------------

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
