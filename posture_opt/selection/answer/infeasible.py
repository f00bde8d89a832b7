"""Why nothing is feasible, and what would help: which requirement is in the way, and by how little it must give.

Each requirement gives alone, as little as it can, while all the others are met; where none suffices alone, terms and
obstacles give together, then everything. The reason that is reported is the most particular one. For several stations
a change is sought at every one that fails, and the loosest value that any needs is solved first, then offered.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import islice

import numpy as np

from posture_opt.numerics import Array
from posture_opt.robot.posture import Posture
from posture_opt.selection.answer.changes import ATTEMPTS, PLANE_DECIMALS, Attempt, Changes, onto_plane
from posture_opt.selection.answer.solution import Solution
from posture_opt.selection.problem_data import ProblemData
from posture_opt.selection.program.optimisation_problem import OptimisationProblem
from posture_opt.selection.program.task_target import TaskTarget
from posture_opt.selection.search.elastic_problem import AXIS, CLEARANCE, LIMITS, TARGET, Compromise, ElasticProblem
from posture_opt.selection.search.engine import CandidatePosture, Engine
from posture_opt.selection.search.inverse_kinematics import InverseKinematics, unlimited
from posture_opt.selection.search.multistart import MultistartResult
from posture_opt.selection.search.relaxation import Change, Reason, Reasons, Relaxation, plane_reason
from posture_opt.selection.search.search_outcome import SearchStatistics, is_clear
from posture_opt.statements import Statement

_POOL_POSTURES = 200  # random postures that are led towards the target: so many that of a reachable one some arrive
_STARTS_NEAR_KNOWN = 3  # beside postures that are near already
SEARCH = "search"  # name of the reason where nothing is known but that the search found nothing
MAX_OFFERED = 4  # changes that are offered: each is solved first

# Whether the problem with some changes has a solution; near the posture (n,) that they were read from, it should.
Does = Callable[[Sequence[Change], Array], bool]
Way = tuple[tuple[str, ...], Compromise]  # requirements that suffice when they give, and how


@dataclass(frozen=True)
class Explanation:
    """The posture (n,) that comes nearest, why it does not do (no reasons: it does), and what helps, cheapest first."""

    q: Array
    reasons: tuple[Reason, ...] = ()
    relaxations: tuple[Relaxation, ...] = ()

    @property
    def text(self) -> str:
        """The message of the error: a reason a line, the last with the cheapest change."""
        help_ = "".join(f": {one.change}" for one in self.relaxations[:1])
        return "\n".join(reason.message for reason in self.reasons) + help_


def met_after_all(engine: Engine, found: MultistartResult) -> CandidatePosture | None:
    """A posture that meets every requirement where no random start led to one, by the elastic program; else None."""
    return Infeasibility(engine, found, None, {}, lambda changes, near: False).met()


def not_met_together(engine: Engine, found: MultistartResult, nearest: CandidatePosture) -> Explanation:
    """What to say where neither search nor inquiry found a posture, nor the requirement in the way."""
    elastic, target = engine.elastic, found.target
    lacking = elastic.lacking(nearest.q[None], target.parameters)[0]
    way = elastic.compromise(nearest.q, lacking, {})
    message = (
        f"no posture was found that meets all of the requirements, from {found.tried} random starts and by relaxing"
    )
    message += " the requirements in turn; more starts may help (solver: {starts: 500})"
    whole = Reason(SEARCH, message, nearest.violation, "1")
    return Explanation(nearest.q, (whole, *Reasons(engine.optimisation_problem, elastic, target, way).of(way.giving)))


def infeasible(
    problem: ProblemData, engine: Engine, found: MultistartResult, why: Explanation, seconds: float
) -> Solution:
    counts = found.arrived, found.tried, found.polished
    statistics = SearchStatistics(*counts, found.sampled, seconds, batches=found.batches)
    asked, target, none = engine.optimisation_problem, found.target, np.zeros((0, len(why.q)))
    notes: tuple[str | Statement, ...] = (*problem.notes, asked.axis_note(target))
    return Solution(problem, asked, target, "infeasible", why.q, statistics, none, notes, why.reasons, why.relaxations)


@dataclass(frozen=True)
class Infeasibility:
    """The inquiry into a search that found nothing: each requirement gives alone, some together, then all."""

    engine: Engine  # of the task without its held joints, with rows that keep the arm clear
    found: MultistartResult
    asked: ProblemData | None  # the problem with the target of the search; None where nothing is offered
    held: Mapping[int, float]  # joint index -> value [rad or m] that the task holds
    does: Does  # tries each change before it is offered

    @property
    def problem(self) -> OptimisationProblem:
        return self.engine.optimisation_problem

    @property
    def target(self) -> TaskTarget:
        return self.found.target

    @cached_property
    def elastic(self) -> ElasticProblem:
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
        if plane_reason(self.problem.reach, self.target) is not None or not self._in_reach:
            return None
        way = self._least(self.elastic.further or (LIMITS,))
        if way is None or not way.met:
            return None if way is None else self._clear(way)
        end = self.engine.polished(self.engine.candidates(way.q[None], self.target)[0], self.target)
        return end if end.feasible else None

    def _clear(self, way: Compromise) -> CandidatePosture | None:
        """The posture of a compromise where exact distances clear it (the rows are lower bounds); no optimum."""
        scene, in_cell = self.problem.scene, self.elastic.in_cell
        if scene is None or {*way.giving} - {*in_cell} or not is_clear(scene, way.q[None])[0]:
            return None
        return replace(self.engine.candidates(way.q[None], self.target)[0], violation=0.0)

    def _explained(self, ways: Sequence[Way]) -> Explanation:
        beside = {CLEARANCE, *self.elastic.cell.movable}  # of rows that are named where they suffice alone
        names, nearest = max(ways, key=lambda way: (specific(way[0]), not {*way[0]} & beside, -way[1].cost))
        reasons = self.reasons(names, nearest)
        does = limited(self.does)
        single = [_SharedWay(names, (way,)) for names, way in ways]
        offered = _offered(single, lambda way: self._relaxation(way, ways, does))
        return Explanation(nearest.q, reasons, offered)

    def reasons(self, names: Sequence[str], way: Compromise) -> tuple[Reason, ...]:
        """Requirements missed until ``names`` give."""
        rows = [name for name in names if name in (TARGET, AXIS, LIMITS, *self.elastic.further)]
        if not rows:  # the clearance of the cell gives: what is nearer than that
            lacking = self.elastic.lacking(way.q[None], self.target.parameters)[0]
            way = self.elastic.compromise(way.q, lacking, way.slacks)
            rows = [name for name in self.elastic.in_cell if way.lacking[name] > 0]
        return Reasons(self.problem, self.elastic, self.target, way).of(rows)

    def _relaxation(self, way: _SharedWay, ways: Sequence[Way], does: Does) -> Relaxation | None:
        given = [name for name in way.names if way.ways[0].lacking[name] > 0]
        if TARGET in given and self._in_solid(way.ways[0]):
            return None  # nobody puts a workpiece there
        reasons = partial(self._reasons_of, given, way.ways[0], ways)
        return _relaxation(self, way, [self.target], reasons, ATTEMPTS, does)

    def _reasons_of(self, names: Sequence[str], way: Compromise, ways: Sequence[Way]) -> tuple[Reason, ...]:
        movable, rows = self.elastic.cell.movable, {k: name for name, k in self.elastic.cell.obstacles.items()}
        of_row = {(rows[movable[name]],) for name in names if name in movable}
        moved = next(((row, other) for row, other in ways if row in of_row), None)
        return self.reasons(names, way) if moved is None else self.reasons(*moved)

    def _onto_plane(self, q: Array, outside: Reason) -> Explanation:
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
        fixed = {TARGET} if self.target.kind == "anywhere" else set()
        fixed |= set() if self.problem.axis_rows else {AXIS}
        every = [name for name in (TARGET, AXIS, LIMITS, *self.elastic.further) if name not in fixed]
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
                return [(way.giving, way)]
        return []

    def _ways_of_cell(self, rows: Sequence[str], near: Sequence[Array]) -> dict[str, Compromise]:
        whole = self._least(rows, near) if rows else None
        if whole is None:
            return {}
        giving = [name for name in whole.giving if name in rows] or list(rows[:1])
        near = [whole.q, *near]
        found = {giving[0]: whole} if len(giving) == 1 else self._alone(giving[:3], near)
        obstacle = {k: name for name, k in self.elastic.cell.movable.items()}
        places = [obstacle[k] for name, k in self.elastic.cell.obstacles.items() if name in found and k in obstacle]
        scene = self.problem.scene
        clearance = [CLEARANCE] if scene is not None and scene.margin > 0 else []
        return found | self._alone([*places, *clearance], near)

    def _alone(self, names: Sequence[str], near: Sequence[Array]) -> dict[str, Compromise]:
        ways = {name: self._least((name,), near) for name in names}
        return {name: way for name, way in ways.items() if way is not None}

    def _least(self, given: Sequence[str], near: Sequence[Array] = ()) -> Compromise | None:
        """The least that the requirements ``given`` must give, sought from ``near`` and the best others."""
        cell = self.elastic.cell
        eased = {*given, *(row for row, k in cell.obstacles.items() if k in {cell.movable.get(name) for name in given})}
        eased |= {*self.elastic.in_cell} if CLEARANCE in given else set()
        held = np.array([name not in eased for name in self.elastic.requirements])
        # Postures that lack nothing else may be far from what is asked for; those that lack least in all are near.
        whole, others = self._cost(np.ones_like(held)), np.round(self._cost(held), 4)
        orders = np.argsort(whole), np.lexsort((self._cost(~held), others))
        most = _STARTS_NEAR_KNOWN if len(near) else 6
        chosen = self._pool[np.column_stack([order[:most] for order in orders]).ravel()]  # in turn of either
        # Where everything may give, each start leads to a compromise
        starts = np.vstack([*near, chosen])[: 4 if {TARGET, LIMITS} <= {*given} else None]
        way = self.elastic.least(self.target.parameters, given, starts)
        if way is None or TARGET not in given or not self._in_solid(way):
            return way
        level = self.elastic.least(self.target.parameters, given, starts, level=True)
        return way if level is None or self._in_solid(level) else level

    def _in_solid(self, way: Compromise) -> bool:
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
        task, reach = self.problem.task, self.problem.reach
        return InverseKinematics(unlimited(self.problem.arm), task.tool_axis, reach.directions, self.engine.compiled)

    @cached_property
    def _in_reach(self) -> bool:
        if self.problem.reach.excludes(self.target.lower, self.target.upper):
            return False
        misses = self.elastic.lacking(self._led(self._free, False), self.target.parameters)[:, 0]
        return bool(np.nanmin(misses) < 0.01 * self.problem.reach.radius)

    def _led(self, ik: InverseKinematics, with_axis: bool) -> Array:
        """(N, n) random postures after inverse kinematics towards the target, with or without its tool axis."""
        rng = np.random.default_rng(1)
        request = self.engine.request(self.target, _POOL_POSTURES, rng, whole_box=True)
        if not with_axis:
            request = replace(request, weights=request.weights * np.array([1.0, 0.0, 0.0]))
        return ik.solve(ik.random_postures(_POOL_POSTURES, rng), request)[0]


def specific(names: Sequence[str]) -> int:
    """Rank of the engineer's choice in requirements: terms and obstacles, limits, tool axis, then the target."""
    order = (TARGET, AXIS, LIMITS)
    return min(order.index(name) if name in order else len(order) for name in names)


