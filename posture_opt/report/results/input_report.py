"""Problems and measurements in a few lines, for those who work with them in Python."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from posture_opt.measurements.mixing import unmixed
from posture_opt.measurements.rotations import inverted_poses
from posture_opt.measurements.table import LINE_INDEX
from posture_opt.report.page.presenter import SummaryPresenter, pandas_module
from posture_opt.report.parts.parts import effect_facts, robot_facts, source_facts, workpiece_facts
from posture_opt.report.text.blocks import Summary
from posture_opt.statements.notation import place, stated_length
from posture_opt.units import DIMENSIONS

if TYPE_CHECKING:
    from posture_opt import Measurements, Problem, Task


class ProblemPresenter(SummaryPresenter["Problem"]):
    """The robot, its scatter and its task, as the summary that ``print`` shows."""

    def summary(self) -> Summary:
        problem: Problem = self.result
        task, obstacles = problem.task, [] if problem.cell is None else [o.name for o in problem.cell.obstacles]
        facts = [robot_facts(problem)[0], *effect_facts(problem), *source_facts(problem), *workpiece_facts(problem)]
        if task is None:
            facts.append(("Task", "none stated"))
        else:
            clearance = f", clearance {stated_length(task.clearance)}" if task.clearance else ""
            facts += [("Task", f"{task.kind}{clearance}"), ("Target", _where(task))]
        facts += [("Obstacles", ", ".join(obstacles))] if obstacles else []
        # Two lines a fact.
        short = tuple((label, textwrap.shorten(text, 150, placeholder=" …")) for label, text in facts)
        return Summary(f"Problem: {problem.name}", short)


def _where(task: Task) -> str:
    """Where the tool point has to be: a path, features, a region, anywhere, or one position [mm], world frame."""
    if task.on_path:
        return "along a path"
    if task.features:
        return f"{len(task.features)} features of a workpiece: {', '.join(feature.name for feature in task.features)}"
    if task.region is not None:
        return f"anywhere between {place(task.region.min)} and {place(task.region.max)}"
    return "anywhere in reach" if task.position is None else place(task.position)


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
        data = self.result
        poses = len(np.unique(data.pose))
        repeated = f" of {poses} postures" if poses < len(data) else ", each of another posture"
        spans = np.ptp(data.q, axis=0)
        widest = f"the widest range is {math.degrees(float(max(spans))):.0f} deg"
        moved = f"{sum(span > 0 for span in spans)} of {len(spans)} moved; {widest}"
        facts = [("Rows", f"{len(data)}{repeated}"), ("Measured", _measured(data)), ("Joints", moved)]
        if len(data.robot_names) > 1:
            facts.append(("Robots", ", ".join(data.robot_names)))
        inputs = ("approach", "payload", "temperature", "time")
        there = [name for name in inputs if getattr(data, f"{name}_given", getattr(data, name) is not None)]
        facts += [("Also", ", ".join(there))] if there else []
        facts += [("Note" if k == 0 else "", note) for k, note in enumerate((*data.warnings, *data.notes)[:2])]
        return Summary(f"Measurements of {Path(data.file).name or 'a table'}", tuple(facts))


def _columns(data: Measurements) -> Iterator[tuple[str, Any]]:
    """Column names and values as ``read_measurements`` reads them back, in SI units: nothing is rounded."""
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
    if data.touches:
        return f"touches of {len(data.point_names)} points"
    if data.position is None:
        return f"{data.kind.noun}: {', '.join(data.point_names)}" if data.point_names else data.kind.noun
    axes = ", ".join(name for name, seen in zip("xyz", data.measured_axes, strict=True) if seen)
    return f"position ({axes})" + (" and orientation" if data.rotation is not None else "")
