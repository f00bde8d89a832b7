"""Calibrate, diagnose, compensate, and drive an arm there that shares no code with the package."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import posture_opt as po
from tests.helpers.command_line import invoke
from tests.helpers.variants import conformance
from tests.hidden.mechanics import walk
from tests.hidden.true_arm import FIRST, PAYLOAD, TrueArm

TARGETS = 40
ODDS = 1e-4  # on either side: with four tests a false alarm in a thousand states of the code
ESTIMATED = 0.2  # of the scatter, which the data tell from 15 postures visited 3 times: 3 σ of their chi-square


@dataclass(frozen=True)
class Learnt:
    """A true arm and the extended problem that its measurements led to, as a file."""

    true: TrueArm
    path: Path
    wanted: np.ndarray  # (N, n) postures of the drawn arm
    p: np.ndarray  # (N, 3) where these would be
    R: np.ndarray


@pytest.fixture(scope="module", params=conformance(["ur10", "seven"], ["ur10"]))
def learnt(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Learnt:
    true, folder = TrueArm.drawn(request.param, 5), tmp_path_factory.mktemp(request.param)
    problem = po.load_problem(true.write(folder, 6))
    diagnosis = po.diagnose(problem, po.read_measurements(folder / "data.csv", problem))
    found = {(e.kind, e.target) for e in diagnosis.effects}
    assert {(e.kind, e.target) for e in true.effects} <= found
    for name, content in po.extended_problem(problem, diagnosis).files("extended").items():
        (folder / name).write_bytes(content)
    wanted = true.postures(TARGETS, 7)
    drawn = walk(true.site.arm, wanted)
    return Learnt(true, folder / "extended.yaml", wanted, drawn.p, drawn.R_link[:, -1])


@pytest.mark.long
@pytest.mark.parametrize("oriented", [True, False], ids=["pose", "position"])
def test_the_true_arm_misses_its_targets_by_what_is_said_to_be_left(
    learnt: Learnt, oriented: bool, tmp_path: Path
) -> None:
    """The commands of the file, driven one after another, end where the report says: no worse and not much better."""
    targets = write_targets(learnt, tmp_path, with_place=not oriented)
    answer = invoke("compensate", targets, "--problem", learnt.path, "--out", tmp_path / "out", "--no-plots")
    assert answer.exit_code == 0, answer.output
    rows = list(csv.DictReader((tmp_path / "out" / "compensated.csv").read_text().splitlines()))
    q = np.radians([[float(row[f"{name} [deg]"]) for name in learnt.true.site.arm.joints] for row in rows])
    off, left = (np.array([float(row[f"{key} [mm]"]) for row in rows]) / 1e3 for key in ("off", "left"))
    before, after = (np.linalg.norm(learnt.true.replay(k)[0] - learnt.p, axis=1) for k in (learnt.wanted, q))
    assert rms(before) > 0.5e-3
    assert rms(off) == pytest.approx(rms(before), rel=0.05)
    assert rms(after) < 0.03 * rms(before)
    assert 0.5 < rms(after) / rms(left) < 1.7
    low, high = np.quantile(drawn_errors(learnt.path, q), [ODDS, 1 - ODDS])
    assert (1 - ESTIMATED) * low < rms(after) < (1 + ESTIMATED) * high
    if oriented:
        R = learnt.true.replay(q)[1]
        angle = np.arccos(np.clip((np.einsum("nij,nij->n", R, learnt.R) - 1) / 2, -1, 1))
        expected = po.compensate(po.load_problem(learnt.path), targets).after.rms_turned
        assert 0.5 < rms(angle) / rms(expected) < 1.7


def write_targets(learnt: Learnt, folder: Path, *, with_place: bool) -> Path:
    """TARGETS.csv: postures of the drawn arm, and where they would be, or these alone."""
    arm, path = learnt.true.site.arm, folder / "targets.csv"
    heads = [f"{name} [deg]" for name in arm.joints] + ["payload [kg]", f"{FIRST[arm.name]}.approach"]
    columns: list[Any] = [*np.degrees(learnt.wanted).T, [PAYLOAD] * TARGETS, [1, *[""] * (TARGETS - 1)]]
    if with_place:
        heads += ["x [mm]", "y [mm]", "z [mm]"]
        columns += [*(1e3 * learnt.p).T]
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(heads)
        writer.writerows(zip(*columns, strict=True))
    return path


def drawn_errors(path: Path, q: np.ndarray, count: int = 20_000) -> np.ndarray:
    """(count,) RMS distances over all rows that arms have which differ as the file's covariance says.

    One draw of the constant errors is shared by all rows, scatter is drawn for each: errors of one arm at 40 places
    are far from independent, and this is what their mean square is spread like.
    """
    problem = po.load_problem(path)
    arm, rng = problem.arm, np.random.default_rng(0)
    sides = np.sign(np.diff(q, axis=0, prepend=q[:1] - 1.0))
    sources, rows = problem.sources, []
    for posture, side in zip(q, sides, strict=True):
        inputs = type(arm.inputs)(PAYLOAD, list(side), [1.0] * len(side), 0.0, 0.0, arm.robot.joint_names)
        here = arm.under(inputs)
        values = list(map(float, posture))
        twists = here.twists(sources.names, values, here.reach(values).walk)
        rows.append(np.array([shift for shift, _ in twists], dtype=float).T)
    J = np.concatenate(rows)
    squared = np.zeros(count)
    shared = weights(J @ sources.constant @ J.T)
    each = np.concatenate([weights(row @ sources.scatter @ row.T) for row in rows])
    for part in (shared, each):
        for weight in part[part > 1e-6 * max(shared.max(), each.max())]:
            squared += weight * rng.standard_normal(count) ** 2
    return np.sqrt(squared / len(q))


def weights(covariance: np.ndarray) -> np.ndarray:
    """The variances of the independent normals whose squares add up to the squared length."""
    return np.clip(np.linalg.eigvalsh(covariance), 0, None)


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