def first_that_does(
    written: Iterable[tuple[Change, ...]], does: Callable[[Sequence[Change]], bool]
) -> tuple[Change, ...] | None:
    """The first changes that solve the problem, or None."""
    tried: list[tuple[Change, ...]] = []
    for changes in written:
        if not changes:
            return None
        if changes not in tried and does(changes):
            return changes
        tried.append(changes)
    return None


def limited(does: Does) -> Does:
    left = iter(range(6))

    def asked(changes: Sequence[Change], near: Array) -> bool:
        """Whether the problem with some changes is solved; no, once enough were tried."""
        return next(left, None) is not None and does(changes, near)

    return asked


def words_of(changes: Sequence[Change]) -> str:
    return " and ".join(dict.fromkeys(change.words for change in changes))


@dataclass(frozen=True)
class _SharedWay:
    """Requirements that give at every station that fails, with the compromise of each; ``worst`` is the costliest."""

    names: tuple[str, ...]
    ways: tuple[Compromise, ...]

    @property
    def worst(self) -> int:
        return int(np.argmax([way.cost for way in self.ways]))

    @property
    def cost(self) -> float:
        return max(way.cost for way in self.ways)


def explain_stations(inquiry: Infeasibility, targets: Sequence[TaskTarget], names: Sequence[str]) -> Explanation:
    """The reasons at the station that lacks most, and changes that do for all; ``targets`` are those that fail."""
    reach = inquiry.problem.reach
    outside = [
        (reason, name) for target, name in zip(targets, names, strict=True) if (reason := plane_reason(reach, target))
    ]
    if outside:
        reason, name = max(outside, key=lambda pair: pair[0].amount)
        return Explanation(inquiry.nearest, (replace(reason, message=f"{name}: {reason.message}"),))
    # At most 40, spread evenly
    chosen = np.unique(np.linspace(0, len(targets) - 1, min(40, len(targets))).round().astype(int)).tolist()
    targets, names = [targets[k] for k in chosen], [names[k] for k in chosen]
    start = min(range(len(targets)), key=lambda k: float(np.linalg.norm(targets[k].lower - inquiry.target.lower)))
    ways = [_shared(inquiry, own, targets, start) for own in inquiry.ways() if not own[1].met]
    shared = [way for way in ways if way is not None]
    if not shared:
        return Explanation(inquiry.nearest)
    cell = inquiry.elastic.cell
    changing = [way for way in shared if not {*way.names} & {TARGET, *cell.movable}]
    own = [way for way in shared if not {*way.names} & {*cell.movable}] or shared
    chief = max(own, key=lambda way: (specific(way.names), -way.cost))
    reasons = _reasons(inquiry, chief, targets, names)
    does, attempts = limited(inquiry.does), [attempt for attempt in ATTEMPTS if not attempt.digits]

    def relaxed(way: _SharedWay) -> Relaxation | None:
        return _relaxation(inquiry, way, targets, partial(_reasons, inquiry, way, targets, names), attempts, does)

    return Explanation(chief.ways[chief.worst].q, reasons, _offered(changing, relaxed))


