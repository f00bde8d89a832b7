"""Steps of the joints, the best way through candidate postures (Bellman 1957), and where steps leave a path."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from posture_opt.model.compiled import BatchFunction
from posture_opt.numerics import TURN, Array, Codes, Mask
from posture_opt.robot.robot import Robot
from posture_opt.selection.program.nlp import Nlp
from posture_opt.selection.program.task_path import TaskPath, between
from posture_opt.selection.program.task_target import TaskTarget
from posture_opt.selection.search.engine import Engine
from posture_opt.selection.search.inverse_kinematics import TOLERANCE

_ROUNDING = 1e-9
"""Of limits a whole turn apart [rad], and relative of costs that are as good as the best."""


@dataclass(frozen=True)
class JointSteps:
    """Steps of a robot's joints: the largest change of a joint that counts, 1 rad like 1 m."""

    robot: Robot
    counted: Mask  # (n,) joints whose steps count
    wide: Mask  # (n,) joints with a whole turn or more between their limits, compared but for whole turns

    @classmethod
    def of(cls, robot: Robot, nlp: Nlp) -> JointSteps:
        """Steps of a robot whose postures ``nlp`` selects."""
        # A slide whose row in the program is its height alone is settled by it, and moves.
        held = [row.expression for row in nlp.rows if ca.is_equal(row.lower, row.upper, 2)]
        settled = np.any([ca.which_depends(row, nlp.x, 1, False) for row in held] or [[False] * robot.n], axis=0)
        counted = np.array([k not in nlp.indifferent for k in range(robot.n)]) | settled
        span = np.array(robot.upper) - np.array(robot.lower)
        turns = np.array([joint.type == "revolute" for joint in robot.joints])
        alike = np.array([k not in nlp.unlike_turns for k in range(robot.n)])
        return cls(robot, counted, turns & alike & (span >= TURN - _ROUNDING))

    @property
    def _middle(self) -> Array:
        return np.asarray((np.array(self.robot.lower) + np.array(self.robot.upper)) / 2)

    def rested(self, Q: Array) -> Array:
        """Postures (N, n) with joints that matter to nothing in the middle of their limits."""
        return np.where(self.counted, Q, self._middle)

    @property
    def span(self) -> Array:
        """(n,) from limit to limit [rad or m]."""
        return np.asarray(np.array(self.robot.upper) - np.array(self.robot.lower))

    def between(self, A: Array, B: Array, weights: Array | None = None) -> Array:
        """(N, M) largest weighted change of a joint from A (N, n) to B (M, n), the least over whole turns."""
        largest = np.zeros((len(A), len(B)))
        factors = np.ones(len(self.counted)) if weights is None else weights
        for k in np.flatnonzero(self.counted & (factors > 0)):
            difference = B[None, :, k] - A[:, None, k]
            if self.wide[k]:
                difference -= TURN * np.rint(difference / TURN)
            np.maximum(largest, factors[k] * np.abs(difference), out=largest)
        return largest

    def wrapped(self, Q: Array) -> Array:
        """Postures (N, n) with wide joints turned as near to the middle of their limits as can be."""
        return np.where(self.wide, Q - TURN * np.rint((Q - self._middle) / TURN), Q)

    def unwrapped(self, Q: Array) -> tuple[Array, Codes]:
        """A motion (K, n) without jumps by whole turns, and the joints that leave their limits by it."""
        lower, upper = np.array(self.robot.lower), np.array(self.robot.upper)
        turns = np.where(self.wide, np.rint(np.diff(Q, axis=0) / TURN), 0.0)
        Q = Q - TURN * np.vstack([np.zeros((1, Q.shape[1])), np.cumsum(turns, axis=0)])
        # All of a joint's values by the whole turns that bring their middle nearest to that of the limits.
        off = (Q.min(axis=0) + Q.max(axis=0) - lower - upper) / 2
        Q = np.where(self.wide, Q - TURN * np.rint(off / TURN), Q)
        beyond = np.any((lower - _ROUNDING > Q) | (upper + _ROUNDING < Q), axis=0)
        return np.clip(Q, lower, upper) if not np.any(beyond) else Q, np.flatnonzero(beyond)

    def along(self, Q: Array) -> Array:
        """(K − 1,) largest change of a joint between neighbours of a motion (K, n)."""
        moved = np.abs(np.diff(Q, axis=0))[:, self.counted]
        return np.asarray(np.max(moved, axis=1, initial=0.0))

    def swept(self, Q: Array, listed: Mask) -> Array:
        """(L − 1,) largest range swept by a joint of a motion (K, n) between the L listed points."""
        ends = np.flatnonzero(listed)
        counted = Q[:, self.counted]
        if not counted.shape[1]:
            return np.zeros(len(ends) - 1)
        high = np.maximum(np.maximum.reduceat(counted, ends[:-1]), counted[ends[1:]])
        low = np.minimum(np.minimum.reduceat(counted, ends[:-1]), counted[ends[1:]])
        return np.asarray(np.max(high - low, axis=1))

    def whole_turns(self, Q: Array) -> Codes:
        """(n,) nearest number of whole turns that each joint ends a motion (K, n) away from where it began."""
        turns = np.array([joint.type == "revolute" for joint in self.robot.joints])
        return np.where(turns & self.counted, np.rint((Q[-1] - Q[0]) / TURN), 0.0).astype(int)

    def without_turns(self, joints: Mask | Codes) -> JointSteps:
        """Steps with some joints compared as they are, whole turns included."""
        none = np.zeros(len(self.wide), dtype=bool)
        none[joints] = True
        return replace(self, wide=self.wide & ~none)

    def turned(self, Q: Array, values: Array) -> tuple[Array, Array]:
        """Postures (M, n) and values (M,), with those a whole turn away within the limits."""
        lower, upper = np.array(self.robot.lower), np.array(self.robot.upper)
        for k, joint in enumerate(self.robot.joints):
            if joint.type != "revolute" or self.wide[k] or upper[k] - lower[k] < TURN - _ROUNDING:
                continue
            moved = np.vstack([Q + turn * np.eye(len(lower))[k] for turn in (0.0, -TURN, TURN)])
            inside = (moved[:, k] >= lower[k]) & (moved[:, k] <= upper[k])
            inside[: len(Q)] = True
            Q, values = moved[inside], np.tile(values, 3)[inside]
        return Q, values


