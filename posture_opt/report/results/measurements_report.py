"""Measurements in a few lines, for those who work with them in Python.

There is no page and no figure: a table of measurements is printed as a summary, or converted to a data frame.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from posture_opt.measurements.mixing import unmixed
from posture_opt.measurements.rotations import inverted_poses
from posture_opt.measurements.table import LINE_INDEX
from posture_opt.report.page.presenter import SummaryPresenter, pandas_module
from posture_opt.report.text.blocks import Summary
from posture_opt.units import DIMENSIONS

if TYPE_CHECKING:
    from posture_opt.measurements.measurements import Measurements


class MeasurementsPresenter(SummaryPresenter["Measurements"]):
    """How many rows of what: a summary, and the rows as a data frame."""

    def dataframe(self) -> Any:
        """Every row, with its line in the file as index.

        Raises:
            InputError: pandas is not installed.
        """
        data, pandas, more = self.result, pandas_module(), dict[str, Any]()
        if data.part is not None:
            data, more = unmixed(data)
        frame = pandas.DataFrame({**dict(_columns(data)), **more}, index=pandas.Index(data.line, name=LINE_INDEX))
        frame.attrs["file"] = data.file
        return frame

    def summary(self) -> Summary:
        """Rows and postures, what was measured, how far joints moved; robots, inputs and notes where there are any."""
        data = self.result
        poses = len(np.unique(data.pose))
        repeated = f" of {poses} postures" if poses < len(data) else ", each of another posture"
        facts = [("Rows", f"{len(data)}{repeated}"), ("Measured", _measured(data)), ("Joints", _ranges(data))]
        if len(data.robot_names) > 1:
            facts.append(("Robots", ", ".join(data.robot_names)))
        inputs = ("approach", "payload", "temperature", "time")
        there = [name for name in inputs if getattr(data, f"{name}_given", getattr(data, name) is not None)]
        facts += [("Also", ", ".join(there))] if there else []
        facts += [("Note" if k == 0 else "", note) for k, note in enumerate((*data.warnings, *data.notes)[:2])]
        return Summary(f"Measurements of {Path(data.file).name or 'a table'}", tuple(facts))


def _columns(data: Measurements) -> Iterator[tuple[str, Any]]:
    """Column names and values as ``read_measurements`` reads them back, in SI units: nothing is rounded.

    Columns that the file did not have are left out; an unknown side of approach is NaN.
    """
    units = data.joint_units or ("rad",) * data.q.shape[1]
    for k, (name, unit) in enumerate(zip(data.joint_names, units, strict=True)):
        yield f"{name} [{unit}]", data.q[:, k]
    if data.inverted and data.position is not None and data.rotation is not None:
        position, rotation = inverted_poses(data.position, data.rotation)
        data = replace(data, position=position, rotation=rotation)
    if data.position is not None:
        yield from ((f"{axis} [m]", data.position[:, k]) for k, axis in enumerate("xyz") if data.measured_axes[k])
    if data.reading is not None and data.part is None:
        columns = data.kind.read_columns.items()
        yield from ((f"{name} [{DIMENSIONS[d][0]}]", data.reading[:, k]) for k, (name, d) in enumerate(columns))
    if data.rotation is not None:
        yield from ((name, data.rotation[:, k]) for k, name in enumerate(("qw", "qx", "qy", "qz")))
    yield from _labels(data)
    if data.approach_given:
        sides = np.where(data.approach == 0, np.nan, data.approach)
        yield from ((f"{name}.approach", sides[:, k]) for k, name in enumerate(data.joint_names))
    for name, values, unit in (
        ("payload", data.payload, "kg"),
        ("temperature", data.temperature, "degC"),
        ("time", data.time, "s"),
    ):
        if values is not None:
            yield f"{name} [{unit}]", values


def _labels(data: Measurements) -> Iterator[tuple[str, Any]]:
    """Groups of rows, by their names where the file has names."""
    yield from (("pose", data.pose),) if data.pose_given else ()
    yield from (("goal", data.goal),) if data.goal_given else ()
    for label, codes, names in (
        ("target", data.target, data.target_names),
        ("robot", data.robot, data.robot_names),
        (data.kind.label, data.point, data.point_names),
        (data.kind.second_label, data.second, data.second_names),
    ):
        if names and codes is not None and label:
            yield label, [names[code] for code in codes]


def _measured(data: Measurements) -> str:
    """The measured axes and whether orientations were measured, or how many points were touched."""
    if data.touches:
        return f"touches of {len(data.point_names)} points"
    if data.position is None:
        return f"{data.kind.noun}: {', '.join(data.point_names)}" if data.point_names else data.kind.noun
    axes = ", ".join(name for name, seen in zip("xyz", data.measured_axes, strict=True) if seen)
    return f"position ({axes})" + (" and orientation" if data.rotation is not None else "")


def _ranges(data: Measurements) -> str:
    """How many joints moved, and the widest range [deg] that a joint was moved over."""
    spans = np.ptp(data.q, axis=0)
    moved = sum(span > 0 for span in spans)
    return f"{moved} of {len(spans)} moved; the widest range is {math.degrees(float(max(spans))):.0f} deg"