def _shared(
    inquiry: Infeasibility, own: tuple[tuple[str, ...], Compromise], targets: Sequence[TaskTarget], start: int
) -> _SharedWay | None:
    """The least that these requirements must give at every station, from ``start`` outwards, or None."""
    names, first = own
    found: dict[int, Compromise] = {}
    for order in (range(start, len(targets)), range(start - 1, -1, -1)):
        near = first
        for k in order:
            starts = np.array([near.q, first.q, *inquiry.postures_near(targets[k])])
            way = inquiry.elastic.least(targets[k].parameters, names, starts)
            if way is None:
                return None
            found[k] = near = way
    return _SharedWay(names, tuple(found[k] for k in range(len(targets))))


def _reasons(
    inquiry: Infeasibility, way: _SharedWay, targets: Sequence[TaskTarget], names: Sequence[str]
) -> tuple[Reason, ...]:
    worst = way.worst
    at = replace(inquiry, found=replace(inquiry.found, target=targets[worst]))
    found = at.reasons(way.names, way.ways[worst])
    return tuple(replace(reason, message=f"{names[worst]}: {reason.message}") for reason in found)


def _offered(ways: Iterable[_SharedWay], relaxed: Callable[[_SharedWay], Relaxation | None]) -> tuple[Relaxation, ...]:
    """The first changes that do, those of the cheapest ways first."""
    found = map(relaxed, sorted(ways, key=lambda way: way.cost))
    return tuple(islice((one for one in found if one is not None), MAX_OFFERED))


