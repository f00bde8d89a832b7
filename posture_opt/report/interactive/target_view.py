"""The interactive view of a map: the posture at every target that has one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from posture_opt.report.interactive.arm_view import ArmView, ShownPosture
from posture_opt.report.scene.arm_geometry import TargetGeometry
from posture_opt.statements.notation import length, length_unit, place
from posture_opt.uncertainty.spread.spread import relative_spread

if TYPE_CHECKING:
    from posture_opt.selection.maps.map_points import MapPoint
    from posture_opt.selection.maps.target_map import TargetMap


def target_key(point: MapPoint) -> str:
    """By which tables name a target of the view."""
    return f"target {place(point.position)}"


def target_view(found: TargetMap, sizes: Sequence[float], what: str) -> ArmView | None:
    """The postures coloured by ``sizes`` (N,) [m], of which ``what`` says what they are; None where no target has one.

    The target with the smallest size comes first. Each posture has the spread and the target that it was found for.
    """
    unit, factor = length_unit([size for size in sizes if size == size])
    postures = [
        ShownPosture(
            target_key(point),
            f"{place(point.position)}: {length(size)}",
            point.q,
            ((what.capitalize(), length(size)), ("Target", place(point.position))),
            relative_spread(found.problem, point.q, found.target.lever),
            TargetGeometry.of(replace(found.target, lower=point.position, upper=point.position)),
            value=round(factor * size, 5),
        )
        for point, size in zip(found.map_points, sizes, strict=True)
        if point.feasible
    ]
    if not postures:
        return None
    known = [size for point, size in zip(found.map_points, sizes, strict=True) if point.feasible]
    best = known.index(min(known))  # as the first sentence of the report has it, not by rounded values
    ordered = (postures[best], *postures[:best], *postures[best + 1 :])
    scene = getattr(found.problem, "scene", None)
    robot = found.optimisation_problem.robot
    return ArmView(robot, ordered, "Target", scene, points=True, values=f"{what} [{unit}]")
