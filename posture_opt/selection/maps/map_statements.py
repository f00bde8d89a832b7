"""What a map of targets has to say: its best and worst target, and what the position in the problem loses."""

from __future__ import annotations

from typing import TYPE_CHECKING

from posture_opt.collision.scene_statements import scene_statements
from posture_opt.selection.answer.arm_statements import beyond_measured, free_frames
from posture_opt.selection.answer.confirmation_statement import confirmed
from posture_opt.selection.answer.solution_statements import NO_GAIN, free_joints
from posture_opt.selection.registered_tasks import part_words
from posture_opt.statements import Quantity, Statement, state
from posture_opt.statements.notation import place

if TYPE_CHECKING:
    from posture_opt.selection.maps.map_points import MapPoint
    from posture_opt.selection.maps.target_map import TargetMap


def map_statements(found: TargetMap) -> tuple[Statement, ...]:
    """All of them, the best target first."""
    best, worst, Q = found.best, found.worst, found.postures[found.feasible]
    part = part_words(found.within, found.optimisation_problem.task.kind)
    return (
        state("selection.best-target", position=place(best.position), sigma=Quantity(best.sigma_max), part=part),
        *([] if found.own is None else [_own(best, found.own)]),
        state("selection.worst-target", sigma=Quantity(worst.sigma_max), position=place(worst.position)),
        *free_joints(found.optimisation_problem),
        *scene_statements(found.problem.scene, Q),
        *beyond_measured(found.problem.arm, Q),
        *confirmed(found.confirmation),
        *{note.text: note for note in found.notes if isinstance(note, Statement)}.values(),
        *free_frames(found.problem.robot),
    )


def _own(best: MapPoint, own: MapPoint) -> Statement:
    """What moving the workpiece from the position in the problem to the best target gains."""
    if not own.feasible:
        return state("selection.own-target-infeasible")
    gain = 1 - best.sigma_max / own.sigma_max if own.sigma_max > 0 else 0.0
    sigma = Quantity(own.sigma_max)
    if gain < NO_GAIN:
        return state("selection.own-target-best", sigma=sigma)
    return state("selection.own-target", sigma=sigma, gain=Quantity(gain, "share"))
