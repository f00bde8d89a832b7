"""What reports say of a path: its points, their postures, and what simpler ways to choose them give."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from posture_opt.errors import listed
from posture_opt.report.page.presenter import problem_of
from posture_opt.report.parts.collision_parts import distance_facts
from posture_opt.report.parts.parts import joint_values, sentence
from posture_opt.report.parts.solution_checks import confirmation_words
from posture_opt.report.parts.task_parts import critical_size
from posture_opt.report.text.blocks import Block, Facts, Summary, Table
from posture_opt.report.text.units_text import angle, count, joint_unit, length, length_unit, percent, place
from posture_opt.units import fixed, joint_text, number

if TYPE_CHECKING:
    from posture_opt.selection.answer.solution import Solution
    from posture_opt.selection.paths.motion import Motion
    from posture_opt.selection.paths.path_breaks import PathBreak

ACROSS = "across the path"
_MAX_POINTS_SHOWN = 8  # points of a path in the report; all of them stand in postures.csv
_MAX_BREAKS = 3  # that the lead describes
_GAIN_TOLERANCE = 5e-4  # of a standard deviation: what no report tells apart
_STATUS = {"optimal": "Best motion along", "feasible": "Best motion found along", "infeasible": "No motion along"}


def path_lead(found: Solution) -> tuple[str, ...]:
    """The largest standard deviation along the path, and how far the joints move."""
    return (
        f"Largest standard deviation {ACROSS}: {critical_size(found.critical)}, "
        f"{point_words(found, found.worst_index)} of {count(len(found.stations), 'point')}.",
        *(
            map(break_words, found.breaks[:_MAX_BREAKS])
            if found.breaks
            else (f"Between listed points, {moved_words(found)}.",)
        ),
        *_closed_words(found),
        *_speed_words(found),
    )


def break_words(one: PathBreak) -> str:
    """Where and why the arm leaves the path."""
    why = "Singular" if one.kind == "singular" else "No motion within limits and clearance"
    return (
        f"{why} between points {one.first} and {one.last}: there {one.joint} moves by "
        f"{joint_text(one.moved, one.unit)}, and the tool leaves the path by up to {length(one.off)}."
    )


def _closed_words(found: Solution) -> list[str]:
    """How a closed path ends."""
    if not found.task.closed:
        return []
    turns = found.law.whole_turns
    if not turns:
        return ["It ends in the posture in which it begins."]
    words = listed([f"{name} by {turn:+d} turn{'s' if abs(turn) > 1 else ''}" for name, turn in turns.items()])
    return [f"It ends in its first posture but for whole turns: {words}. It cannot be repeated without turning back."]


def _speed_words(found: Solution) -> list[str]:
    """The speed along the path, how long it takes, and which joint bounds it."""
    law = found.law
    if law.speed is None:
        return []
    asked, time = found.task.speed is not None, number(float(law.times[-1]))
    bound = "" if law.highest is None else f"; {law.limiting_joint} allows at most {speed_text(law.highest)}"
    if law.stated is not None:
        return [f"At {speed_text(law.stated)} it takes {time} s{bound}."]
    lead = "At the highest" if asked else "Highest possible"
    return [f"{lead} constant speed: {speed_text(law.highest)}, {time} s, limited by {law.limiting_joint}."]


def speed_text(speed: float) -> str:
    """A speed of the tool point in mm/s."""
    return f"{number(speed * 1e3)} mm/s"


def point_words(found: Solution, k: int) -> str:
    """Which point it is: at point 3, or between points 3 and 4."""
    return f"{'at ' if found.path.listed[k] else ''}{found.path.numbers[k]}"


def step_words(found: Solution, step: float) -> str:
    """A bound of steps; a slide may move by 1 m where a joint may turn by 1 rad, if it is that long."""
    joints = found.optimisation_problem.robot.joints
    longest = max((joint.upper - joint.lower for joint in joints if joint.type == "prismatic"), default=0.0)
    return f"{angle(step)}, {length(step)} of a slide" if step < longest else angle(step)


def moved_words(found: Solution) -> str:
    """How far the joints move from point to point."""
    joints = found.optimisation_problem.robot.joints
    moved = np.max(np.abs(np.diff(found.motion.Q[found.path.listed], axis=0)), axis=0)
    turns = [float(v) for v, joint in zip(moved, joints, strict=True) if joint.type == "revolute"]
    slides = [float(v) for v, joint in zip(moved, joints, strict=True) if joint.type == "prismatic"]
    parts = [f"joints turn by at most {angle(max(turns))}"] if turns else []
    parts += [f"slides move by at most {length(max(slides))}"] if slides else []
    return " and ".join(parts)


def path_facts(found: Solution) -> list[tuple[str, str]]:
    """How many points there are, and from where to where they lead."""
    added = len(found.path.listed) - len(found.stations)
    more = f" and {added} added between them" if added else ""
    ends = found.path.points[[0, -1]]
    return [
        ("Path", f"{count(len(found.stations), 'point')}{more}, {length(found.path.lengths[-1], 4)} long"),
        ("", f"from {place(ends[0])} to {place(ends[1])}"),
    ]


def path_workpiece(found: Solution) -> list[tuple[str, str]]:
    """Where the workpiece stands, and what placing it brought."""
    if found.placement is None:
        return []
    x, y, z, yaw = found.placement.w.tolist()
    rows = [("Workpiece", f"{place((x, y, z))}, rotated by {fixed(math.degrees(yaw))} deg about z")]
    if found.central > 0:
        gain = percent(max(found.gain_over(found.central), 0.0))
        rows.append(("", f"{gain} lower standard deviation than at the centre of its ranges ({length(found.central)})"))
    return rows


def points_block(found: Solution) -> Block:
    """The postures of some points, evenly along the path, and of the listed point with the largest spread."""
    robot, listed = found.optimisation_problem.robot, np.flatnonzero(found.path.listed)
    even = np.linspace(0, len(listed) - 1, min(_MAX_POINTS_SHOWN, len(listed))).round().astype(int)
    shown = listed[np.union1d(even, np.argmax(found.motion.sigma[listed]))]
    unit, factor = length_unit(found.motion.sigma.tolist())
    heads = ["point", f"std. dev. [{unit}]", *(f"{c} [mm]" for c in "xyz")]
    heads += [f"{joint.name} [{joint_unit(joint.type)[0]}]" for joint in robot.joints]
    rows = []
    for k in shown:
        q = [fixed(v * joint_unit(j.type)[1], 1) for v, j in zip(found.motion.Q[k], robot.joints, strict=True)]
        xyz = [fixed(1e3 * float(v), 1) for v in found.path.points[k]]
        number_of = str(int(np.searchsorted(listed, k)) + 1)
        rows.append((number_of, number(factor * float(found.motion.sigma[k])), *xyz, *q))
    views = tuple(f"point-{row[0]}" for row in rows)
    table = Table(tuple(heads), tuple(rows), 0, views, worst=int(np.argmax(found.motion.sigma[shown])))
    left = len(found.path.points) - len(shown)
    text = (f"{count(left, 'further point')} in postures.csv.",) if left else ()
    return Block("Postures along the path", (table, *text), figure="path")


def path_checks(found: Solution) -> Block:
    """What simpler ways give, the lower bound, the steps, and what the search did."""
    sigma, motion = float(found.motion.sigma.max()), found.motion
    divided = "" if np.all(found.path.listed) else "; added points divide it evenly"
    rows = [*_naive_rows(found)]
    if found.bound > 0:
        where = " with the workpiece here" if math.isfinite(found.central) else ""
        bound = f"{length(found.bound)} for any motion{where}, from the best posture of the worst point alone"
        rows.append(("Lower bound", f"{bound}; {_above(sigma, found.bound)}"))
    rows.append(("Steps", f"the smallest possible maximum found is {step_words(found, found.smallest_step)}{divided}"))
    rows += distance_facts(problem_of(found).scene, found.clearance)
    rows.append(("Between points", f"the tool deviates from the straight line by up to {length(found.off_line)}"))
    rows.append(("", "if all joints are interpolated linearly between the points of postures.csv" + _finer(found)))
    compared = f"{sum(found.candidates)} candidate postures of {count(len(found.candidates), 'point')}"
    proof = "a local optimum" if motion.optimal else "not confirmed as a local optimum"
    rows.append(("Search", f"dynamic programming over {compared}, then one optimisation over all points"))
    rows.append(("", f"the result is {proof}, the best of these searches"))
    if found.confirmation is not None:
        rows.append(("", confirmation_words(found.confirmation)))
    rows.append(("Time", f"{found.seconds:.2f} s"))
    return Block("Checks", (Facts(tuple(rows)),))


def _finer(found: Solution) -> str:
    """What keeps the tool on the line as well as its scatter does; the way off it goes with the distance squared."""
    ratio = found.off_line / float(found.motion.sigma.max())
    if ratio <= 1 or found.breaks:
        return ""
    gap = float(np.diff(found.path.lengths).max())
    return f"; spacing: {number(1e3 * gap / ratio**0.5, 1)} mm would keep the deviation below one standard deviation"


def _above(sigma: float, bound: float) -> str:
    """How far the motion is from its lower bound."""
    return f"this motion is {percent(sigma / bound - 1)} above" if sigma > bound * (1 + _GAIN_TOLERANCE) else "attained"


def _naive_rows(found: Solution) -> list[tuple[str, str]]:
    """What each point alone gives, and following the first without look-ahead."""
    each, onward = found.naive.each, found.naive.onward
    alone = f"{length(float(each.sigma.max()))} at the worst point, with joint jumps of {angle(each.largest_step)}"
    if onward is None:
        reached = count(found.naive.reached, "point")
        follow = f"reaches a limit after {reached}"
    else:
        follow = f"{_gain(found, onward)}, with steps up to {angle(onward.largest_step)}"
    return [
        ("Independent points", alone),
        ("No look-ahead", f"following the best posture of the first point {follow}"),
    ]


def _gain(found: Solution, other: Motion) -> str:
    """The spread of another motion, and how much lower this one's is."""
    sigma = float(other.sigma.max())
    gain = found.gain_over(sigma)
    if abs(gain) < _GAIN_TOLERANCE:
        return f"gives the same {length(sigma)}"
    return f"gives {length(sigma)}; this motion is {percent(abs(gain))} {'lower' if gain > 0 else 'higher'}"


