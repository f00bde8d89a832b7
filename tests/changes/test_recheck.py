"""What changed on a calibrated arm: simulated by textbook products that share no code with the package."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import posture_opt as po
from tests.helpers.command_line import invoke
from tests.helpers.simulated_arm import SimulatedArm, shift, turn
from tests.helpers.variants import conformance

H, R = math.pi / 2, "revolute"
NOISE = 0.05e-3
TOOL = np.array([0.03, -0.02, 0.12])
TABLES: dict[str, tuple[str, tuple[tuple[Any, ...], ...]]] = {
    # maker's tables: name, type, theta, d, a, alpha
    "ur10": ("dh", (
        ("shoulder_pan", R, 0.0, 0.1273, 0.0, H), ("shoulder_lift", R, 0.0, 0.0, -0.612, 0.0),
        ("elbow", R, 0.0, 0.0, -0.5723, 0.0), ("wrist_1", R, 0.0, 0.163941, 0.0, H),
        ("wrist_2", R, 0.0, 0.1157, 0.0, -H), ("wrist_3", R, 0.0, 0.0922, 0.0, 0.0),
    )),
    "panda": ("mdh", (
        ("panda_joint1", R, 0.0, 0.333, 0.0, 0.0), ("panda_joint2", R, 0.0, 0.0, 0.0, -H),
        ("panda_joint3", R, 0.0, 0.316, 0.0, H), ("panda_joint4", R, 0.0, 0.0, 0.0825, H),
        ("panda_joint5", R, 0.0, 0.384, -0.0825, -H), ("panda_joint6", R, 0.0, 0.0, 0.0, H),
        ("panda_joint7", R, 0.0, 0.107, 0.088, H),
    )),
}  # fmt: skip
Truth = tuple[str, str]
KINDS = ("tool", "base", "zero", "link", "nothing")


@dataclass(frozen=True)
class Cell:
    """An arm as it was calibrated, its file, and the ten postures that its plan chose."""

    arm: SimulatedArm
    problem: po.Problem
    q: np.ndarray

    @property
    def names(self) -> list[str]:
        return [row[0] for row in self.arm.table]

    def measured(self, arm: SimulatedArm, rng: np.random.Generator) -> po.Measurements:
        points = arm.points(self.q) + rng.normal(0, NOISE, (len(self.q), 3))
        return po.read_measurements(self.table(points), self.problem)

    def table(self, points: np.ndarray) -> dict[str, Any]:
        joints = {f"{n} [rad]": c for n, c in zip(self.names, self.q.T, strict=True)}
        return joints | {f"{c} [m]": points[:, i] for i, c in enumerate("xyz")}

    def with_error(self, name: str, size: float) -> SimulatedArm:
        return replace(self.arm, errors={**self.arm.errors, name: self.arm.errors.get(name, 0.0) + size})

    def zeros(self) -> list[str]:
        """Zeros of which 0.2 mrad, or 0.2 mm, move the tool by 0.1 mm (RMS): less is lost in noise of 0.05 mm."""
        names = [f"{row[0]}.theta" for row in self.arm.table]
        return [name for name in names if self.motion(name) > 0.1e-3]

    def motion(self, name: str) -> float:
        moved = self.with_error(name, 0.2e-3).points(self.q) - self.arm.points(self.q)
        return float(np.sqrt(np.mean(np.sum(moved**2, axis=1))))

    def changed(self, what: str, rng: np.random.Generator) -> tuple[SimulatedArm, Truth]:
        u = rng.normal(size=3)
        u /= np.linalg.norm(u)
        size = rng.choice([-1, 1]) * 0.2e-3
        if what == "tool":
            return replace(self.arm, tool=self.arm.tool @ shift(*(0.3e-3 * u))), ("tool_frame", "tool")
        if what == "base":
            return replace(self.arm, base=shift(*(0.5e-3 * u)) @ self.arm.base), ("base_frame", "base")
        if what == "zero":
            name = str(rng.choice(self.zeros()))
            return self.with_error(name, size), ("joint_offset", name.partition(".")[0])
        if what == "link":
            lengths = [(f"{n}.{p}", v) for n, t, _, d, a, _ in self.arm.table for p, v in (("a", a), ("d", d)) if v]
            name = str(rng.choice([name for name, _ in lengths]))
            return self.with_error(name, size), ("link", name)
        return self.arm, ("", "")


@cache
def stated(name: str = "ur10") -> Cell:
    """An arm as its file says but for 0.02 mm and 0.02 mrad, which the file states."""
    kind, table = TABLES[name]
    rng = np.random.default_rng(3)
    sizes = {f"{row[0]}.{p}": 2e-5 for row in table for p in ("theta", "d", "a", "alpha")}
    arm = SimulatedArm(table, {n: rng.normal(0, s) for n, s in sizes.items()}, kind, tool=shift(*TOOL))
    units = {n: "mrad" if n.endswith(("theta", "alpha")) else "mm" for n in sizes}
    problem = po.problem_from_dict({
        "robot": {"kind": "preset", "name": name, "tool": {"xyz": [f"{1e3 * v} mm" for v in TOOL]}},
        "uncertainty": {
            "sigma": {n: f"0.02 {units[n]}" for n in sizes}, "measurement": {"position": f"{1e3 * NOISE} mm"},
        },
    })  # fmt: skip
    return Cell(arm, problem, po.plan_measurements(problem, 10, purpose="recheck", candidates=200).q)


@cache
def calibrated(name: str) -> Cell:
    """An arm with errors of 0.5 mm and 0.5 mrad in frames that are not known, calibrated from 60 postures."""
    kind, table = TABLES[name]
    rng = np.random.default_rng(3)
    errors = {f"{row[0]}.{p}": rng.normal(0, 0.5e-3) for row in table for p in ("theta", "d", "a", "alpha")}
    base, tool = shift(*rng.normal(0, 1e-3, 3)), shift(*(TOOL + rng.normal(0, 1e-3, 3)))
    arm = SimulatedArm(table, errors, kind, base, tool)
    nominal = po.problem_from_dict({
        "robot": {
            "kind": "preset", "name": name, "base": {"xyz": ["0 m"] * 3, "free": True},
            "tool": {"xyz": [f"{1e3 * v} mm" for v in TOOL], "free": True},
        },
        "uncertainty": {"measurement": {"position": f"{1e3 * NOISE} mm"}},
    })  # fmt: skip
    low, high = np.maximum(nominal.robot.lower, -math.pi), np.minimum(nominal.robot.upper, math.pi)
    first = Cell(arm, nominal, rng.uniform(low, high, (60, len(table))))
    found = po.calibrated_problem(nominal, po.calibrate(nominal, first.measured(arm, rng)))
    return Cell(arm, found, po.plan_measurements(found, 10, purpose="recheck", candidates=1000).q)


def is_named(found: po.Recheck, truth: Truth) -> bool:
    """Whether the verdict is the truth; a length that acts as what is named, in every posture, is the same thing."""
    if not truth[0]:
        return found.verdict == "unchanged"
    first = found.changes[0]
    same = (first.kind, first.target) == truth or truth[1] in first.possible.alike
    return found.verdict == "changed" and same and not found.shared


def is_in_headline(found: po.Recheck, truth: Truth) -> bool:
    """Whether the verdict is the truth, or says that it is this or one of those that share the headline."""
    either = (found.changes[0], *found.shared)
    said = any((c.kind, c.target) == truth or truth[1] in c.possible.alike for c in either)
    return is_named(found, truth) or (found.verdict == "changed" and said)


@pytest.mark.parametrize("what", conformance(KINDS, ["tool", "zero", "nothing"]))
def test_one_change_is_named_with_its_size(what: str) -> None:
    cell, rng = stated(), np.random.default_rng(5)
    arm, truth = cell.changed(what, rng)
    found = po.recheck(cell.problem, cell.measured(arm, rng))
    # This shift of the tool is across the last axis, whose zero shares the headline with it.
    assert (is_in_headline if what == "tool" else is_named)(found, truth), found.summary()
    assert found.after <= found.before
    total = sum(change.probability for change in found.changes) + found.unchanged
    assert total == pytest.approx(1.0)
    if what == "zero":
        value, std, unit = found.changes[0].values["theta"]
        assert unit == "rad"
        assert abs(abs(value) - 0.2e-3) < 3 * std < 0.1e-3


@pytest.mark.long
def test_changes_that_the_postures_cannot_tell_apart_share_the_headline() -> None:
    """1 mrad of the second wrist moves the tool as 0.21 mm of the length beside it, but for less than the noise."""
    cell, rng = stated(), np.random.default_rng(5)
    slipped = cell.with_error("wrist_2.theta", 1e-3)
    moved, length = (a.points(cell.q) - cell.arm.points(cell.q) for a in (slipped, cell.with_error("wrist_2.a", 1e-3)))
    best = np.sum(moved * length) / np.sum(length**2)
    assert np.sqrt(np.mean((moved - best * length) ** 2)) < NOISE
    found = po.recheck(cell.problem, cell.measured(slipped, rng))
    assert found.verdict == "changed"
    assert not is_named(found, ("joint_offset", "wrist_2"))
    assert is_in_headline(found, ("joint_offset", "wrist_2"))
    assert [c.target for c in found.shared] == ["wrist_2.a"]
    assert found.to_json()["shared"] == [{"kind": "link", "target": "wrist_2.a"}]
    assert found.updated is None
    assert found.plan is not None
    assert found.statements[0].id == "changes.one-of"
    assert found.statements[0].values["changes"] == ("zero of wrist_2", "length wrist_2.a")
    assert not any(c.target == "wrist_2.beta" for c in found.changes)  # the same turn about the same axis


@pytest.mark.long
def test_two_changes_are_several_with_postures_to_measure() -> None:
    cell, rng = stated(), np.random.default_rng(2)
    arm = replace(cell.with_error("elbow.theta", 0.4e-3), tool=cell.arm.tool @ shift(0.4e-3, 0.0, 0.3e-3))
    found = po.recheck(cell.problem, cell.measured(arm, rng))
    assert found.verdict == "several"
    assert {(c.kind, c.target) for c in found.named} == {("tool_frame", "tool"), ("joint_offset", "elbow")}
    assert found.plan is not None
    assert len(found.to_json()["measure"]) == 10
    assert found.updated is None


def test_a_base_that_was_set_down_elsewhere_is_found_in_one_go() -> None:
    cell, rng = stated(), np.random.default_rng(2)
    arm = replace(cell.arm, base=shift(4e-3, -3e-3, 0.0) @ turn(2, 0.1))
    found = po.recheck(cell.problem, cell.measured(arm, rng))
    assert (found.verdict, found.changes[0].target) == ("changed", "base")
    assert found.updated is not None
    again = po.recheck(found.updated, cell.measured(arm, rng))
    assert again.verdict == "unchanged"


def test_a_joint_that_skipped_a_tooth_is_named_with_its_size() -> None:
    """60 mrad: the tool leaves the tangent of its arc by 2 mm, forty times the noise."""
    cell, rng = stated(), np.random.default_rng(2)
    found = po.recheck(cell.problem, cell.measured(cell.with_error("elbow.theta", 0.06), rng))
    assert is_named(found, ("joint_offset", "elbow")), found.summary()
    value, std, _ = found.changes[0].values["theta"]
    assert abs(value - 0.06) < 3 * std < 0.2e-3


def test_a_link_that_was_bent_is_named_by_its_twist() -> None:
    cell, rng = stated(), np.random.default_rng(2)
    found = po.recheck(cell.problem, cell.measured(cell.with_error("elbow.alpha", 1e-3), rng))
    assert is_named(found, ("link", "elbow.alpha")), found.summary()
    assert found.statements[0].about == "twist elbow.alpha"


def test_a_misread_row_is_left_out_and_its_line_named() -> None:
    zero = 0.5e-3
    cell, rng = stated(), np.random.default_rng(3)
    points = cell.with_error("elbow.theta", zero).points(cell.q) + rng.normal(0, NOISE, (len(cell.q), 3))
    points[4] += [3e-3, -2e-3, 1e-3]
    found = po.recheck(cell.problem, po.read_measurements(cell.table(points), cell.problem))
    assert [row.line for row in found.gross] == [5]
    assert found.gross[0].error == pytest.approx(math.sqrt(14) * 1e-3, abs=0.2e-3)
    assert is_named(found, ("joint_offset", "elbow")), found.summary()
    assert found.before < 1e-3
    assert [(s.about, s.severity) for s in found.statements if s.id == "changes.gross-row"] == [("5", "caution")]


def test_update_writes_the_file_with_only_that_changed(tmp_path: Path) -> None:
    cell, rng = stated(), np.random.default_rng(7)
    arm = cell.with_error("elbow.theta", 0.5e-3)
    for name, content in cell.problem.files("arm").items():
        (tmp_path / name).write_bytes(content)
    table = cell.table(arm.points(cell.q) + rng.normal(0, NOISE, (10, 3)))
    rows = [", ".join(table), *(", ".join(map(repr, map(float, row))) for row in zip(*table.values(), strict=True))]
    (tmp_path / "new.csv").write_text("\n".join(rows))
    words = ("recheck", tmp_path / "new.csv", "--problem", tmp_path / "arm.yaml", "--update", "--out", tmp_path / "out")
    done = invoke(*words, "--no-plots")
    assert done.exit_code == 0, done.output
    written = po.load_problem(tmp_path / "out" / "rechecked.yaml")
    assert written.corrections == pytest.approx({"elbow.theta": 0.5e-3}, abs=1e-4)
    assert written.sources.same_as(po.load_problem(tmp_path / "arm.yaml").sources)


@pytest.mark.campaign
def test_changes_are_named_nine_times_in_ten() -> None:
    """40 draws each of tool 0.3 mm, base 0.5 mm, zero 0.2 mrad, link 0.2 mm and nothing, ten planned postures."""
    cell, rng = calibrated("panda"), np.random.default_rng(1)
    alone, said = dict.fromkeys(KINDS, 0), dict.fromkeys(KINDS, 0)
    for what in KINDS:
        for _ in range(40):
            arm, truth = cell.changed(what, rng)
            found = po.recheck(cell.problem, cell.measured(arm, rng))
            alone[what] += is_named(found, truth)
            said[what] += is_in_headline(found, truth)
    assert said["nothing"] >= 38, said
    assert min(said.values()) >= 36, said
    assert min(alone.values()) >= 36, alone
