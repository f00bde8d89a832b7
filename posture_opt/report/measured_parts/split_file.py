"""``split_measurements.csv``: the measurements that discriminate between causes, to be filled in."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from posture_opt.csv_text import csv_line
from posture_opt.measurements.columns import AXES
from posture_opt.measurements.kinds.pose_columns import QUATERNION
from posture_opt.statements.notation import joint_unit

if TYPE_CHECKING:
    from posture_opt.diagnosis.diagnosis import Diagnosis
    from posture_opt.measurements.measurements import Measurements

FILE = "split_measurements.csv"
_REPEATED_DIGITS = 6


def split_csv(found: Diagnosis) -> str:
    """The planned measurements with the columns of the data, what is to be measured left empty; empty without any.

    Joints in deg or mm, to two decimals; postures to repeat as they were commanded, to six. Labels name the plan and
    the number of the posture, rounds repeat the whole list.
    """
    plan, data = found.split, found.request.data
    parts = [("split", plan.rows, plan.rounds, 2)] if plan is not None and len(plan.rows) else []
    # Postures that are to be repeated are commanded as they were.
    parts += [(f"repeat {p.target}", p.rows, p.times, _REPEATED_DIGITS) for p in found.repeat_plans]
    if not parts:
        return ""
    robot = found.model.residuals.robot
    headers = [f"{j.name} [{joint_unit(j.type)[0]}]" for j in robot.joints]
    labels = [name for name in ("pose", "goal") if getattr(data, f"{name}_given")]
    every = tuple(range(robot.n)) if data.approach_given and found.repeat_plans else ()
    sided = every or (plan.sided if plan is not None else ())
    sides = [f"{robot.joint_names[j]}.approach" for j in sided]
    load = ["payload [kg]"] if any(rows.payload is not None for _, rows, _, _ in parts) else []
    empty = _unmeasured(data)
    target = ["target"] if data.target_names else []
    lines = [csv_line([*labels, *target, *headers, *sides, *load, *empty])]
    factors = [math.degrees(1.0) if j.type == "revolute" else 1e3 for j in robot.joints]
    for label, rows, times, digits in parts:
        for i in [*range(len(rows))] * times:
            values = [f"{v:.{digits}f}" for v in np.array(rows.q[i]) * factors + 0.0]
            here = [f"{label} {i + 1}"] * len(labels)
            here += [data.target_names[rows.target[i]]] if target else []
            here += [*values, *(f"{rows.approach[i, j]:.0f}" for j in sided)]
            here += ["" if rows.payload is None else f"{rows.payload[i]:g}"] if load else []
            lines.append(csv_line([*here, *[""] * len(empty)]))
    return "\n".join(lines) + "\n"


def _unmeasured(data: Measurements) -> list[str]:
    """Columns that only the measurement fills."""
    turned = list(QUATERNION) if data.rotation is not None else []
    logged = [("temperature [degC]", data.temperature), ("time [s]", data.time)]
    axes = [f"{AXES[a]} [mm]" for a in np.flatnonzero(data.measured_axes)]
    return [*axes, *turned, *(name for name, values in logged if values is not None)]