def _relaxation(
    inquiry: Infeasibility, way: _SharedWay, targets: Sequence[TaskTarget], reasons: Callable[[], tuple[Reason, ...]],
    attempts: Iterable[Attempt], does: Does,
) -> Relaxation | None:  # fmt: skip
    """The change that does at all targets, with the first digits that solve the problem, or None."""
    q = way.ways[way.worst].q
    written = (_changes(inquiry, way, targets, attempt) for attempt in attempts)
    changes = first_that_does(written, lambda changes: does(changes, q))
    if changes is None:
        return None
    return Relaxation(words_of(changes), reasons(), Posture(inquiry.problem.robot, q), way.cost, changes)


def _changes(
    inquiry: Infeasibility, way: _SharedWay, targets: Sequence[TaskTarget], attempt: Attempt
) -> tuple[Change, ...]:
    assert inquiry.asked is not None
    assert inquiry.asked.task is not None
    task, loosest = inquiry.asked.task, dict[str, Change]()
    for target, one in zip(targets, way.ways, strict=True):
        given = [name for name in way.names if one.lacking[name] > 0]
        changes = Changes(inquiry.problem, task, inquiry.elastic, target, one, attempt).of(given)
        if given and not changes:
            return ()
        for change in changes:
            before = loosest.get(change.path)
            loosest[change.path] = change if before is None else before.with_room_for(change)
    return tuple(loosest.values())