@dataclass(frozen=True)
class StepGraph:
    """Candidates of K points and the steps between them."""

    postures: Sequence[Array]  # K arrays (N_k, n)
    costs: Sequence[Array]  # K arrays (N_k,)
    distances: Sequence[Array]  # K − 1 arrays (N_k, N_{k+1}): the weighted steps between candidates of neighbours

    @classmethod
    def of(cls, steps: JointSteps, postures: Sequence[Array], costs: Sequence[Array], weights: Array) -> StepGraph:
        """Graph of candidates, steps weighted by (K − 1, n)."""
        pairs = zip(postures, postures[1:], weights, strict=False)
        return cls(postures, costs, [steps.between(A, B, w) for A, B, w in pairs])

    def smallest_step(self) -> tuple[float, Codes]:
        """Least largest step of a way, and its candidates (K,)."""
        value, before = np.zeros(len(self.postures[0])), []
        for D in self.distances:
            reached = np.maximum(value[:, None], D)
            before.append(np.argmin(reached, axis=0))
            value = reached[before[-1], np.arange(D.shape[1])]
        return float(np.min(value)), _followed(before, int(np.argmin(value)))

    def worst_costs(self, largest: float) -> list[Array]:
        """K arrays (N_k,): least largest cost of a way through each candidate, steps up to ``largest``."""
        allowed = [largest * (1 + _ROUNDING) >= D for D in self.distances]
        forth = self._largest_costs(self.costs, allowed)
        back = self._largest_costs(self.costs[::-1], [may.T for may in allowed[::-1]])
        return [np.maximum(f, b) for f, b in zip(forth, back[::-1], strict=True)]

    @staticmethod
    def _largest_costs(costs: Sequence[Array], allowed: Sequence[Mask]) -> list[Array]:
        """K arrays (N_k,): least largest cost up to each candidate."""
        values = [costs[0]]
        for cost, may in zip(costs[1:], allowed, strict=True):
            before = np.min(np.where(may, values[-1][:, None], np.inf), axis=0, initial=np.inf)
            values.append(np.maximum(cost, before))
        return values

    def best_way(self, largest: float, worst: float, through: tuple[int, int] | None = None) -> Codes | None:
        """(K,) candidates of least total cost, none above ``worst``, ``through`` a (point, candidate), if any."""
        costs = [np.where(cost <= worst * (1 + _ROUNDING), cost, np.inf) for cost in self.costs]
        if through is not None:
            point, chosen = through
            costs[point] = np.where(np.arange(len(costs[point])) == chosen, costs[point], np.inf)
        value, before = costs[0], []
        for D, cost in zip(self.distances, costs[1:], strict=True):
            total = np.where(largest * (1 + _ROUNDING) >= D, value[:, None], np.inf)
            before.append(np.argmin(total, axis=0))
            value = total[before[-1], np.arange(D.shape[1])] + cost
        return _followed(before, int(np.argmin(value))) if np.isfinite(np.min(value)) else None

    def motion(self, way: Codes) -> Array:
        """(K, n) postures of a way."""
        return np.array([Q[k] for Q, k in zip(self.postures, way, strict=True)])

    def closed_at(self, start: int) -> StepGraph:
        """Ways that begin and end at candidate ``start`` of the first point, which is the last one too."""
        postures, costs, distances = list(self.postures), list(self.costs), list(self.distances)
        for end in (0, -1):
            postures[end], costs[end] = postures[end][[start]], costs[end][[start]]
        distances[0] = distances[0][[start]]
        distances[-1] = distances[-1][:, [start]]
        return StepGraph(postures, costs, distances)

    def closed_of_smallest_step(self) -> StepGraph:
        """Ways back to the first candidate that has the least largest step; open ways bound it below."""
        bound = np.zeros(len(self.postures[-1]))
        for D in reversed(self.distances):
            bound = np.min(np.maximum(D, bound), axis=1)
        return self._closed_of_least(bound, lambda ways: ways.smallest_step()[0]) or self

    def closed_of_least_cost(self, largest: float) -> StepGraph | None:
        """Ways back to the first candidate of least largest cost, steps up to ``largest``; None without one."""
        bound = self.worst_costs(largest)[0]
        return self._closed_of_least(bound, lambda ways: min(float(cost.min()) for cost in ways.worst_costs(largest)))

    def _closed_of_least(self, bound: Array, value: Callable[[StepGraph], float]) -> StepGraph | None:
        least, best = np.inf, None
        for start in np.argsort(bound, kind="stable")[:24].tolist():
            if bound[start] >= least:
                break
            ways = self.closed_at(start)
            if (found := value(ways)) < least:
                least, best = found, ways
        return best


