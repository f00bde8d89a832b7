"""Why nothing is feasible, and what would help: which requirement is in the way, and by how little it must give.

Only asked when restarts of the search found nothing. Each requirement gives alone, as little as it can, while all the
others are met; where none suffices alone, terms and obstacles give together, and then everything. The reason that is
reported is the most particular one: a term or an obstacle before a limit, a limit before the tool axis, the target
last.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from posture_opt.numerics import Array
from posture_opt.selection.answer.solution import Solution
from posture_opt.selection.problem_data import ProblemData
from posture_opt.selection.program.optimisation_problem import OptimisationProblem
from posture_opt.selection.program.task_target import TaskTarget
from posture_opt.selection.search.elastic_problem import AXIS, LIMITS, TARGET, Compromise, ElasticProblem
from posture_opt.selection.search.engine import Engine
from posture_opt.selection.search.inverse_kinematics import ROW_TOLERANCE, InverseKinematics, unlimited
from posture_opt.selection.search.multistart import MultistartResult
from posture_opt.selection.search.relaxation import Reason, Relaxation, plane_reason, relaxation
from posture_opt.selection.search.search_statistics import SearchStatistics

_POOL_POSTURES = 200  # random postures that are led towards the target: so many that of a reachable one some arrive
_REACH_TOLERANCE = 0.01  # of the arm's reach, by which a target may be missed that is not clearly out of it
_STARTS_NEAR_KNOWN = 3  # beside postures that are near already
_STARTS_PER_ORDER = 6  # for a requirement that gives: those that lack least, and those that lack least of the others


@dataclass(frozen=True)
class Explanation:
    """The posture (n,) that comes nearest, why it does not do, and what would help, cheapest first.

    Without reasons it does after all.
    """

    q: Array
    reasons: tuple[Reason, ...] = ()
    relaxations: tuple[Relaxation, ...] = ()


def explain_infeasibility(engine: Engine, found: MultistartResult) -> Explanation:
    """What keeps a search from finding anything.

    Args:
        found: the search, which ended without a feasible posture.
    """
    return _Infeasibility(engine, found).explanation()


def infeasible(
    problem: ProblemData, engine: Engine, found: MultistartResult, why: Explanation, seconds: float
) -> Solution:
    """The infeasible solution: nearest posture, the reasons, and what would help.

    Args:
        seconds: since the search began.
    """
    counts = (found.arrived, found.tried, found.polished, 0, 0, 0)
    statistics = SearchStatistics(*counts, found.sampled, None, float("nan"), found.batches, 0, seconds)
    asked, target = engine.optimisation_problem, found.target
    notes = (*problem.notes, asked.axis_note(target))
    return Solution(
        problem,
        asked,
        target,
        "infeasible",
        why.q,
        statistics,
        np.zeros((0, len(why.q))),
        notes,
        why.reasons,
        why.relaxations,
    )


@dataclass(frozen=True)
class _Infeasibility:
    """The inquiry into one search that found nothing: which requirement gives, and by how little.

    Each requirement is asked to give alone; where none suffices, terms and obstacles together, and then all.
    """

    engine: Engine
    found: MultistartResult

    @property
    def problem(self) -> OptimisationProblem:
        """What was asked, with its rows."""
        return self.engine.optimisation_problem

    @property
    def target(self) -> TaskTarget:
        """Where the tool point was to go."""
        return self.found.target

    @property
    def elastic(self) -> ElasticProblem:
        """The program in which requirements may give."""
        return self.engine.elastic

    def explanation(self) -> Explanation:
        """The nearest posture and the reasons: the most particular requirement that suffices when it gives."""
        outside = plane_reason(self.problem.reach, self.target)
        if outside is not None:
            nearest = self._least(self.elastic.requirements)
            return Explanation(self._pool[0] if nearest is None else nearest.q, (outside,))
        ways = self._ways()
        met = next((way for _, way in ways if way.met), None)
        if met is not None or not ways:
            return Explanation(self._pool[0] if met is None else met.q)
        chosen = max(ways, key=lambda way: (_specific(way[0]), -way[1].cost))
        ordered = sorted(ways, key=lambda way: way[1].cost)
        relaxations = [relaxation(self.problem, self.elastic, self.target, names, way) for names, way in ordered]
        reasons = relaxations[ordered.index(chosen)].reasons
        return Explanation(chosen[1].q, reasons, tuple(relaxations))

    def _ways(self) -> list[tuple[tuple[str, ...], Compromise]]:
        """The requirements that suffice when they give, each way with the compromise that they come to."""
        names = [name for name in self.elastic.requirements if self._may_give(name)]
        if TARGET in names and not self._in_reach:
            names = [TARGET]
        alone: dict[str, Compromise] = {}
        for name in reversed(names):  # a term that gives shows postures near the target: where the others may start
            way = self._least((name,), [other.q for other in alone.values()])
            if way is not None:
                alone[name] = way
        if alone:
            return [((name,), way) for name, way in alone.items()]
        further = [name for name in names if name in self.elastic.further]
        for together in (further, names):  # what was added to the task, before the task itself
            way = self._least(together)
            if way is not None:
                return [(self._giving(way), way)]
        return []

    def _giving(self, way: Compromise) -> tuple[str, ...]:
        """The requirements that give in a compromise; none where nothing is missing."""
        lacks = way.lacking > ROW_TOLERANCE
        return tuple(name for name, gives in zip(self.elastic.requirements, lacks, strict=True) if gives)

    def _may_give(self, name: str) -> bool:
        """Whether a requirement can give at all: a target anywhere is always met, an axis that is free too."""
        if name == TARGET:
            return self.target.kind != "anywhere"
        return name != AXIS or self.problem.axis_rows > 0

    def _least(self, given: Sequence[str], near: Sequence[Array] = ()) -> Compromise | None:
        """The least that the requirements ``given`` must give, sought from ``near`` and the best others."""
        held = np.array([name not in given for name in self.elastic.requirements])
        # Postures that lack nothing else may be far from what is asked for; those that lack least in all are near.
        whole, others = self._cost(np.ones_like(held)), np.round(self._cost(held), 4)
        orders = np.argsort(whole), np.lexsort((self._cost(~held), others))
        chosen = self._pool[
            np.concatenate([order[: _STARTS_NEAR_KNOWN if len(near) else _STARTS_PER_ORDER] for order in orders])
        ]
        return self.elastic.least(self.target.parameters, given, np.vstack([*near, chosen]))

    def _cost(self, counted: Array) -> Array:
        """(N,) what the postures of the pool lack in the requirements that are ``counted`` (r,), in units of each."""
        return self.elastic.cost(np.where(counted, self._lacking, 0.0))

    @cached_property
    def _lacking(self) -> Array:
        """(N, r) by how much each posture of the pool breaks each requirement."""
        return self.elastic.lacking(self._pool, self.target.parameters)

    @cached_property
    def _pool(self) -> Array:
        """(N, n) where searches ended, and postures led towards the target: with its axis, without, without limits."""
        engine = self.engine
        ended = [np.array([candidate.q for candidate in self.found.found])] if self.found.found else []
        led = [self._led(engine.ik, True), self._led(engine.ik, False), self._led(self._free, True)]
        return np.concatenate([*ended, *led])

    @cached_property
    def _free(self) -> InverseKinematics:
        """The inverse kinematics of the arm without its limits."""
        task, reach = self.problem.task, self.problem.reach
        return InverseKinematics(unlimited(self.problem.arm), task.tool_axis, reach.directions, self.engine.compiled)

    @cached_property
    def _in_reach(self) -> bool:
        """Whether the tool comes to the target with any axis, beyond limits and through obstacles; else it has to give.

        A position alone is missed by none of so many postures that are led there, unless it is out of reach.
        """
        misses = self.elastic.lacking(self._led(self._free, False), self.target.parameters)[:, 0]
        return bool(np.nanmin(misses) < _REACH_TOLERANCE * self.problem.reach.radius)

    def _led(self, ik: InverseKinematics, with_axis: bool) -> Array:
        """(N, n) random postures after inverse kinematics towards the target, with or without its tool axis."""
        rng = np.random.default_rng(1)
        request = self.engine.request(self.target, _POOL_POSTURES, rng, whole_box=True)
        if not with_axis:
            request = replace(request, weights=request.weights * np.array([1.0, 0.0, 0.0]))
        return ik.solve(ik.random_postures(_POOL_POSTURES, rng), request)[0]


def _specific(names: Sequence[str]) -> int:
    """How much of a choice the engineer has who stated these requirements: the target is what it is all about."""
    order = (TARGET, AXIS, LIMITS)
    return min(order.index(name) if name in order else len(order) for name in names)
