"""What reports say of a path: its points, their postures, and what simpler ways to choose them give."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from posture_opt.report.parts.collision_parts import distance_facts
from posture_opt.report.parts.parts import joint_values
from posture_opt.report.parts.posture_parts import compared_table
from posture_opt.report.text.blocks import Block, Facts, Table
from posture_opt.selection.answer.solution_statements import ACROSS_PATH
from posture_opt.statements.notation import angle, joint_unit, length, length_unit, place
from posture_opt.units import fixed, number

if TYPE_CHECKING:
    from posture_opt.selection.answer.solution import Solution

_MAX_POINTS_SHOWN = 8  # points of a path in the report; all of them stand in postures.csv


def step_text(found: Solution, step: float) -> str:
    """A bound of steps; a slide may move by 1 m where a joint may turn by 1 rad, if it is that long."""
    joints = found.optimisation_problem.robot.joints
    longest = max((joint.upper - joint.lower for joint in joints if joint.type == "prismatic"), default=0.0)
    return f"{angle(step)}, {length(step)} of a slide" if step < longest else angle(step)


def path_facts(found: Solution) -> list[tuple[str, str]]:
    """Size and ends of the path, its workpiece, and the steps that are allowed."""
    added = len(found.path.listed) - len(found.stations)
    start, end = (place(found.path.points[k]) for k in (0, -1))
    size = f"{len(found.stations)} points, {length(found.path.lengths[-1], 4)} long, from {start} to {end}"
    rows = [("Path", f"{size}; {added} points added" if added else size)]
    if found.placement is not None:
        x, y, z, yaw = found.placement.w.tolist()
        rows.append(("Workpiece", f"{place((x, y, z))}, rotated by {fixed(math.degrees(yaw))} deg about z"))
    return [*rows, ("Joint steps", f"at most {step_text(found, found.largest_step)} between listed points")]


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
    more = (Facts((("More points", f"{left} in postures.csv"),)),) if left else ()
    return Block("Postures along the path", (table, *more), figure="path")


def path_checks(found: Solution) -> Block:
    """What simpler ways give, the lower bound, the steps, and what the search did."""
    sigma, naive, motion = float(found.motion.sigma.max()), found.naive, found.motion
    others = [
        ("each point alone (joints jump)", float(naive.each.sigma.max())),
        ("following the first posture", math.nan if naive.onward is None else float(naive.onward.sigma.max())),
        ("workpiece at the centre of its ranges", found.central),
        ("lower bound (best posture of the worst point)", found.bound if found.bound > 0 else math.nan),
    ]
    onward = f"ends at a limit after {naive.reached} points"
    rows = (
        *([("Following the first", onward)] if naive.onward is None else []),
        ("Smallest step", f"{step_text(found, found.smallest_step)}; {angle(naive.each.largest_step)} each alone"),
        *distance_facts(found.problem.scene, found.clearance),
        ("Off the line", f"up to {length(found.off_line)} with joints interpolated linearly between points"),
        ("Search", f"dynamic programming over {sum(found.candidates)} postures of {len(found.candidates)} points, then "
                   f"one optimisation ({'a local optimum' if motion.optimal else 'not confirmed as an optimum'})"),
        ("Time", f"{found.seconds:.2f} s"),
    )  # fmt: skip
    table = compared_table(sigma, others, length_unit(found.motion.sigma.tolist()))
    return Block("Checks", (*table, Facts(rows)), brief=())


def path_columns(found: Solution) -> dict[str, list[float]]:
    """One row a point, listed or added: where it is, the posture, its scatter."""
    robot, motion = found.optimisation_problem.robot, found.motion
    points = {f"{c} [mm]": (1e3 * found.path.points[:, k]).tolist() for k, c in enumerate("xyz")}
    joints = [(joint.name, *joint_unit(joint.type)) for joint in robot.joints]
    return {
        **points,
        "listed": [int(v) for v in found.path.listed],
        f"sigma {ACROSS_PATH} [mm]": (1e3 * motion.sigma).tolist(),
        **({} if found.law.times is None else {"time [s]": found.law.times.tolist()}),
        **{f"{name} [{unit}]": (factor * motion.Q[:, k]).tolist() for k, (name, unit, factor) in enumerate(joints)},
    }


def path_figures(found: Solution) -> list[tuple[str, str]]:
    """Size of the path, largest standard deviation and step, first posture."""
    return [
        ("Points", f"{len(found.stations)}, {length(found.path.lengths[-1], 4)} long"),
        ("Standard deviation", f"at most {length(float(found.motion.sigma.max()))} {ACROSS_PATH}"),
        ("First posture", joint_values(found.problem, found.motion.Q[0])),
    ]
