"""What an answer has to say: the posture or postures, what they are worth, what limits them, what would help."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from posture_opt.collision.scene import scene_statements
from posture_opt.model.arm import Arm
from posture_opt.numerics import Array
from posture_opt.robot.posture import joints_at_limits
from posture_opt.robot.robot import Robot
from posture_opt.selection.answer.improvements import CalibratedArm, HalvedSigma, Improvement, MovedPart
from posture_opt.selection.answer.placement import placement_text
from posture_opt.selection.registered_tasks import part_words
from posture_opt.selection.search.engine import Confirmation
from posture_opt.selection.tasks.path_task import PathTask
from posture_opt.selection.tasks.workpiece import WORKPIECE
from posture_opt.statements import Quantity, Statement, Value, state
from posture_opt.statements.notation import percent, place, shift
from posture_opt.uncertainty.joint_digits import readable_posture
from posture_opt.uncertainty.sources import source_size
from posture_opt.units import joint_text

_APART_M = 1e-6  # m: ends of a path nearer to each other than this are one point

if TYPE_CHECKING:
    from posture_opt.selection.answer.solution import Solution
    from posture_opt.selection.answer.target_answer import Alternative
    from posture_opt.selection.program.optimisation_problem import OptimisationProblem

ACROSS_PATH = "across the path"
NO_GAIN = 5e-4  # a relative difference of standard deviations that no report shows


def solution_statements(found: Solution) -> tuple[Statement, ...]:
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
    at = joints_at_limits(robot, found.postures) if robot.n > 2 else ()  # arms of two are drawn on paper
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
    noted = {note.text: note for note in found.notes if isinstance(note, Statement)}
    return (*noted.values(), *free_frames(found.problem.robot))


def _posture(found: Solution) -> tuple[Statement, ...]:
    best = found.best_of_all if abs(found.gain_of_best) >= NO_GAIN else None
    name, beside = ("best-posture", []) if best is None else ("ordinary-posture", [_best_of_all(found, best)])
    return (
        state(f"selection.{name}", sigma=Quantity(found.sigma_max), part=part_of(found)),
        state("selection.posture", posture=readable_posture(found.problem, found.q)),
        *beside,
        *free_joints(found.optimisation_problem),
        *found.task_spread.success_statement(found.spread.taught),
        *([state("selection.place-target", position=place(found.spread.position))] * (found.target.kind != "point")),
    )  # fmt: skip


def _best_of_all(found: Solution, best: Alternative) -> Statement:
    change = f"{'-' if found.gain_of_best > 0 else '+'}{percent(abs(found.gain_of_best))}"
    return state("selection.best-of-all", sigma=Quantity(best.sigma_max), change=change)


def free_joints(asked: OptimisationProblem) -> list[Statement]:
    """The joints whose value is free, such as the last of a wrist that spins the tool about its axis."""
    names = tuple(asked.robot.joint_names[k] for k in asked.nlp.free)
    return [state("selection.free-joint", joints=names)] if names else []


def _features(found: Solution) -> tuple[Statement, ...]:
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
        said.append(state("selection.gain", gain=gain, choice="placement", typical=Quantity(typical.sigma)))
    if found.success is not None:
        taught = "-if-taught" if found.spread.taught else ""
        p_success = Quantity(found.success.probability, "probability", found.success.standard_error or None)
        said.append(state(f"selection.success-of-all{taught}", probability=p_success))
    return tuple(said)


def _motion(found: Solution) -> tuple[Statement, ...]:
    where = found.path.numbers[found.worst_index]
    said = [state("selection.best-motion", where, sigma=Quantity(found.sigma_max), part=ACROSS_PATH)]
    for one in found.breaks:
        given: dict[str, Value] = {"first": one.first, "last": one.last, "moved": joint_text(one.moved, one.unit)}
        name = "path-singular" if one.kind == "singular" else "path-blocked"
        said.append(state(f"selection.{name}", one.joint, **given, off=Quantity(one.off)))
    if not found.breaks:
        said.append(state("selection.motion-steps", steps=_steps(found)))
    if isinstance(found.task, PathTask) and found.task.closed:
        turned = [state("selection.path-turned", name, turns=n) for name, n in found.law.whole_turns.items()]
        said += turned or [state("selection.path-closed")]
    elif not found.closed and np.linalg.norm(found.path.points[-1] - found.path.points[0]) < _APART_M:
        off = np.abs(found.motion.Q[-1] - found.motion.Q[0])
        joint = found.problem.robot.joints[int(np.argmax(off))]
        said.append(state("selection.path-ends-apart", joint.name, moved=joint_text(float(off.max()), joint.unit)))
    return (*said, *_speed(found))


def _steps(found: Solution) -> tuple[str, ...]:
    moved = np.max(np.abs(np.diff(found.motion.Q[found.path.listed], axis=0)), axis=0)
    largest: dict[str, float] = {}
    for joint, step in zip(found.problem.robot.joints, moved.tolist(), strict=True):
        largest[joint.unit] = max(step, largest.get(joint.unit, 0.0))
    dimensions = {"rad": "joint angle", "m": "length"}
    return tuple(str(Quantity(step, dimensions[unit])) for unit, step in largest.items())


def _speed(found: Solution) -> list[Statement]:
    law = found.law
    if law.speed is None:
        return []
    speed, time = Quantity(law.speed, "speed"), Quantity(float(law.lengths[-1]) / law.speed, "duration")
    if law.stated is None:
        return [state("selection.speed-highest", str(law.limiting_joint), speed=speed, time=time)]
    if law.highest is None:
        return [state("selection.speed-stated", speed=speed, time=time)]
    highest = Quantity(law.highest, "speed")
    return [state("selection.speed-bounded", str(law.limiting_joint), speed=speed, time=time, highest=highest)]


def _workpiece(found: Solution) -> list[Statement]:
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
    gain, helpful, problem = found.gain_over(found.statistics.typical), found.helpful, found.problem
    little = not found.points and math.isfinite(gain) and gain < 0.05
    said = []
    if little and helpful:
        said.append(state("selection.no-gain") if gain < NO_GAIN
                    else state("selection.small-gain", gain=Quantity(gain, "share")))  # fmt: skip
        said.append(_improvement(found, helpful[0]))
    if little and found.target.kind == "point":
        said.append(state("selection.state-region"))
    elif not little and not found.points and math.isfinite(gain):
        choice, typical = ("posture", "placement")[found.target.kind != "point"], Quantity(found.statistics.typical)
        said.append(state("selection.gain", gain=Quantity(gain, "share"), choice=choice, typical=typical))
    kinds = {type(change) for change in helpful}
    if CalibratedArm in kinds:
        said.append(state("selection.calibration-removes-constant"))
    elif problem.sources.scatter.any() and not problem.sources.constant.any():
        said.append(state("selection.calibration-useless"))
    return (*said, *([state("selection.halved-here")] if HalvedSigma in kinds else []))


def _improvement(found: Solution, change: Improvement) -> Statement:
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
    said: list[Statement] = []
    if found.along_path:
        # The way off the line goes with the distance squared.
        ratio = found.off_line / found.sigma_max if found.sigma_max > 0 else 0.0
        if ratio > 1 and not found.breaks:
            gap = float(np.diff(found.path.lengths).max())
            said.append(state("selection.off-line", spacing=Quantity(gap / ratio**0.5)))
        return tuple(said)
    if not found.of_features:
        return _on_table_of_one(found)
    success = found.success
    if success is not None and abs(success.product - success.probability) > 1e-4:
        said.append(state("selection.errors-shared", probability=Quantity(success.product, "probability")))
    if found.placement is not None and found.placement.free.any():
        origin, yaw = _base_from_workpiece(found.placement.w.tolist())
        said.append(state("selection.move-robot-instead", origin=place(origin), yaw=Quantity(yaw, "joint angle")))
    return tuple(said)


def _on_table_of_one(found: Solution) -> tuple[Statement, ...]:
    said, task, more = _ranking(found), found.optimisation_problem.task, len(found.optima) - len(found.alternatives)
    if more:
        said.append(state("selection.same-configuration", more=more))
    elif len(found.alternatives) <= 1:
        said.append(state("selection.no-alternative"))
    if any(term.uses_orientation for term in (*task.minimize, *task.subject_to)):
        error = Quantity(found.orientation.first_order_error, "share")
        said.append(state("selection.orientation-first-order", error=error))
    return tuple(said)


def _base_from_workpiece(w: list[float]) -> tuple[tuple[float, float, float], float]:
    """The world origin [m] and its yaw [rad] in the frame of a workpiece at w (4,)."""
    c, s = math.cos(w[3]), math.sin(w[3])
    x, y, z = (-v for v in w[:3])
    return (c * x + s * y, -s * x + c * y, z), math.remainder(-w[3], 2 * math.pi)


def _ranking(found: Solution) -> list[Statement]:
    task, part = found.optimisation_problem.task, part_of(found)
    if task.criterion == "worst" and not task.minimize:
        p_success = found.success_probability
        advised = p_success is not None and p_success <= 0.99 and task.part is None
        return [state("selection.maximise-success")] if advised else []
    ranking = tuple(([f"criterion {task.criterion}"] if task.criterion != "none" else [])
                    + [term.kind.replace("_", " ") for term in task.minimize])  # fmt: skip
    return [state("selection.ranked-by", ranking=ranking, part=part)]


def _failure(found: Solution) -> tuple[Statement, ...]:
    first, *further = [reason.message for reason in found.reasons] or ["no posture fits"]
    name = "no-motion" if found.along_path else "no-placement" if found.of_features else "no-posture"
    said = [state(f"selection.{name}", found.reasons[0].requirement if found.reasons else "", reason=first)]
    said += [state("selection.further-reason", reason=reason) for reason in further]
    said += [state("selection.remedy", change=one.change[:1].upper() + one.change[1:]) for one in found.relaxations[:1]]
    placement = found.placement
    if found.of_features and placement is not None and placement.statistics is not None:
        tried, text = placement.statistics.placements, placement_text(placement.w, placement)
        said.append(state("selection.nearest-placement", tried=tried, placement=text))
    return tuple(said)


def beyond_measured(arm: Arm, Q: Array) -> tuple[Statement, ...]:
    """Each effect that some of the postures Q (N, n) [rad or m] leave the measured range of, each that has one."""
    found = []
    for one in arm.beyond_measured(Q):
        values = np.atleast_2d(Q)[:, one.joint]
        worst = float(values[int(np.argmax(np.maximum(one.low - values, values - one.high)))])
        angles = {"value": worst, "low": one.low, "high": one.high, "size": one.effect.unmeasured_size}
        given = {name: Quantity(angle, "joint angle") for name, angle in angles.items()}
        found.append(state("selection.beyond-measured", one.effect.target, effect=one.effect.title, **given))
    return (*found, *known_ranges(arm))


def known_ranges(arm: Arm) -> tuple[Statement, ...]:
    """The effects that are known only between two values of their joint."""
    return tuple(
        state("selection.known-range", one.effect.target, effect=one.effect.title,
              low=Quantity(one.low, "joint angle"), high=Quantity(one.high, "joint angle"))
        for one in arm.measured_ranges
    )  # fmt: skip


def free_frames(robot: Robot) -> tuple[Statement, ...]:
    """What became of a base or tool that the problem file leaves free."""
    free = {"base": robot.base_free, "tool": robot.tool_free}
    return tuple(state("problem.frame-free", frame) for frame, is_free in free.items() if is_free)


def confirmed(said: Confirmation | None) -> tuple[Statement, ...]:
    """Whether the solver ends at the answer too; empty if it was not asked."""
    if said is None:
        return ()
    if not said.differs:
        name = "confirmed"
    elif math.isnan(said.agrees):
        name = "confirmation-failed"
    else:
        name = f"confirmation-{'better' if said.taken else 'worse'}"
    return (state(f"selection.{name}", iterations=said.iterations, difference=Quantity(said.agrees, "share")),)