def path_columns(found: Solution) -> dict[str, list[float]]:
    """One row a point, listed or added: where it is, the posture, its scatter."""
    robot, motion = found.optimisation_problem.robot, found.motion
    points = {f"{c} [mm]": (1e3 * found.path.points[:, k]).tolist() for k, c in enumerate("xyz")}
    joints = [(joint.name, *joint_unit(joint.type)) for joint in robot.joints]
    return {
        **points,
        "listed": [int(v) for v in found.path.listed],
        f"sigma {ACROSS} [mm]": (1e3 * motion.sigma).tolist(),
        **({} if found.law.times is None else {"time [s]": found.law.times.tolist()}),
        **{f"{name} [{unit}]": (factor * motion.Q[:, k]).tolist() for k, (name, unit, factor) in enumerate(joints)},
    }


def path_summary(found: Solution) -> Summary:
    """How many points there are, the largest standard deviation, and how far the joints move."""
    sigma = float(found.motion.sigma.max())
    facts: tuple[tuple[str, str], ...] = (
        ("Points", f"{len(found.stations)}, {length(found.path.lengths[-1], 4)} long"),
        ("Standard deviation", f"at most {length(sigma)} {ACROSS}"),
        ("Steps", moved_words(found)),
        ("First posture", joint_values(found.problem, found.motion.Q[0])),
    )
    if found.reasons:
        facts = (facts[0], ("Why", sentence(found.reasons[0].message)))
    asked = found.problem.name or found.optimisation_problem.task.kind
    return Summary(f"{_STATUS[found.status]} the path of: {asked}", facts)
