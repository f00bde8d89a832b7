"""Which postures the interactive view of a result shows: one function a class of results, of its name."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from posture_opt.report.figures.arm_geometry import TargetGeometry
from posture_opt.report.interactive.arm_view import ArmView, ShownPosture, shares_by_owner
from posture_opt.report.units_text import length, place
from posture_opt.report.words import PARTS

if TYPE_CHECKING:
    from posture_opt.report.solution_report import SolutionPresenter
    from posture_opt.selection.solution import Solution


def solution(shown: SolutionPresenter) -> ArmView:
    """The answer and its alternatives."""
    found = shown.result
    joints = found.optimisation_problem.robot.joint_names
    others = found.alternatives[1:] if found.status != "infeasible" else ()
    every = [found, *(replace(found, q=np.array([a.posture[name] for name in joints])) for a in others)]
    names = ["best posture" if found.status != "infeasible" else "nearest posture"]
    names += [f"alternative {rank}" for rank in range(2, len(every) + 1)]
    return ArmView(
        found.optimisation_problem.robot, _of_solutions(every, names, "alternative"), "Posture", found.problem.scene
    )


def _of_solutions(solutions: Sequence[Solution], names: Sequence[str], stem: str) -> tuple[ShownPosture, ...]:
    return tuple(
        _of_solution(f"{stem}-{k}", name, one) for k, (name, one) in enumerate(zip(names, solutions, strict=True), 1)
    )


def _of_solution(key: str, name: str, one: Solution) -> ShownPosture:
    sigma = length(one.critical.sigma_max)
    return ShownPosture(
        key,
        f"{name}: {sigma}",
        one.q,
        (
            (f"Standard deviation {PARTS[one.critical.within]}", sigma),
            ("Tool point", place(one.spread.position)),
        ),
        one.spread,
        TargetGeometry.of(one.target),
        shares_by_owner(one.budget, one.optimisation_problem.arm),
    )
