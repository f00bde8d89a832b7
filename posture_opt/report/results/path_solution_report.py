"""The report on a path: the worst point and its spread, the postures of all points, how sure one may be of them."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from posture_opt.report.figures.arm import plot_motion
from posture_opt.report.figures.path import plot_path
from posture_opt.report.figures.solution import plot_task_budget
from posture_opt.report.interactive.arm_view import ArmView
from posture_opt.report.interactive.solution_postures import solution_postures
from posture_opt.report.page.presenter import Columns, Drawings, Presenter, problem_of
from posture_opt.report.parts.collision_parts import collision_facts, distance_facts
from posture_opt.report.parts.improvement_parts import improvements_block
from posture_opt.report.parts.parts import (
    frame_notes,
    input_facts,
    joint_values,
    note_facts,
    robot_facts,
    sentence,
    source_facts,
)
from posture_opt.report.parts.solution_checks import explain_report
from posture_opt.report.parts.task_parts import critical_size, task_budget_block
from posture_opt.report.results.solution_report import posture_block, spread_block
from posture_opt.report.results.target_map_report import map_csv
from posture_opt.report.text.blocks import Block, Facts, Report, Summary, Table
from posture_opt.report.text.text import render
from posture_opt.report.text.units_text import angle, count, joint_unit, length, length_unit, percent, place
from posture_opt.report.text.words import CRITERIA
from posture_opt.uncertainty.spread.joint_digits import joint_digits
from posture_opt.units import fixed, number

if TYPE_CHECKING:
    from posture_opt.report.page.save import Files
    from posture_opt.selection.paths.motion import Motion
    from posture_opt.selection.paths.path_solution import PathSolution

ACROSS = "across the path"
_SHOWN = 8  # points of a path in the report; all of them stand in postures.csv
_SAME = 5e-4  # of a standard deviation: what no report tells apart
_STATUS = {"optimal": "Best motion along", "feasible": "Best motion found along", "infeasible": "No motion along"}


def path_report(found: PathSolution) -> Report:
    """The blocks of a motion, or those of a failure: why, and the motion of least largest step."""
    title = found.problem.name or "Postures along a path"
    if found.status == "infeasible":
        why = Block("Why", tuple(sentence(reason.message) for reason in found.reasons))
        return Report(
            title, ("No motion along this path meets the requirements.",), (why, _problem(found), _points(found))
        )
    worst = found.worst
    problem = problem_of(found)
    at_worst = posture_block(worst)
    name = f"Posture {_where(found, found.worst_index)}, where the standard deviation is largest"
    blocks = (
        _problem(found),
        _points(found),
        Block(name, at_worst.items, figure="arm"),
        spread_block(worst),
        task_budget_block(problem, worst.task_spread),
        improvements_block(problem, found.improvements, ACROSS),
        _checks(found),
    )
    return Report(title, _lead(found), tuple(block for block in blocks if block.items))


def _lead(found: PathSolution) -> tuple[str, ...]:
    return (
        f"Largest standard deviation {ACROSS}: {critical_size(found.critical)}, "
        f"{_where(found, found.worst_index)} of {count(len(found.stations), 'point')}.",
        *(found.jumps or (f"Between listed points, {_moved(found)}.",)),
    )


def _where(found: PathSolution, k: int) -> str:
    return f"{'at ' if found.path.listed[k] else ''}{found.path.numbers[k]}"


def _step(found: PathSolution, step: float) -> str:
    """A bound of steps; a slide may move by 1 m where a joint may turn by 1 rad."""
    slides = any(joint.type == "prismatic" for joint in found.optimisation_problem.robot.joints)
    return f"{angle(step)}, {length(step)} of a slide" if slides else angle(step)


def _moved(found: PathSolution) -> str:
    """How far the joints move from point to point."""
    joints = found.optimisation_problem.robot.joints
    moved = np.max(np.abs(np.diff(found.motion.Q[found.path.listed], axis=0)), axis=0)
    turns = [float(v) for v, joint in zip(moved, joints, strict=True) if joint.type == "revolute"]
    slides = [float(v) for v, joint in zip(moved, joints, strict=True) if joint.type == "prismatic"]
    parts = [f"joints turn by at most {angle(max(turns))}"] if turns else []
    parts += [f"slides move by at most {length(max(slides))}"] if slides else []
    return " and ".join(parts)


def _problem(found: PathSolution) -> Block:
    problem, task = problem_of(found), found.optimisation_problem.task
    rows = [
        *robot_facts(problem),
        ("Task", f"{task.kind} - {task.summary}"),
        *_path_facts(found),
        *_workpiece(found),
        ("Minimised", f"at the worst point, {CRITERIA[task.criterion].format(part=ACROSS)}"),
        ("Joint steps", f"between listed points: at most {_step(found, found.largest_step)}"),
        *input_facts(problem),
        *collision_facts(problem.scene),
        *source_facts(problem),
        *note_facts((*problem.notes, *frame_notes(problem.robot), *found.notes)),
    ]
    notes = note_facts((*problem.notes, *found.notes))
    short = (robot_facts(problem)[0], ("Task", task.kind), *_path_facts(found), *source_facts(problem), *notes)
    return Block("Problem", (Facts(tuple(rows)),), brief=(Facts(short),))


def _path_facts(found: PathSolution) -> list[tuple[str, str]]:
    """How many points there are, and from where to where they lead."""
    added = len(found.path.listed) - len(found.stations)
    more = f" and {added} added between them" if added else ""
    ends = found.path.points[[0, -1]]
    return [
        ("Path", f"{count(len(found.stations), 'point')}{more}, {length(found.path.lengths[-1], 4)} long"),
        ("", f"from {place(ends[0])} to {place(ends[1])}"),
    ]


def _workpiece(found: PathSolution) -> list[tuple[str, str]]:
    """Where the workpiece stands, and what placing it brought."""
    if not found.on_workpiece:
        return []
    x, y, z, yaw = found.placement.tolist()
    rows = [("Workpiece", f"{place((x, y, z))}, rotated by {fixed(math.degrees(yaw))} deg about z")]
    if found.central > 0:
        gain = percent(max(found.gain_over(found.central), 0.0))
        rows.append(("", f"{gain} lower standard deviation than at the centre of its ranges ({length(found.central)})"))
    return rows


def _points(found: PathSolution) -> Block:
    robot, listed = found.optimisation_problem.robot, np.flatnonzero(found.path.listed)
    shown = listed[np.unique(np.linspace(0, len(listed) - 1, min(_SHOWN, len(listed))).round().astype(int))]
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
    table = Table(tuple(heads), tuple(rows), 0, views)
    left = len(found.path.points) - len(shown)
    text = (f"{count(left, 'further point')} in postures.csv.",) if left else ()
    return Block("Postures along the path", (table, *text), figure="path")


def _checks(found: PathSolution) -> Block:
    sigma, motion = float(found.motion.sigma.max()), found.motion
    divided = "" if np.all(found.path.listed) else "; added points divide it evenly"
    rows = [*_naive_rows(found)]
    if found.bound > 0:
        where = " with the workpiece here" if math.isfinite(found.central) else ""
        bound = f"{length(found.bound)} for any motion{where}, from the best posture of the worst point alone"
        rows.append(("Lower bound", f"{bound}; {_above(sigma, found.bound)}"))
    rows.append(("Steps", f"the smallest possible maximum found is {_step(found, found.smallest_step)}{divided}"))
    rows += distance_facts(problem_of(found).scene, found.clearance)
    rows.append(("Between points", f"the tool deviates from the straight line by up to {length(found.off_line)}"))
    rows.append(("", "if all joints are interpolated linearly between the points of postures.csv" + _finer(found)))
    compared = f"{sum(found.candidates)} candidate postures of {count(len(found.candidates), 'point')}"
    proof = "a local optimum" if motion.optimal else "not confirmed as a local optimum"
    rows.append(("Search", f"dynamic programming over {compared}, then one optimisation over all points"))
    rows.append(("", f"the result is {proof}, the best of these searches"))
    rows.append(("Time", f"{found.seconds:.2f} s"))
    return Block("Checks", (Facts(tuple(rows)),))


def _finer(found: PathSolution) -> str:
    """What keeps the tool on the line as well as its scatter does; the way off it goes with the distance squared."""
    ratio = found.off_line / float(found.motion.sigma.max())
    if ratio <= 1 or found.jumps:
        return ""
    gap = float(np.diff(found.path.lengths).max())
    return f"; spacing: {number(1e3 * gap / ratio**0.5, 1)} mm would keep the deviation below one standard deviation"


def _above(sigma: float, bound: float) -> str:
    return f"this motion is {percent(sigma / bound - 1)} above" if sigma > bound * (1 + _SAME) else "attained"


def _naive_rows(found: PathSolution) -> list[tuple[str, str]]:
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


def _gain(found: PathSolution, other: Motion) -> str:
    sigma = float(other.sigma.max())
    gain = found.gain_over(sigma)
    if abs(gain) < _SAME:
        return f"gives the same {length(sigma)}"
    return f"gives {length(sigma)}; this motion is {percent(abs(gain))} {'lower' if gain > 0 else 'higher'}"


def _columns(found: PathSolution) -> dict[str, list[float]]:
    """One row a point, listed or added: where it is, the posture, its scatter."""
    robot, motion = found.optimisation_problem.robot, found.motion
    points = {f"{c} [mm]": (1e3 * found.path.points[:, k]).tolist() for k, c in enumerate("xyz")}
    joints = [(joint.name, *joint_unit(joint.type)) for joint in robot.joints]
    return {
        **points,
        "listed": [int(v) for v in found.path.listed],
        f"sigma {ACROSS} [mm]": (1e3 * motion.sigma).tolist(),
        **{f"{name} [{unit}]": (factor * motion.Q[:, k]).tolist() for k, (name, unit, factor) in enumerate(joints)},
    }


class PathSolutionPresenter(Presenter["PathSolution"]):
    """The postures along a path."""

    document = "solution"
    delivers: ClassVar[tuple[str, ...]] = ("postures.csv",)

    def summary(self) -> Summary:
        found = self.result
        sigma = float(found.motion.sigma.max())
        facts: tuple[tuple[str, str], ...] = (
            ("Points", f"{len(found.stations)}, {length(found.path.lengths[-1], 4)} long"),
            ("Standard deviation", f"at most {length(sigma)} {ACROSS}"),
            ("Steps", _moved(found)),
            ("First posture", joint_values(found.problem, found.motion.Q[0])),
        )
        if found.reasons:
            facts = (facts[0], ("Why", sentence(found.reasons[0].message)))
        asked = found.problem.name or found.optimisation_problem.task.kind
        return Summary(f"{_STATUS[found.status]} the path of: {asked}", facts)

    def report(self) -> Report:
        return path_report(self.result)

    def drawings(self) -> Drawings:
        """Spread and joints along the path; the arm at its worst point and at others."""
        found = self.result
        return {
            "path": partial(plot_path, found),
            "arm": partial(plot_motion, found),
            "budget": partial(plot_task_budget, found.worst.spread, found.worst.task_spread),
        }

    def view(self) -> ArmView:
        """The listed points of the path, coloured by their scatter."""
        found = self.result
        unit, factor = length_unit([float(s) for s in found.motion.sigma])
        names = [f"point {k}" for k in range(1, len(found.stations) + 1)]
        postures = tuple(
            replace(posture, value=round(factor * station.critical.sigma_max, 5))
            for posture, station in zip(solution_postures(found.stations, names, "point"), found.stations, strict=True)
        )
        robot, scene, values = found.optimisation_problem.robot, found.problem.scene, f"standard deviation [{unit}]"
        return ArmView(robot, postures, "Point of the path", scene, points=True, line=True, values=values)

    def columns(self) -> Columns:
        return _columns(self.result)

    def files(self) -> Files:
        return {"postures.csv": postures_csv(self.result)}

    def explain(self) -> str:
        """The optimisation problem of the worst point with its values there."""
        return render(explain_report(self.result.worst))


def postures_csv(found: PathSolution) -> bytes:
    """All points of the path as a file: places to 0.1 µm, joints as finely as rounding asks for, scatter to six."""
    joints, digits = found.optimisation_problem.robot.joints, joint_digits(found.problem, found.motion.Q)
    decimals = max(6, *(digits.decimals(joint, 1 / joint_unit(joint.type)[1]) for joint in joints))
    return map_csv(_columns(found), len(joints), decimals).encode()
