"""The files of a map: its targets as a table, the document, the report with the figure."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

from posture_opt.report.map_report import map_report
from posture_opt.report.units_text import joint_unit
from posture_opt.report.words import PARTS
from posture_opt.report.write import Files, report_files, write_files

if TYPE_CHECKING:
    from posture_opt.problem.problem import Problem
    from posture_opt.selection.target_map import Spot, TargetMap


def write_map(folder: Path, problem: Problem, found: TargetMap, plots: bool = True) -> None:
    """Writes the files of a map into ``folder``, which exists."""
    write_files(folder, map_files(problem, found, plots))


def map_files(problem: Problem, found: TargetMap, plots: bool = True) -> Files:
    """File name -> content: map.csv, map.json, reports and the figure."""
    figures = {"map": found.plot()} if plots else {}
    files = report_files("map", found.to_json(), map_report(problem, found), figures, problem)
    return {**files, "map.csv": map_csv(found).encode()}


def map_csv(found: TargetMap) -> str:
    """One row a target: place, whether there is a posture, its spread, and the posture; empty where there is none."""
    heads = [*place_heads(), *spread_heads(found), *posture_heads(found)]
    rows = [[*place_cells(spot), *spread_cells(found, spot), *posture_cells(found, spot)] for spot in found.spots]
    return "".join(", ".join(cells) + "\n" for cells in (heads, *rows))


def place_heads() -> list[str]:
    return ["x [mm]", "y [mm]", "z [mm]", "feasible"]


def place_cells(spot: Spot) -> list[str]:
    return [*(f"{1e3 * value + 0.0:.4f}" for value in spot.position), str(int(spot.feasible))]


def spread_heads(found: TargetMap) -> list[str]:
    part = PARTS[found.within]
    heads = [f"sigma {part} [mm]", "sigma along the direction [mm]", f"95 % radius {part} [mm]"]
    return heads + ["success"] * (not math.isnan(found.goal.clearance))


def spread_cells(found: TargetMap, spot: Spot) -> list[str]:
    cells = [cell(1e3 * value) for value in (spot.sigma_max, spot.sigma_along, spot.radius95)]
    return cells + [cell(spot.success_probability)] * (not math.isnan(found.goal.clearance))


def posture_heads(found: TargetMap) -> list[str]:
    return [f"{joint.name} [{joint_unit(joint.type)[0]}]" for joint in found.programme.robot.joints]


def posture_cells(found: TargetMap, spot: Spot) -> list[str]:
    joints = found.programme.robot.joints
    return [cell(q * joint_unit(joint.type)[1], 6) for q, joint in zip(spot.q, joints, strict=True)]


def cell(value: float, decimals: int = 0) -> str:
    """A number of a table: to six digits, or to so many decimals; nothing where it is not known."""
    if math.isnan(value):
        return ""
    return f"{value + 0.0:.{decimals}f}" if decimals else f"{value:.6g}"
