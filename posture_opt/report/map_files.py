"""The files of a map: its targets as a table, the document, the report with the figure."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

from posture_opt.report.accuracy_report import accuracy_report
from posture_opt.report.map_report import map_report
from posture_opt.report.units_text import joint_unit
from posture_opt.report.words import PARTS
from posture_opt.report.write import Files, report_files, write_files

if TYPE_CHECKING:
    from posture_opt.problem.problem import Problem
    from posture_opt.selection.map_points import MapPoint
    from posture_opt.selection.target_map import TargetMap
    from posture_opt.validation.accuracy_map import AccuracyMap

_PLACE = ("x [mm]", "y [mm]", "z [mm]", "feasible")


def write_map(folder: Path, problem: Problem, found: TargetMap, plots: bool = True) -> None:
    """Writes the files of a map into ``folder``, which exists."""
    write_files(folder, map_files(problem, found, plots))


def map_files(problem: Problem, found: TargetMap, plots: bool = True) -> Files:
    """File name -> content: map.csv, map.json, reports and the figure."""
    figures = {"map": found.plot()} if plots else {}
    files = report_files("map", found.to_json(), map_report(problem, found), figures, problem)
    return {**files, "map.csv": map_csv(found).encode()}


def write_accuracy(folder: Path, problem: Problem, found: AccuracyMap, plots: bool = True) -> None:
    """Writes the files of a map of accuracy into ``folder``, which exists."""
    write_files(folder, accuracy_files(problem, found, plots))


def accuracy_files(problem: Problem, found: AccuracyMap, plots: bool = True) -> Files:
    """File name -> content: map.csv, map.json, reports and the figures."""
    figures = found.plot() if plots else {}
    files = report_files("map", found.to_json(), accuracy_report(problem, found), figures, problem)
    return {**files, "map.csv": accuracy_csv(found).encode()}


def map_csv(found: TargetMap) -> str:
    """One row a target: place, whether there is a posture, its spread, and the posture; empty where there is none."""
    part, has_hole = PARTS[found.within], not math.isnan(found.target.clearance)
    spread = [f"sigma {part} [mm]", "sigma along the direction [mm]", f"95 % radius {part} [mm]"]
    rows = [[*_PLACE, *spread, *(["success"] if has_hole else []), *_posture_heads(found)]]
    for map_point in found.map_points:
        cells = [_cell(1e3 * value) for value in (map_point.sigma_max, map_point.sigma_along, map_point.radius95)]
        cells += [_cell(map_point.success_probability)] if has_hole else []
        rows.append([*_place_cells(map_point), *cells, *_posture_cells(found, map_point)])
    return _table(rows)


def accuracy_csv(found: AccuracyMap) -> str:
    """One row a target: place, mean error, 95 % region and radius, and the posture; empty where there is none."""
    targets = found.targets
    axes = [f"95 % semi-axis {k + 1} [mm]" for k in range(found.semi_axes95.shape[1])]
    heads = [*(f"bias {c} [mm]" for c in "xyz"), "bias [mm]", *axes, "95 % radius [mm]"]
    rows = [[*_PLACE, *heads, *_posture_heads(targets)]]
    for k, map_point in enumerate(targets.map_points):
        values = [*found.bias[k], found.distance[k], *found.semi_axes95[k, ::-1], found.radius95[k]]
        rows.append([*_place_cells(map_point), *(_cell(1e3 * v) for v in values), *_posture_cells(targets, map_point)])
    return _table(rows)


def _table(rows: list[list[str]]) -> str:
    return "".join(", ".join(cells) + "\n" for cells in rows)


def _place_cells(map_point: MapPoint) -> list[str]:
    return [*(f"{1e3 * value + 0.0:.4f}" for value in map_point.position), str(int(map_point.feasible))]


def _posture_heads(found: TargetMap) -> list[str]:
    return [f"{joint.name} [{joint_unit(joint.type)[0]}]" for joint in found.optimisation_problem.robot.joints]


def _posture_cells(found: TargetMap, map_point: MapPoint) -> list[str]:
    joints = found.optimisation_problem.robot.joints
    return [_cell(q * joint_unit(joint.type)[1], 6) for q, joint in zip(map_point.q, joints, strict=True)]


def _cell(value: float, decimals: int = 0) -> str:
    """A number of a table: to six digits, or to so many decimals; nothing where it is not known."""
    if math.isnan(value):
        return ""
    return f"{value + 0.0:.{decimals}f}" if decimals else f"{value:.6g}"
