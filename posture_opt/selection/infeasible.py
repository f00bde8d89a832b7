"""Why nothing is feasible: out of reach by how much, which limit, which tilt – and the posture that comes nearest.

Only asked when thousands of restarts of the feasibility search found nothing. Requirements are relaxed one at a
time: position within the limits, the same without limits, position and axis without limits; the first relaxation
that helps names the culprit, and a small optimisation problem measures by how much it fails.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from posture_opt.numerics import Array
from posture_opt.robot.robot import Robot
from posture_opt.selection.engine import Engine
from posture_opt.selection.inverse_kinematics import ROW_TOLERANCE, TOLERANCE, InverseKinematics, unlimited
from posture_opt.selection.multistart import MultistartResult
from posture_opt.selection.nlp import IPOPT_OPTIONS, Row
from posture_opt.selection.optimisation_problem import OptimisationProblem
from posture_opt.selection.pose_request import PoseRequest
from posture_opt.selection.search_statistics import SearchStatistics
from posture_opt.selection.solution import HasTask, Reason, Solution
from posture_opt.selection.task_target import TaskTarget

_STARTS = 200  # postures of each relaxed problem: so many that of a reachable target some arrive
_REFINED = 8  # of them, those that the solver improves


def explain_infeasibility(engine: Engine, found: MultistartResult) -> tuple[Array, list[Reason]]:
    """The posture (n,) that comes nearest, and why it does not do; no reason where it does after all."""
    return _Infeasibility(engine, found.target).answer(found)


def infeasible(
    problem: HasTask, engine: Engine, found: MultistartResult, q: Array, reasons: Sequence[Reason], seconds: float
) -> Solution:
    """The infeasible solution: nearest posture, and the reasons in words."""
    counts = (found.arrived, found.tried, found.polished, 0, 0, 0)
    statistics = SearchStatistics(*counts, found.sampled, None, math.nan, found.batches, 0, seconds)
    asked, target = engine.optimisation_problem, found.target
    notes = (*problem.notes, asked.axis_note(target))
    return Solution(problem, asked, target, "infeasible", q, statistics, lambda: (), notes, tuple(reasons))


@dataclass(frozen=True)
class _Infeasibility:
    engine: Engine
    target: TaskTarget

    @property
    def robot(self) -> Robot:
        return self.engine.robot

    @property
    def problem(self) -> OptimisationProblem:
        return self.engine.optimisation_problem

    def answer(self, found: MultistartResult) -> tuple[Array, list[Reason]]:
        if found.found:
            return self._row(np.array([candidate.q for candidate in found.found]))
        plane = self._plane()
        if plane is not None:
            return self._nearest()[0], [plane]
        limited = self.engine.ik
        free = self._unlimited()
        if not len(self._reached(limited, with_axis=False)):
            Q = self._reached(free, with_axis=False)
            return self._limits(Q, with_axis=False) if len(Q) else self._out_of_reach()
        Q = self._reached(free, with_axis=True)
        if len(Q):
            return self._limits(Q, with_axis=True)
        return self._tilt(self._reached(limited, with_axis=False))

    def _row(self, starts: Array) -> tuple[Array, list[Reason]]:
        """Target and axis can be met; which further requirement cannot, and by how much at least."""
        nlp = self.problem.nlp
        required, further = self._rows("target", "tool_axis"), [r for r in nlp.rows if not _is_target(r)]
        beyond = [ca.fmax(ca.fmax(r.lower - r.expression, r.expression - r.upper), 0) for r in further]
        lo, hi = nlp.variable_bounds
        q = self._least(ca.sumsqr(ca.vertcat(*beyond)), starts[:_REFINED], lo, hi, required)
        at = ca.Function("rows", [nlp.x, nlp.p], [ca.vertcat(*beyond), ca.vertcat(*(r.expression for r in further))])
        missing, values = (np.asarray(v).ravel() for v in at(q, self.target.parameters))
        k = int(np.argmax(missing))
        if missing[k] < ROW_TOLERANCE:
            return q, []
        row, amount = further[k], float(missing[k])
        message = (
            f"{row.name} comes no nearer than {_amount(values[k], row.unit)} while target and tool axis are met; "
            f"{_amount(amount, row.unit)} are missing"
        )
        return q, [Reason(row.name, message, amount, row.unit)]

    def _plane(self) -> Reason | None:
        reach, target = self.problem.reach, self.target
        if not reach.misses(target.lower, target.upper):
            return None
        shift = reach.outside(target.lower, target.upper)
        distance = float(np.linalg.norm(shift))
        message = (
            f"the target lies {distance * 1e3:.4g} mm outside the plane that this arm moves in: "
            f"move it by {_millimetres(shift)}"
        )
        return Reason("target", message, distance, "m")

    def _unlimited(self) -> InverseKinematics:
        task, reach = self.problem.task, self.problem.reach
        return InverseKinematics(unlimited(self.problem.arm), task.tool_axis, reach.directions, self.engine.compiled)

    def _reached(self, ik: InverseKinematics, with_axis: bool) -> Array:
        """(k, n) postures on the target, with or without the tool axis along the direction."""
        rng = np.random.default_rng(1)
        request = self.engine.request(self.target, _STARTS, rng, whole_box=True)
        if not with_axis:
            request = replace(request, weights=request.weights * np.array([1.0, 0.0, 0.0]))
        Q, errors = ik.solve(ik.random_postures(_STARTS, rng), request, enough=_STARTS // 4)
        return np.asarray(Q[errors < TOLERANCE])

    def _out_of_reach(self) -> tuple[Array, list[Reason]]:
        q, point = self._nearest()
        gap = np.clip(point, self.target.lower, self.target.upper) - point
        distance = float(np.linalg.norm(gap))
        if distance < ROW_TOLERANCE:
            return self._tilt(q[None])
        message = (
            f"the target is out of reach by {distance * 1e3:.4g} mm; the nearest point that the tool reaches is "
            f"{_millimetres(point)}: move the target by {_millimetres(-gap)}"
        )
        return q, [Reason("target", message, distance, "m")]

    def _nearest(self) -> tuple[Array, Array]:
        """The posture within the limits whose tool point is nearest to the target, and that point."""
        at, p = self.problem.quantities, self.problem.nlp.p
        lower, upper = ca.DM(self.target.lower), ca.DM(self.target.upper)
        gap = ca.fmax(lower - at.position, 0) + ca.fmax(at.position - upper, 0)
        start = self.engine.ik.random_postures(_REFINED, np.random.default_rng(2))
        middle = PoseRequest(
            (self.target.lower + self.target.upper) / 2, np.zeros(3), np.zeros(3), np.array([1.0, 0, 0])
        )
        start, _ = self.engine.ik.solve(start, middle)
        lo, hi = self.problem.nlp.variable_bounds
        q = self._least(ca.sumsqr(gap), start, lo, hi, [])
        return q, np.asarray(ca.Function("x", [at.q, p], [at.position])(q, self.target.parameters)).ravel()

    def _limits(self, starts: Array, with_axis: bool) -> tuple[Array, list[Reason]]:
        """Without limits it would work: which limits are in the way, and by how much at least."""
        nlp = self.problem.nlp
        lower, upper = (ca.DM(bound) for bound in nlp.variable_bounds)
        excess = ca.fmax(lower - nlp.x, 0) + ca.fmax(nlp.x - upper, 0)
        rows = self._rows("target", "tool_axis") if with_axis else self._rows("target")
        span = np.full(self.robot.n, 4 * math.pi)
        beyond = np.maximum(np.asarray(lower).ravel() - starts, starts - np.asarray(upper).ravel()).clip(0)
        starts = starts[np.argsort(np.linalg.norm(beyond, axis=1))]
        q = self._least(ca.sumsqr(excess), starts[:_REFINED], -span, span, rows)
        reasons = []
        for k, joint in enumerate(self.robot.joints):
            amount = max(joint.lower - q[k], q[k] - joint.upper, 0.0)
            if amount > 1e-5:
                unit = "rad" if joint.type == "revolute" else "m"
                bound = joint.lower if q[k] < joint.lower else joint.upper
                what = "target and tool axis" if with_axis and self.problem.axis_rows else "target"
                message = (
                    f"{joint.name} would have to go to {_amount(q[k], unit)}, {_amount(amount, unit)} beyond its limit "
                    f"{_amount(bound, unit)}, to meet the {what}"
                )
                reasons.append(Reason(f"{joint.name}.limits", message, float(amount), unit))
        if reasons or with_axis:
            return q, reasons
        return self._tilt(q[None])

    def _tilt(self, starts: Array) -> tuple[Array, list[Reason]]:
        """The target is reached, but not with the tool axis along the direction: the least tilt that would do."""
        at, nlp = self.problem.quantities, self.problem.nlp
        cosine = ca.dot(ca.DM(self.target.axis), at.axis)
        order = np.argsort(-np.asarray(ca.Function("c", [nlp.x], [cosine]).map(len(starts))(starts.T)).ravel())
        lo, hi = nlp.variable_bounds
        q = self._least(-cosine, starts[order[:_REFINED]], lo, hi, self._rows("target"))
        reached = float(ca.Function("c", [nlp.x], [cosine])(q))
        tilt = math.acos(min(1.0, max(-1.0, reached)))
        if not self.problem.axis_rows or tilt <= self.target.tilt + ROW_TOLERANCE:
            return q, []
        message = (
            f"at this target the tool axis comes no closer than {math.degrees(tilt):.3g} deg to the direction, and "
            f"{math.degrees(self.target.tilt):.3g} deg are allowed; "
            f"set tilt: {math.ceil(math.degrees(tilt) * 10) / 10:g} deg, or move the target"
        )
        return q, [Reason("tool_axis", message, tilt - self.target.tilt, "rad")]

    def _rows(self, *names: str) -> list[Row]:
        return [row for row in self.problem.nlp.rows if row.name.split(".")[0] in names]

    def _least(self, objective: ca.SX, starts: Array, lower: Array, upper: Array, rows: Sequence[Row]) -> Array:
        """The least of an objective (n,) that IPOPT finds under ``rows``; a start itself where it finds none.

        With as many equalities as joints the starts are all there is, and IPOPT would refuse the problem.
        """
        nlp, p = self.problem.nlp, self.target.parameters
        empty = ca.SX(0, 1)
        g = ca.vertcat(empty, *(row.expression for row in rows))
        ends = [ca.vertcat(empty, *(row.lower for row in rows)), ca.vertcat(empty, *(row.upper for row in rows))]
        low, high = (np.asarray(end).ravel() for end in ca.Function("bounds", [nlp.p], ends)(p))
        objective, g = (ca.substitute(e, nlp.p, ca.DM(p)) for e in (objective, g))
        if np.count_nonzero(low == high) >= starts.shape[1]:
            # Nothing is left to choose but between the postures that meet the rows: the starts.
            value = ca.Function("value", [nlp.x], [objective])
            return np.asarray(min(starts, key=lambda start: float(value(start))))
        options = {**IPOPT_OPTIONS, "ipopt.max_iter": 300}
        solver = ca.nlpsol("least", "ipopt", {"x": nlp.x, "f": objective, "g": g}, options)
        answers = []
        for start in starts:
            found = solver(x0=start, lbx=lower, ubx=upper, lbg=low, ubg=high)
            if solver.stats()["success"]:
                answers.append((float(found["f"]), np.asarray(found["x"]).ravel()))
        return min(answers, key=lambda a: a[0])[1] if answers else np.asarray(starts[0])


def _is_target(row: Row) -> bool:
    return row.name.split(".")[0] in ("target", "tool_axis")


def _amount(value: float, unit: str) -> str:
    if unit == "rad":
        return f"{math.degrees(value):.4g} deg"
    return f"{value * 1e3:.4g} mm" if unit == "m" else f"{value:.4g} {unit}"


def _millimetres(vector: Array) -> str:
    return "(" + ", ".join(f"{round(v * 1e3, 1) + 0.0:.1f}" for v in vector) + ") mm"
