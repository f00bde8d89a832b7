"""Which postures the interactive view of a result shows: one function a class of results, of its name."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from posture_opt.report.interactive.arm_view import ArmView, ShownPosture
from posture_opt.report.interactive.measured_views import calibration, compensation, diagnosis, measurement_plan
from posture_opt.report.interactive.owners import shares_by_owner
from posture_opt.report.results.target_map_report import view_key
from posture_opt.report.scene.arm_geometry import TargetGeometry
from posture_opt.report.text.units_text import length, length_unit, place
from posture_opt.report.text.words import PARTS
from posture_opt.uncertainty.spread.spread import propagate

if TYPE_CHECKING:
    from posture_opt.report.results.accuracy_map_report import AccuracyMapPresenter
    from posture_opt.report.results.cloud_report import CloudPresenter
    from posture_opt.report.results.features_solution_report import FeaturesSolutionPresenter
    from posture_opt.report.results.path_solution_report import PathSolutionPresenter
    from posture_opt.report.results.solution_report import SolutionPresenter
    from posture_opt.report.results.spread_report import SpreadPresenter
    from posture_opt.report.results.target_map_report import TargetMapPresenter
    from posture_opt.selection.answer.solution import Solution
    from posture_opt.selection.maps.map_points import MapPoint
    from posture_opt.selection.maps.target_map import TargetMap
    from posture_opt.uncertainty.spread.spread import Spread

__all__ = [
    "accuracy_map",
    "calibration",
    "cloud",
    "compensation",
    "diagnosis",
    "features_solution",
    "measurement_plan",
    "path_solution",
    "solution",
    "spread",
    "target_map",
]


def solution(shown: SolutionPresenter) -> ArmView:
    """The answer and its alternatives."""
    found = shown.result
    joints = found.optimisation_problem.robot.joint_names
    others = found.alternatives[1:] if found.status != "infeasible" else ()
    every = [found, *(replace(found, q=np.array([a.posture[name] for name in joints])) for a in others)]
    names = ["best posture" if found.status != "infeasible" else "nearest posture"]
    names += [f"alternative {rank}" for rank in range(2, len(every) + 1)]
    postures = _of_solutions(every, names, "alternative")
    return ArmView(found.optimisation_problem.robot, postures, "Posture", found.problem.scene)


def features_solution(shown: FeaturesSolutionPresenter) -> ArmView | None:
    """A posture for each feature; None where there is none."""
    found = shown.result
    if not found.stations:
        return None
    postures = _of_solutions(found.stations, found.names, "feature")
    return ArmView(found.optimisation_problem.robot, postures, "Feature", found.problem.scene, points=True)


def path_solution(shown: PathSolutionPresenter) -> ArmView:
    """The listed points of the path, coloured by their scatter."""
    found = shown.result
    unit, factor = length_unit([float(s) for s in found.motion.sigma])
    names = [f"point {k}" for k in range(1, len(found.stations) + 1)]
    postures = tuple(
        replace(posture, value=round(factor * station.critical.sigma_max, 5))
        for posture, station in zip(_of_solutions(found.stations, names, "point"), found.stations, strict=True)
    )
    return ArmView(
        found.optimisation_problem.robot, postures, "Point of the path", found.problem.scene, points=True, line=True,
        values=f"standard deviation [{unit}]",
    )  # fmt: skip


def spread(shown: SpreadPresenter) -> ArmView:
    """The posture that was asked for."""
    return _of_spread(shown.result)


def cloud(shown: CloudPresenter) -> ArmView:
    """The posture that was simulated."""
    return _of_spread(shown.result.spread)


def target_map(shown: TargetMapPresenter) -> ArmView | None:
    """The best posture at every target that has one; None where none has."""
    found = shown.result
    return _of_targets(found, [point.sigma_max for point in found.map_points], "standard deviation")


def accuracy_map(shown: AccuracyMapPresenter) -> ArmView | None:
    """The posture at every target that has one, coloured by how far off the arm would land; None where none has."""
    found = shown.result
    if found.corrected:
        return _of_targets(found.targets, found.distance.tolist(), "mean error")
    return _of_targets(found.targets, found.radius95.tolist(), "95 % within")


def _of_targets(found: TargetMap, sizes: Sequence[float], what: str) -> ArmView | None:
    unit, factor = length_unit([size for size in sizes if size == size])
    postures = [
        ShownPosture(
            view_key(point),
            f"{place(point.position)}: {length(size)}",
            point.q,
            ((what.capitalize(), length(size)), ("Target", place(point.position))),
            propagate(found.problem, point.q),
            _target(point, found),
            value=round(factor * size, 5),
        )
        for point, size in zip(found.map_points, sizes, strict=True)
        if point.feasible
    ]
    if not postures:
        return None
    best = min(range(len(postures)), key=lambda k: postures[k].value or 0.0)
    ordered = (postures[best], *postures[:best], *postures[best + 1 :])
    scene = getattr(found.problem, "scene", None)
    robot = found.optimisation_problem.robot
    return ArmView(robot, ordered, "Target", scene, points=True, values=f"{what} [{unit}]")


def _target(point: MapPoint, found: TargetMap) -> TargetGeometry:
    return TargetGeometry.of(replace(found.target, lower=point.position, upper=point.position))


def _of_spread(found: Spread) -> ArmView:
    seen = found.for_task
    facts = [("Tool point", place(found.position))]
    if seen is not None:
        sigma = length(seen.critical.sigma_max)
        facts.insert(0, (f"σ {PARTS[seen.critical.within]}", sigma))
    target = None if seen is None else TargetGeometry("anywhere", found.position, found.position, seen.direction, None)
    budget = found.budget if seen is None else seen.budget
    arm = found.tool_point.arm
    posture = ShownPosture(
        "posture", "posture", np.array(found.q), tuple(facts), found, target, shares_by_owner(budget, arm)
    )
    return ArmView(arm.robot, (posture,), "Posture", getattr(found.problem, "scene", None))


def _of_solutions(solutions: Sequence[Solution], names: Sequence[str], stem: str) -> tuple[ShownPosture, ...]:
    return tuple(
        _of_solution(f"{stem}-{k}", name, one) for k, (name, one) in enumerate(zip(names, solutions, strict=True), 1)
    )


def _of_solution(key: str, name: str, one: Solution) -> ShownPosture:
    sigma = length(one.critical.sigma_max)
    facts = ((f"σ {PARTS[one.critical.within]}", sigma), ("Tool point", place(one.spread.position)))
    shares = shares_by_owner(one.budget, one.optimisation_problem.arm)
    return ShownPosture(key, f"{name}: {sigma}", one.q, facts, one.spread, TargetGeometry.of(one.target), shares)