def _followed(before: Sequence[Codes], last: int) -> Codes:
    """(K,) way that ends at candidate ``last``, from the best predecessors of each."""
    way = [last]
    for back in reversed(before):
        way.append(int(back[way[-1]]))
    return np.array(way[::-1])


def breaks_away(engine: Engine, Q: Array) -> Mask:
    """(K − 1,) whether the tool leaves the line between postures (K, n) by more than half of its length."""
    ways = np.diff(_positions(engine)(Q), axis=0)
    return np.asarray(off_lines(engine, Q) > 0.5 * np.linalg.norm(ways, axis=1))


def _positions(engine: Engine) -> BatchFunction:
    """Postures (N, n) to nominal tool points (N, 3) [m]."""
    at = engine.optimisation_problem.quantities
    return BatchFunction(ca.Function("position", [at.q], [at.position]), compiled=False)


def off_lines(engine: Engine, Q: Array) -> Array:
    """(K − 1,) distance [m] of the tool point from the lines between postures (K, n), joints moving evenly."""
    shares, position = np.linspace(0.0, 1.0, 9)[1:-1], _positions(engine)
    within = Q[:-1, None] + shares[:, None] * (Q[1:] - Q[:-1])[:, None]
    reached, ends = position(within.reshape(-1, Q.shape[1])).reshape(len(Q) - 1, len(shares), 3), position(Q)
    start, way = ends[:-1, None], (ends[1:] - ends[:-1])[:, None]
    along = np.clip(np.sum((reached - start) * way, axis=2) / np.sum(way**2, axis=2), 0.0, 1.0)
    return np.asarray(np.max(np.linalg.norm(reached - start - along[..., None] * way, axis=2), axis=1))


