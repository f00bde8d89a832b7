"""What an answer has to say: the posture or postures, what they are worth, what limits them, what would help."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from posture_opt.collision.scene_statements import scene_statements
from posture_opt.robot.posture import joints_at_limits
from posture_opt.selection.answer.arm_statements import beyond_measured, free_frames
from posture_opt.selection.answer.confirmation_statement import confirmed
from posture_opt.selection.answer.improvements import CalibratedArm, HalvedSigma, Improvement, MovedPart
from posture_opt.selection.answer.placement import placement_text
from posture_opt.selection.registered_tasks import part_words
from posture_opt.selection.tasks.workpiece import WORKPIECE
from posture_opt.statements import Quantity, Statement, Value, state
from posture_opt.statements.notation import place, shift
from posture_opt.uncertainty.sources.source_names import source_size
from posture_opt.uncertainty.spread.joint_digits import readable_posture
from posture_opt.units import joint_text

if TYPE_CHECKING:
    from posture_opt.selection.answer.solution import Solution
    from posture_opt.selection.program.optimisation_problem import OptimisationProblem

ACROSS_PATH = "across the path"
NO_GAIN = 5e-4
"""A relative difference of standard deviations that no report shows."""
SMALL_GAIN = 0.05
"""Below this gain over a typical posture something else helps more than the choice."""
GOOD_PROBABILITY = 0.99
"""Of success: below it, another posture may have a higher one."""
_PLANAR_JOINTS = 2  # of arms that are drawn on paper
_PROBABILITY_TOLERANCE = 1e-4  # of a probability: what a report tells apart


def solution_statements(found: Solution) -> tuple[Statement, ...]:
    """All of them, the answer first."""
    if found.status == "infeasible":
        return (*_failure(found), *_noted(found))
    return (
        *(_motion(found) if found.along_path else _features(found) if found.of_features else _posture(found)),
        *drive_statements(found),
        *([state("selection.not-confirmed")] if found.status != "optimal" else []),
        *_help(found),
        *_on_table(found),
        *confirmed(found.confirmation if found.points else found.statistics.confirmation),
        *([] if found.of_features else [found.worst.spread.validity.statement]),
        *_noted(found),
    )


def drive_statements(found: Solution) -> tuple[Statement, ...]:
    """What to know before anyone drives there: surfaces, measured ranges, the workpiece, limits of joints."""
    scene, robot = found.problem.scene, found.problem.robot
    at = joints_at_limits(robot, found.postures) if robot.n > _PLANAR_JOINTS else ()
    limits = [state("selection.joint-at-limit", joints=tuple(at))] if at else []
    return (
        *scene_statements(scene, found.postures), *beyond_measured(found.problem.arm, found.postures),
        *_workpiece(found), *limits,
    )  # fmt: skip


def part_of(found: Solution) -> str:
    """The part of the spread that counts, and of which end of a peg."""
    if found.along_path:
        return ACROSS_PATH
    seen = found.task_spread
    end = "" if seen.peg is None else ", at the top end of the peg" if seen.critical is seen.peg.top else ", at its tip"
    return part_words(found.critical.within, seen.kind) + end


def _noted(found: Solution) -> tuple[Statement, ...]:
    """The notes that are statements, each once, and frames that are free."""
    noted = {note.text: note for note in found.notes if isinstance(note, Statement)}
    return (*noted.values(), *free_frames(found.problem.robot))


def _posture(found: Solution) -> tuple[Statement, ...]:
    """The standard deviation, the posture and its free joints, success, and where the workpiece goes."""
    return (
        state("selection.best-posture", sigma=Quantity(found.sigma_max), part=part_of(found)),
        state("selection.posture", posture=readable_posture(found.problem, found.q)),
        *free_joints(found.optimisation_problem),
        *found.task_spread.success_statement(found.spread.taught),
        *([state("selection.place-target", position=place(found.spread.position))] * (found.target.kind != "point")),
    )  # fmt: skip


def free_joints(asked: OptimisationProblem) -> list[Statement]:
    """The joints whose value is free, such as the last of a wrist that spins the tool about its axis."""
    names = tuple(asked.robot.joint_names[k] for k in asked.nlp.free)
    return [state("selection.free-joint", joints=names)] if names else []


def _features(found: Solution) -> tuple[Statement, ...]:
    """The worst feature, the placement, what it gains, and the success of all."""
    assert found.placement is not None
    free, typical = bool(found.placement.free.any()), found.typical
    name = "place-workpiece" if free else "workpiece-fixed"
    given: dict[str, Value] = {"sigma": Quantity(found.sigma_max), "part": part_of(found), "features": len(found.names)}
    said = [state("selection.best-features", str(found.worst_station), **given),
            state(f"selection.{name}", placement=placement_text(found.placement.w, found.placement))]  # fmt: skip
    if found.task.combine == "mean":
        said.append(state("selection.features-mean", sigma=Quantity(found.sigma)))
    if free and typical is not None and 1 - found.sigma / typical.sigma > NO_GAIN:
        gain = Quantity(1 - found.sigma / typical.sigma, "share")
        said.append(state("selection.gain", gain=gain, typical=Quantity(typical.sigma)))
    if found.success is not None:
        taught = "-if-taught" if found.spread.taught else ""
        p_success = Quantity(found.success.probability, "probability", found.success.standard_error or None)
        said.append(state(f"selection.success-of-all{taught}", probability=p_success))
    return tuple(said)


def _motion(found: Solution) -> tuple[Statement, ...]:
    """The worst point, the steps, where the motion leaves the path, how it ends, its speed."""
    where = found.path.numbers[found.worst_index]
    return (
        state("selection.best-motion", where, sigma=Quantity(found.sigma_max), part=ACROSS_PATH),
        *(map(_break, found.breaks) if found.breaks else [state("selection.motion-steps", steps=_steps(found))]),
        *_closed(found),
        *_speed(found),
    )


def _steps(found: Solution) -> tuple[str, ...]:
    """The largest change of joints between listed points, of those that turn and those that slide."""
    moved = np.max(np.abs(np.diff(found.motion.Q[found.path.listed], axis=0)), axis=0)
    largest: dict[str, float] = {}
    for joint, step in zip(found.problem.robot.joints, moved.tolist(), strict=True):
        largest[joint.unit] = max(step, largest.get(joint.unit, 0.0))
    dimensions = {"rad": "joint angle", "m": "length"}
    return tuple(str(Quantity(step, dimensions[unit])) for unit, step in largest.items())


def _break(one: Any) -> Statement:
    """Where and why the arm leaves the path: of a ``PathBreak``."""
    name = "path-singular" if one.kind == "singular" else "path-blocked"
    given: dict[str, Value] = {"first": one.first, "last": one.last, "moved": joint_text(one.moved, one.unit)}
    return state(f"selection.{name}", one.joint, **given, off=Quantity(one.off))


def _closed(found: Solution) -> list[Statement]:
    """How a closed path ends."""
    if not found.task.closed:
        return []
    turned = [state("selection.path-turned", name, turns=turns) for name, turns in found.law.whole_turns.items()]
    return turned or [state("selection.path-closed")]


def _speed(found: Solution) -> list[Statement]:
    """The speed along the path, how long it takes, and which joint bounds it."""
    law = found.law
    if law.speed is None:
        return []
    speed, time = Quantity(law.speed, "speed"), Quantity(float(law.times[-1]), "duration")
    if law.stated is None:
        return [state("selection.speed-highest", law.limiting_joint, speed=speed, time=time)]
    if law.highest is None:
        return [state("selection.speed-stated", speed=speed, time=time)]
    highest = Quantity(law.highest, "speed")
    return [state("selection.speed-bounded", law.limiting_joint, speed=speed, time=time, highest=highest)]


def _workpiece(found: Solution) -> list[Statement]:
    """That the arm meets the workpiece where it was put, or comes nearer than it may."""
    problem = found.problem
    if problem.part is None or found.clearance is None or found.clearance.cell is None:
        return []
    nearest = found.clearance.cell
    if nearest.between[1] != WORKPIECE or nearest.distance > problem.scene.margin:
        return []
    if nearest.distance <= 0:
        return [state("collision.workpiece-hit", nearest.between[0])]
    return [state("collision.workpiece-near", nearest.between[0], distance=Quantity(nearest.distance))]


def _help(found: Solution) -> tuple[Statement, ...]:
    """What helps most where the choice gains little, and what the table of changes takes for granted."""
    gain, helpful, problem = found.gain_over(found.statistics.typical), found.helpful, found.problem
    little = not found.points and math.isfinite(gain) and gain < SMALL_GAIN
    said = []
    if little and helpful:
        said.append(state("selection.no-gain") if gain < NO_GAIN
                    else state("selection.small-gain", gain=Quantity(gain, "share")))  # fmt: skip
        said.append(_improvement(found, helpful[0]))
    if little and found.target.kind == "point":
        said.append(state("selection.state-region"))
    kinds = {type(change) for change in helpful}
    if CalibratedArm in kinds:
        said.append(state("selection.calibration-removes-constant"))
    elif problem.sources.scatter.any() and not problem.sources.constant.any():
        said.append(state("selection.calibration-useless"))
    return (*said, *([state("selection.halved-here")] if HalvedSigma in kinds else []))


def _improvement(found: Solution, change: Improvement) -> Statement:
    """A change with its size and what it leaves."""
    left = {"sigma": Quantity(change.sigma_max), "gain": Quantity(change.gain, "share")}
    if isinstance(change, HalvedSigma):
        size = source_size(change.parameter, change.sigma / 2, found.problem.arm)
        return state("selection.halve-sigma", change.parameter, size=size, **left)
    if isinstance(change, CalibratedArm):
        instrument = Quantity(change.instrument)
        return state("selection.calibrate-arm", "", postures=change.postures, instrument=instrument, **left)
    assert isinstance(change, MovedPart)
    return state("selection.move-part", "", shift=shift(change.shift), **left)


def _on_table(found: Solution) -> tuple[Statement, ...]:
    """What tables of one posture, of placements or of a motion do not say themselves."""
    if found.along_path:
        return _spacing(found)
    if not found.of_features:
        return (*_ranking(found), *_alternatives(found), *_orientation(found))
    success, said = found.success, []
    if success is not None and abs(success.product - success.probability) > _PROBABILITY_TOLERANCE:
        said.append(state("selection.errors-shared", probability=Quantity(success.product, "probability")))
    if found.placement is not None and found.placement.free.any():
        origin, yaw = _base_from_workpiece(found.placement.w.tolist())
        said.append(state("selection.move-robot-instead", origin=place(origin), yaw=Quantity(yaw, "joint angle")))
    return tuple(said)


def _base_from_workpiece(w: list[float]) -> tuple[tuple[float, float, float], float]:
    """The world origin [m] and its yaw [rad] in the frame of a workpiece at w (4,)."""
    c, s = math.cos(w[3]), math.sin(w[3])
    x, y, z = (-v for v in w[:3])
    return (c * x + s * y, -s * x + c * y, z), math.remainder(-w[3], 2 * math.pi)


def _spacing(found: Solution) -> tuple[Statement, ...]:
    """What keeps the tool on the line as well as its scatter does; the way off it goes with the distance squared."""
    ratio = found.off_line / found.sigma_max if found.sigma_max > 0 else 0.0
    if ratio <= 1 or found.breaks:
        return ()
    gap = float(np.diff(found.path.lengths).max())
    return (state("selection.off-line", spacing=Quantity(gap / ratio**0.5)),)


def _ranking(found: Solution) -> list[Statement]:
    """By what postures are ranked where that is not the largest standard deviation; what raises the success."""
    task, part = found.optimisation_problem.task, part_of(found)
    if task.criterion == "worst" and not task.minimize:
        p_success = found.success_probability
        advised = p_success is not None and p_success <= GOOD_PROBABILITY and task.part is None
        return [state("selection.maximise-success")] if advised else []
    ranking = tuple(([f"criterion {task.criterion}"] if task.criterion != "none" else [])
                    + [term.kind.replace("_", " ") for term in task.minimize])  # fmt: skip
    return [state("selection.ranked-by", ranking=ranking, part=part)]


def _alternatives(found: Solution) -> list[Statement]:
    """That there are no other optima, or how many are not listed as they differ by spin or redundancy alone."""
    more = len(found.optima) - len(found.alternatives)
    if more:
        return [state("selection.same-configuration", more=more)]
    return [] if len(found.alternatives) > 1 else [state("selection.no-alternative")]


def _orientation(found: Solution) -> list[Statement]:
    """How far first order, which a term on the orientation takes, is off."""
    task = found.optimisation_problem.task
    if not any(term.uses_orientation for term in (*task.minimize, *task.subject_to)):
        return []
    return [state("selection.orientation-first-order", error=Quantity(found.orientation.first_order_error, "share"))]


def _failure(found: Solution) -> tuple[Statement, ...]:
    """Why there is no answer, and the cheapest change that makes one."""
    first, *further = [reason.message for reason in found.reasons] or ["no posture fits"]
    name = "no-motion" if found.along_path else "no-placement" if found.of_features else "no-posture"
    said = [state(f"selection.{name}", found.reasons[0].requirement if found.reasons else "", reason=first)]
    said += [state("selection.further-reason", reason=reason) for reason in further]
    said += [state("selection.remedy", change=_capital(one.change)) for one in found.relaxations[:1]]
    placement = found.placement
    if found.of_features and placement is not None and placement.statistics is not None:
        tried, text = placement.statistics.placements, placement_text(placement.w, placement)
        said.append(state("selection.nearest-placement", tried=tried, placement=text))
    return tuple(said)


def _capital(text: str) -> str:
    """A text that begins a sentence."""
    return text[:1].upper() + text[1:]
