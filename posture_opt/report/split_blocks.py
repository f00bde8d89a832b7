"""Measurements that discriminate named effects from their rivals: pairs, postures, a file to fill in."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from posture_opt.diagnosis.discrimination_design import detection_probability
from posture_opt.measurements.header import AXES, QUATERNION
from posture_opt.report.blocks import Block, Facts, Table
from posture_opt.report.units_text import angle, count, fixed, joint_unit, percent

if TYPE_CHECKING:
    from posture_opt.diagnosis.discrimination_plan import DiscriminatedPair, DiscriminationPlan
    from posture_opt.measurements.measurements import Measurements
    from posture_opt.report.diagnosed import Diagnosed
    from posture_opt.robot.robot import Robot

FILE = "split_measurements.csv"
_TITLE = "Measurements that discriminate between causes"
_READ = (
    "The angle is that between the effects of the two causes on these data, beside the geometry and the other effects "
    "(0 deg: indistinguishable); 'now' is the probability that data like these refute the wrong one."
)
_IMPOSSIBLE = (
    "Pairs without a number cannot be discriminated by the postures, sides of approach and payloads at hand: see above."
)


def split_block(diagnosed: Diagnosed) -> tuple[Block, ...]:
    """Pairs that further postures discriminate, and these postures; nothing where no effect has a rival."""
    plan = diagnosed.diagnosis.split
    if plan is None:
        return ()
    pairs = _pairs(diagnosed, plan)
    if not len(plan.rows):
        text = "No posture, side of approach or payload at hand discriminates these; the measurements named above do."
        return (Block(_TITLE, (f"{text} {_READ}", pairs)),)
    often = "" if plan.rounds == 1 else f" in {plan.rounds} rounds"
    items: list[str | Facts | Table] = [
        f"{count(len(plan.rows), 'posture')}{often} refute the wrong cause of each pair, whichever it is; 'needed' is "
        f"the number of measurements, from the first, that do so with a probability of 90 %. {_READ}",
        pairs,
        *([_IMPOSSIBLE] if any(s.count is None for each in plan.pairs.values() for s in each) else []),
        _postures(diagnosed, plan),
        "The postures keep clear of the arm itself and go no lower than its base or than these data; other obstacles "
        f"are not checked, so drive slowly the first time. Fill in {FILE}, append its rows to the data, column by "
        "column, and diagnose again.",
    ]
    return (Block(_TITLE, tuple(items)),)


def _pairs(diagnosed: Diagnosed, plan: DiscriminationPlan) -> Table:
    rows = []
    for place, finding in diagnosed.effects:
        for split in plan.pairs.get(place, ()):
            names = finding.cause.label, split.rival.label
            rows.append((*names, angle(split.angle), _probability(detection_probability(split.now)), *_then(split)))
    table = Table(("cause", "rival", "angle", "now", "planned", "needed"), tuple(rows), text_columns=2)
    return table if len(plan.rows) else Table(table.headers[:4], tuple(row[:4] for row in table.rows), text_columns=2)


def _then(split: DiscriminatedPair) -> tuple[str, str]:
    return ("", "") if split.count is None else (_probability(detection_probability(split.then)), str(split.count))


def _probability(p: float) -> str:
    return "above 99.9 %" if p > 0.999 else "below 0.1 %" if p < 0.001 else percent(p)


def _postures(diagnosed: Diagnosed, plan: DiscriminationPlan) -> Table:
    robot, rows = diagnosed.residuals.robot, plan.rows
    heads = [f"{joint.name.replace('_', ' ')} [{joint_unit(joint.type)[0]}]" for joint in robot.joints]
    sides = [f"{robot.joint_names[j]} approach" for j in plan.sided]
    load = [] if rows.payload is None else ["payload [kg]"]
    return Table(("no.", *heads, *sides, *load), tuple(_cells(robot, plan, i) for i in range(len(rows))), 0)


def _cells(robot: Robot, plan: DiscriminationPlan, i: int) -> tuple[str, ...]:
    rows = plan.rows
    values = [fixed(float(v) * joint_unit(j.type)[1]) for v, j in zip(rows.q[i], robot.joints, strict=True)]
    sides = ["upwards" if rows.approach[i, j] > 0 else "downwards" for j in plan.sided]
    load = [] if rows.payload is None else [f"{rows.payload[i]:g}"]
    return (str(i + 1), *values, *sides, *load)


def split_csv(diagnosed: Diagnosed) -> str:
    """The planned measurements with the columns of the data, what is to be measured left empty; empty without any."""
    plan, data = diagnosed.diagnosis.split, diagnosed.data
    if plan is None or not len(plan.rows):
        return ""
    robot, rows = diagnosed.residuals.robot, plan.rows
    heads = [f"{j.name} [{joint_unit(j.type)[0]}]" for j in robot.joints]
    labels = [name for name in ("pose", "goal") if getattr(data, f"{name}_given")]
    sides = [f"{robot.joint_names[j]}.approach" for j in plan.sided]
    load = [] if rows.payload is None else ["payload [kg]"]
    empty = _unmeasured(data)
    target = ["target"] if data.target_names else []
    lines = [", ".join([*labels, *target, *heads, *sides, *load, *empty])]
    factors = [math.degrees(1.0) if j.type == "revolute" else 1e3 for j in robot.joints]
    for _ in range(plan.rounds):
        for i in range(len(rows)):
            values = [f"{v:.2f}" for v in np.array(rows.q[i]) * factors + 0.0]
            here = [f"split {i + 1}"] * len(labels) + [*data.target_names[:1]] * len(target)
            here += [*values, *(f"{rows.approach[i, j]:.0f}" for j in plan.sided)]
            here += [] if rows.payload is None else [f"{rows.payload[i]:g}"]
            lines.append(", ".join([*here, *[""] * len(empty)]))
    return "\n".join(lines) + "\n"


def _unmeasured(data: Measurements) -> list[str]:
    """Columns that only the measurement fills."""
    turned = list(QUATERNION) if data.rotation is not None else []
    logged = [("temperature [degC]", data.temperature), ("time [s]", data.time)]
    axes = [f"{AXES[a]} [mm]" for a in np.flatnonzero(data.measured_axes)]
    return [*axes, *turned, *(name for name, values in logged if values is not None)]