def step_bounds(steps: JointSteps, path: TaskPath, largest: float, speed: float | None) -> Array:
    """(K − 1, n) bound of each joint's step [rad or m], by ``largest`` between listed points and the speed [m/s]."""
    even = largest / np.asarray(path.parts, dtype=float)[:, None]
    even = np.where(steps.span > even, even, np.inf)
    most = even if speed is None else np.minimum(even, speed_bounds(steps, path, speed))
    return np.asarray(np.maximum(most - 1e-9, 1e-12))  # a solver may overstep it, and no joint stands quite still


def speed_bounds(steps: JointSteps, path: TaskPath, speed: float) -> Array:
    """(K − 1, n) motion of each joint at its largest speed between the points, the tool at ``speed`` [m/s]."""
    each = np.diff(path.lengths)[:, None] / speed * np.array(steps.robot.velocities)
    return np.asarray(np.where(np.isnan(each), np.inf, each))


def passes_singularity(engine: Engine, targets: Sequence[TaskTarget], Q: Array, k: int) -> bool:
    """Whether the arm, led on from either end of the step from point k of a motion (K, n), comes near a singularity.

    That is a sensitivity below a tenth of the median along the motion.
    """
    sampled = Q[np.linspace(0, len(Q) - 1, min(len(Q), 40)).astype(int)]
    usual = float(np.median([_sensitivity(engine, q) for q in sampled]))
    a, b = targets[k], targets[k + 1]
    ways = (*_led_between(engine, Q[k], a, b), *_led_between(engine, Q[k + 1], b, a))
    return min(_sensitivity(engine, q) for q in ways) < 0.1 * usual


def _led_between(engine: Engine, q: Array, a: TaskTarget, b: TaskTarget) -> Iterator[Array]:
    """Postures (n,) from target a towards b, each from the one before, as far as they lead."""
    yield q
    for share in (np.arange(1, 24 + 1) / 24).tolist():
        x = (1 - share) * a.lower + share * b.lower
        aim = replace(a, lower=x, upper=x, axis=between(a.axis, b.axis, share))
        moved, errors = engine.ik.solve(q[None], engine.held(aim))
        if errors[0] >= TOLERANCE:
            return
        q = moved[0]
        yield q


def _sensitivity(engine: Engine, q: Array) -> float:
    """Smallest singular value of the held motions [m, and rad times the size of the workspace]."""
    problem = engine.optimisation_problem
    J, reach = np.asarray(problem.arm.jacobian(q), dtype=float), problem.reach
    rows, rank = [reach.directions.T @ J[:3]], reach.directions.shape[1]
    if problem.axis_rows:
        R = np.asarray(problem.arm.pose(q), dtype=float)[:3, :3]
        axis = R @ (np.array(problem.task.tool_axis) / np.linalg.norm(problem.task.tool_axis))
        rows.append(reach.radius * np.cross(J[3:].T, axis).T)
        rank += reach.axis_rank if reach.orients_at_point else 0
    values = np.linalg.svd(np.vstack(rows), compute_uv=False)
    return float(values[min(rank, len(values)) - 1])
