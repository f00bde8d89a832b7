"""figaroh as its UR10 example has it: `BaseCalibration` with ``full_params``, base and tip frame unknown.

The weight of positions is that of the example, the method its default, the rows come from a file as it wants them. The
error that it states is the RMSE of its report, over the rows that it learned from; its standard errors are its own.
"""

from __future__ import annotations

import contextlib
import io
import logging
import os
import tempfile
from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import numpy as np
import pandas as pd
import pinocchio as pin
import yaml
from figaroh.calibration.base_calibration import BaseCalibration
from figaroh.calibration.calibration_tools import calc_updated_fkm

from benchmarks.calibrators import Answer, Array, Task
from benchmarks.calibrators.pinocchio_fit import arm

TITLE = "figaroh"
PACKAGES = ("figaroh", "pin")


class PointCalibration(BaseCalibration):
    """The cost function of the example, which the library asks every user to write."""

    def cost_function(self, var: Array) -> Array:
        estimated = calc_updated_fkm(self.model, self.data, var, self.q_measured, self.calib_config)
        residuals = self._compute_logmap_residuals(self.PEE_measured, estimated)
        return self.apply_measurement_weighting(residuals, pos_weight=1.0, orient_weight=0.5)


def configuration(joints: list[str], rows: int) -> dict[str, object]:
    """The part of a configuration file that calibration reads."""
    return {
        "robot": {"name": "arm", "properties": {"joints": {"active_joints": joints}}},
        "tasks": {
            "calibration": {
                "enabled": True,
                "parameters": {"calibration_level": "full_params", "include_non_geometric": False},
                "kinematics": {"base_frame": "universe", "tool_frame": "tool"},
                "measurements": {
                    "markers": [{"name": "point", "measurable_dof": [True] * 3 + [False] * 3}],
                    "poses": {"base_pose": [0.0] * 6, "tool_pose": [0.0] * 6},
                },
                "data": {"source_file": "rows.csv", "number_of_samples": rows},
            }
        },
    }


def fit(task: Task, learned: Array, asked: Array) -> Answer:
    logging.disable(logging.CRITICAL)
    model = arm(task.table)
    joints = list(model.names)[1:]
    with tempfile.TemporaryDirectory() as folder, contextlib.redirect_stdout(io.StringIO()):
        columns = np.column_stack([task.points[learned], task.q[learned]])
        pd.DataFrame(columns, columns=["x1", "y1", "z1", *joints]).to_csv(Path(folder) / "rows.csv", index=False)
        (Path(folder) / "arm.yaml").write_text(yaml.safe_dump(configuration(joints, len(learned))))
        before = os.getcwd()
        os.chdir(folder)
        try:
            found = PointCalibration(pin.RobotWrapper(model), "arm.yaml")
            found.calib_config |= {"known_baseframe": False, "known_tipframe": False}
            found.initialize()
            result = found.solve(enable_logging=False)
        finally:
            os.chdir(before)
    there = {**found.calib_config, "NbSample": len(asked)}
    points = calc_updated_fkm(found.model, found.data, result.x, task.q[asked], there).reshape(3, -1).T
    names = found.calib_config["param_name"]
    sizes = {n: (float(v), float(s)) for n, v, s in zip(names, result.x, found.std_dev, strict=True) if s > 0}
    return Answer(points - task.points[asked], float(found.evaluation_metrics["rmse"]), sizes, len(names))
