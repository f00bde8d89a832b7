"""Why nothing is feasible, and what would help: which requirement is in the way, and by how little it must give.

Only asked when restarts of the search found nothing. Each requirement gives alone, as little as it can, while all the
others are met; where none suffices alone, terms and obstacles give together, and then everything. The reason that is
reported is the most particular one: a term or an obstacle before a limit, a limit before the tool axis, the target
last.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from posture_opt.numerics import Array
from posture_opt.robot.posture import Posture
from posture_opt.selection.answer.changes import ATTEMPTS, PLANE_DECIMALS, Changes, onto_plane
from posture_opt.selection.answer.solution import Solution
from posture_opt.selection.problem_data import ProblemData
from posture_opt.selection.program.optimisation_problem import OptimisationProblem
from posture_opt.selection.program.task_target import TaskTarget
from posture_opt.selection.search.change import Change
from posture_opt.selection.search.elastic_problem import AXIS, LIMITS, TARGET, Compromise, ElasticProblem
from posture_opt.selection.search.engine import CandidatePosture, Engine
from posture_opt.selection.search.giving_scene import CLEARANCE
from posture_opt.selection.search.inverse_kinematics import ROW_TOLERANCE, InverseKinematics, unlimited
from posture_opt.selection.search.multistart import MultistartResult
from posture_opt.selection.search.relaxation import Reason, Reasons, Relaxation, plane_reason
from posture_opt.selection.search.search_outcome import is_clear
from posture_opt.selection.search.search_statistics import SearchStatistics
from posture_opt.statements import Statement

_POOL_POSTURES = 200  # random postures that are led towards the target: so many that of a reachable one some arrive
_REACH_TOLERANCE = 0.01  # of the arm's reach, by which a target may be missed that is not clearly out of it
_STARTS_NEAR_KNOWN = 3  # beside postures that are near already
_STARTS_OF_ALL = 4  # where everything may give: each start leads to a compromise
_STARTS_PER_ORDER = 6  # for a requirement that gives: those that lack least, and those that lack least of the others
SEARCH = "search"
"""Name of the reason where nothing is known but that the search found nothing."""
MAX_OBSTACLES = 3  # that are asked to give alone, of those that give together
MAX_OFFERED = 4  # changes that are offered: each is solved first
MAX_TRIALS = 6  # solves that this takes at most

Does = Callable[[Sequence[Change], Array], bool]
"""Whether the problem with some changes has a solution; near the posture (n,) that they were read from, it should."""
Way = tuple[tuple[str, ...], Compromise]
"""Requirements that suffice when they give, and how."""


@dataclass(frozen=True)
class Explanation:
    """The posture (n,) that comes nearest, why it does not do, and what would help, cheapest first.

    Without reasons it does after all.
    """

    q: Array
    reasons: tuple[Reason, ...] = ()
    relaxations: tuple[Relaxation, ...] = ()

    @property
    def text(self) -> str:
        """The message of the error: a reason a line, the last with the cheapest change."""
        help_ = "".join(f": {one.change}" for one in self.relaxations[:1])
        return "\n".join(reason.message for reason in self.reasons) + help_


def met_after_all(engine: Engine, found: MultistartResult) -> CandidatePosture | None:
    """A posture that meets every requirement where no random start led to one; None where there is none.

    Interior-point steps with requirements that may give end at one where nothing has to.
    """
    return Infeasibility(engine, found, None, {}, lambda changes, near: False).met()


def not_met_together(engine: Engine, found: MultistartResult, nearest: CandidatePosture) -> Explanation:
    """What to say where neither the search nor the inquiry found a posture, nor which requirement is in the way.

    Args:
        nearest: where the last local search ended.
    """
    elastic, target = engine.elastic, found.target
    lacking = elastic.lacking(nearest.q[None], target.parameters)[0]
    way = Compromise(nearest.q, lacking, float(elastic.cost(lacking)), {})
    missed = [name for name, amount in zip(elastic.requirements, lacking, strict=True) if amount > ROW_TOLERANCE]
    message = (
        f"no posture was found that meets all of the requirements, from {found.tried} random starts and by relaxing "
        "the requirements in turn; more starts may help (solver: {starts: 500})"
    )
    whole = Reason(SEARCH, message, nearest.violation, "1")
    return Explanation(nearest.q, (whole, *Reasons(engine.optimisation_problem, elastic, target, way).of(missed)))


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
    notes: tuple[str | Statement, ...] = (*problem.notes, asked.axis_note(target))
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
class Infeasibility:
    """The inquiry into one search that found nothing: which requirement gives, and by how little.

    Each requirement is asked to give alone; where none suffices, terms and obstacles together, and then all.

    Args:
        engine: of the task without its held joints, with rows that keep the arm clear.
        found: the search, which ended without a feasible posture.
        asked: the problem with the target of the search; None where nothing is offered.
        held: the joints that its task holds.
        does: whether the problem with some changes is solved; each is tried before it is offered.
    """

    engine: Engine
    found: MultistartResult
    asked: ProblemData | None
    held: Mapping[int, float]
    does: Does

    @property
    def problem(self) -> OptimisationProblem:
        """What was asked, with its rows."""
        return self.engine.optimisation_problem

    @property
    def target(self) -> TaskTarget:
        """Where the tool point was to go."""
        return self.found.target

    @cached_property
    def elastic(self) -> ElasticProblem:
        """The program in which requirements may give."""
        return ElasticProblem(self.problem, self.held) if self.held else self.engine.elastic

    def explanation(self) -> Explanation:
        """The nearest posture and the reasons: the most particular requirement that suffices when it gives."""
        outside = plane_reason(self.problem.reach, self.target)
        if outside is not None:
            nearest = self._least(self.elastic.requirements)
            q = self.nearest if nearest is None else nearest.q
            return self._onto_plane(q, outside)
        ways = self.ways()
        met = next((way for _, way in ways if way.met), None)
        if met is not None or not ways:
            return Explanation(self.nearest if met is None else met.q)
        return self._explained(ways)

    def met(self) -> CandidatePosture | None:
        """A posture that meets everything, from where nothing has to give."""
        if self.found.target.kind != "anywhere" and plane_reason(self.problem.reach, self.target) is not None:
            return None
        way = self._least(self.elastic.further or (LIMITS,))
        if way is None or not way.met:
            return None if way is None else self._clear(way)
        end = self.engine.polished(self.engine.candidates(way.q[None], self.target)[0], self.target)
        return end if end.feasible else None

    def _clear(self, way: Compromise) -> CandidatePosture | None:
        """The posture of a compromise that is clear by exact distances, of which the rows are lower bounds; else None.

        It is no optimum: of the postures that lack something of these bounds it is the one that lacks least.
        """
        scene, in_cell = self.problem.scene, self.elastic.in_cell
        beside = [
            amount for name, amount in zip(self.elastic.requirements, way.lacking, strict=True) if name not in in_cell
        ]
        if scene is None or max(beside, default=0.0) > ROW_TOLERANCE or not is_clear(scene, way.q[None])[0]:
            return None
        return replace(self.engine.candidates(way.q[None], self.target)[0], violation=0.0)

    def _explained(self, ways: Sequence[Way]) -> Explanation:
        """The reasons of the most particular way, and what helps of all of them, cheapest first."""
        beside = {CLEARANCE, *self.elastic.cell.movable}  # of rows that are named where they suffice alone
        names, nearest = max(ways, key=lambda way: (specific(way[0]), not {*way[0]} & beside, -way[1].cost))
        reasons = self.reasons(names, nearest)
        offered: list[Relaxation] = []
        does = limited(self.does)
        for names, way in sorted(ways, key=lambda way: way[1].cost):
            if len(offered) < MAX_OFFERED:
                found = self.relaxation(names, way, ways, does)
                offered += [] if found is None else [found]
        return Explanation(nearest.q, reasons, tuple(offered))

    def reasons(self, names: Sequence[str], way: Compromise) -> tuple[Reason, ...]:
        """What is missed until the requirements ``names`` give."""
        rows = [name for name in names if name in (TARGET, AXIS, LIMITS, *self.elastic.further)]
        if not rows:  # the clearance of the cell gives: what is nearer than that
            lacking = self.elastic.lacking(way.q[None], self.target.parameters)[0]
            way = replace(way, lacking=lacking)
            rows = [name for name in self.elastic.in_cell if lacking[self.elastic.requirements.index(name)] > 0]
        return Reasons(self.problem, self.elastic, self.target, way).of(rows)

    def relaxation(self, names: Sequence[str], way: Compromise, ways: Sequence[Way], does: Does) -> Relaxation | None:
        """The change that a way shows, with the first digits that do; None where none does."""
        assert self.asked is not None
        assert self.asked.task is not None
        task = self.asked.task
        given = [name for name in names if way.lacking[self.elastic.requirements.index(name)] > 0]
        if TARGET in given and self._in_solid(way):
            return None  # nobody puts a workpiece there
        reasons = self._reasons_of(given, way, ways)
        posture = Posture(self.problem.robot, way.q)
        written = (
            Changes(self.problem, task, self.elastic, self.target, way, attempt).of(given) for attempt in ATTEMPTS
        )
        changes = first_that_does(written, lambda changes: does(changes, way.q))
        return None if changes is None else Relaxation(words_of(changes), reasons, posture, way.cost, changes)

    def _reasons_of(self, names: Sequence[str], way: Compromise, ways: Sequence[Way]) -> tuple[Reason, ...]:
        """The reasons of a way; of an obstacle that moves those of its row."""
        movable, rows = self.elastic.cell.movable, {k: name for name, k in self.elastic.cell.obstacles.items()}
        of_row = {(rows[movable[name]],) for name in names if name in movable}
        moved = next(((row, other) for row, other in ways if row in of_row), None)
        return self.reasons(names, way) if moved is None else self.reasons(*moved)

    def _onto_plane(self, q: Array, outside: Reason) -> Explanation:
        """A target outside of the plane of the arm: what brings it there."""
        assert self.asked is not None
        for decimals in PLANE_DECIMALS:
            changes = onto_plane(self.problem, self.target, q, decimals)
            if self.does(changes, q):
                cost = outside.amount / self.problem.reach.radius
                posture = Posture(self.problem.robot, q)
                return Explanation(q, (outside,), (Relaxation(changes[0].words, (outside,), posture, cost, changes),))
        return Explanation(q, (outside,))

    # --- the ways -------------------------------------------------------------------------------------------------

    def ways(self) -> list[Way]:
        """The requirements that suffice when they give, each way with the compromise that they come to."""
        every = [name for name in (TARGET, AXIS, LIMITS, *self.elastic.further) if self._may_give(name)]
        names = [TARGET] if TARGET in every and not self._in_reach else every
        alone: dict[str, Compromise] = {}
        in_cell = [name for name in names if name in self.elastic.in_cell]
        for name in reversed([name for name in names if name not in in_cell]):
            # A term that gives shows postures near the target: where the others may start.
            way = self._least((name,), [other.q for other in alone.values()])
            if way is not None:
                alone[name] = way
        alone |= self._ways_of_cell(in_cell, [other.q for other in alone.values()])
        if alone:
            return [((name,), way) for name, way in alone.items()]
        further = [name for name in names if name in self.elastic.further]
        for together in (further, every):  # what was added to the task, before the task itself
            way = self._least(together) if together else None
            if way is not None:
                return [(self._giving(way), way)]
        return []

    def _ways_of_cell(self, rows: Sequence[str], near: Sequence[Array]) -> dict[str, Compromise]:
        """The rows of the cell that suffice when they give, the places of their obstacles, and the clearance."""
        whole = self._least(rows, near) if rows else None
        if whole is None:
            return {}
        giving = [name for name in self._giving(whole) if name in rows] or list(rows[:1])
        found: dict[str, Compromise] = {}
        for name in giving[:MAX_OBSTACLES]:
            way = whole if len(giving) == 1 else self._least((name,), [whole.q, *near])
            if way is not None:
                found[name] = way
        obstacle = {k: name for name, k in self.elastic.cell.movable.items()}
        places = [obstacle[k] for name, k in self.elastic.cell.obstacles.items() if name in found and k in obstacle]
        scene = self.problem.scene
        clearance = [CLEARANCE] if scene is not None and scene.margin > 0 else []
        for name in (*places, *clearance):
            way = self._least((name,), [whole.q, *near])
            if way is not None:
                found[name] = way
        return found

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
        cell = self.elastic.cell
        eased = {*given, *(row for row, k in cell.obstacles.items() if k in {cell.movable.get(name) for name in given})}
        eased |= {*self.elastic.in_cell} if CLEARANCE in given else set()
        held = np.array([name not in eased for name in self.elastic.requirements])
        # Postures that lack nothing else may be far from what is asked for; those that lack least in all are near.
        whole, others = self._cost(np.ones_like(held)), np.round(self._cost(held), 4)
        orders = np.argsort(whole), np.lexsort((self._cost(~held), others))
        most = _STARTS_NEAR_KNOWN if len(near) else _STARTS_PER_ORDER
        chosen = self._pool[np.column_stack([order[:most] for order in orders]).ravel()]  # in turn of either
        starts = np.vstack([*near, chosen])[: _STARTS_OF_ALL if {TARGET, LIMITS} <= {*given} else None]
        way = self.elastic.least(self.target.parameters, given, starts)
        if way is None or TARGET not in given or not self._in_solid(way):
            return way
        level = self.elastic.least(self.target.parameters, given, starts, level=True)
        return way if level is None or self._in_solid(level) else level

    def _in_solid(self, way: Compromise) -> bool:
        """Whether the tool point comes into a solid or below the mounting plane, where the target is not."""
        scene = self.problem.scene
        if scene is None:
            return False
        point = np.array(self.problem.tool_point.walk(way.q.tolist())[0].position, dtype=float)
        return not scene.solids_at(point) <= scene.solids_at((self.target.lower + self.target.upper) / 2)

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
        every = np.concatenate(
            [*ended, self._led(engine.ik, True), self._led(engine.ik, False), self._led(self._free, True)]
        )
        if not self.held:
            return every
        stands = every.copy()
        stands[:, list(self.held)] = list(self.held.values())
        return np.concatenate([every, stands])

    @property
    def nearest(self) -> Array:
        """(n,) the posture of the pool that comes to nothing better."""
        return np.asarray(self._pool[0])

    def postures_near(self, target: TaskTarget) -> list[Array]:
        """Postures (n,) of the pool that lack least at another target."""
        cost = self.elastic.cost(self.elastic.lacking(self._pool, target.parameters))
        return [self._pool[k] for k in np.argsort(cost)[:_STARTS_NEAR_KNOWN]]

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
        if self.problem.reach.excludes(self.target.lower, self.target.upper):
            return False
        misses = self.elastic.lacking(self._led(self._free, False), self.target.parameters)[:, 0]
        return bool(np.nanmin(misses) < _REACH_TOLERANCE * self.problem.reach.radius)

    def _led(self, ik: InverseKinematics, with_axis: bool) -> Array:
        """(N, n) random postures after inverse kinematics towards the target, with or without its tool axis."""
        rng = np.random.default_rng(1)
        request = self.engine.request(self.target, _POOL_POSTURES, rng, whole_box=True)
        if not with_axis:
            request = replace(request, weights=request.weights * np.array([1.0, 0.0, 0.0]))
        return ik.solve(ik.random_postures(_POOL_POSTURES, rng), request)[0]


def specific(names: Sequence[str]) -> int:
    """How much of a choice the engineer has who stated these requirements: the target is what it is all about."""
    order = (TARGET, AXIS, LIMITS)
    return min(order.index(name) if name in order else len(order) for name in names)


def first_that_does(
    written: Iterable[tuple[Change, ...]], does: Callable[[Sequence[Change]], bool]
) -> tuple[Change, ...] | None:
    """The first of some changes with which the problem is solved; None where none does, or nothing would change."""
    tried: list[tuple[Change, ...]] = []
    for changes in written:
        if not changes:
            return None
        if changes not in tried and does(changes):
            return changes
        tried.append(changes)
    return None


def limited(does: Does) -> Does:
    """The same question, answered `MAX_TRIALS` times; then with no."""
    left = iter(range(MAX_TRIALS))

    def asked(changes: Sequence[Change], near: Array) -> bool:
        """Whether the problem with some changes is solved; no, once enough were tried."""
        return next(left, None) is not None and does(changes, near)

    return asked


def words_of(changes: Sequence[Change]) -> str:
    """What to change, in one sentence."""
    return " and ".join(dict.fromkeys(change.words for change in changes))
