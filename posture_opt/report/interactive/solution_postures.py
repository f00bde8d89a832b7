"""Postures of solutions, and of a spread at one posture, in the interactive view."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from posture_opt.report.interactive.arm_view import ArmView, ShownPosture
from posture_opt.report.interactive.source_owners import shares_by_owner
from posture_opt.report.scene.arm_geometry import TargetGeometry
from posture_opt.report.text.words import PARTS
from posture_opt.statements.notation import length, place

if TYPE_CHECKING:
    from posture_opt.selection.answer.solution import Solution
    from posture_opt.uncertainty.spread.spread import Spread


def solution_postures(solutions: Sequence[Solution], names: Sequence[str], stem: str) -> tuple[ShownPosture, ...]:
    """The postures of some solutions, with tool point, spread, target and shares of the joints.

    Args:
        names: of the solutions, for the list to choose from.
        stem: of the keys ``stem-1``, ``stem-2``, …, by which rows of tables name them.
    """
    return tuple(
        _posture_of(f"{stem}-{k}", name, one) for k, (name, one) in enumerate(zip(names, solutions, strict=True), 1)
    )


def _posture_of(key: str, name: str, one: Solution) -> ShownPosture:
    """One solution as a posture of a view."""
    sigma = length(one.critical.sigma_max)
    facts = ((f"σ {PARTS[one.critical.within]}", sigma), ("Tool point", place(one.spread.position)))
    shares = shares_by_owner(one.budget, one.optimisation_problem.arm)
    return ShownPosture(key, f"{name}: {sigma}", one.q, facts, one.spread, TargetGeometry.of(one.target), shares)


def spread_view(found: Spread) -> ArmView:
    """The one posture of a spread, with the direction of the task where there is one and the shares of the joints.

    The shares are those of the task's critical axis, else of the longest axis.
    """
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
