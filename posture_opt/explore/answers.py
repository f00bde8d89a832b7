"""``Answers``: the loop of solving, which never keeps the page waiting."""

from __future__ import annotations

import threading
import traceback
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from posture_opt.errors import NoSolutionError, PostureOptError
from posture_opt.explore.other_process import OtherProcess, defect
from posture_opt.model.toolchain import NotCompiledError, compiled_before
from posture_opt.numerics import Array
from posture_opt.problem.problem import Problem
from posture_opt.selection.answer.selector import PostureSelector
from posture_opt.selection.answer.solution import Solution
from posture_opt.selection.select_posture import select_posture
from posture_opt.uncertainty.spread import Spread, propagate


class Following:
    """The best posture near the last one, by selectors that are interpreted until another process has compiled them."""

    def __init__(self) -> None:
        self._process = OtherProcess()
        self._key: object = None
        self._count = self._tried = 0
        self._fast: PostureSelector | None = None
        self._slow: PostureSelector | None = None
        self._compiling: threading.Thread | None = None
        self._first = True

    def solve(self, problem: Problem, known: Array | None) -> Solution:
        """The best posture that a few searches find, one from a ``known`` posture (n,) [rad or m]."""
        key = all_but_position(problem)
        if key != self._key:  # another arm, cell or task
            self._first = self._key is None
            self._key, self._fast, self._slow, self._count, self._tried = key, None, None, 0, 0
            self._process.stop_if_busy()
        self._count += 1
        # For every position of a slider it would not pay; another target may need what the first did not.
        if (self._first or self._count > 1) and not self.compiling and self._tried < 3:
            try:
                with compiled_before():
                    self._fast = self._fast or _selector_of(problem, None)
                    return _solved(self._fast, problem, known)
            except NotCompiledError:
                self._tried += 1
                self._compiling = threading.Thread(target=self._process.call, args=(compiled, problem), daemon=True)
                self._compiling.start()
        self._slow = self._slow or _selector_of(problem, False)
        return _solved(self._slow, problem, known)

    @property
    def compiling(self) -> bool:
        """Whether another process compiles."""
        return self._compiling is not None and self._compiling.is_alive()

    def end(self) -> None:
        """Compile nothing more."""
        self._process.end()


def compiled(problem: Problem) -> None:
    """Compiles into the cache what the search for a problem calls."""
    _solved(_selector_of(problem, None), problem, None)


def _selector_of(problem: Problem, compiled: bool | None) -> PostureSelector:
    return PostureSelector(problem, compiled=compiled, offers=False, explains=False)


def _solved(selector: PostureSelector, problem: Problem, known: Array | None) -> Solution:
    target = selector.target
    if problem.task is not None and problem.task.position is not None:
        target = target.with_position(np.array(problem.task.position, dtype=float))
    return replace(selector.solve_target(target, problem.solver.seed, 4, known), problem=problem)


def all_but_position(problem: Problem) -> object:
    """What a problem states but for where the target is."""
    document = problem.to_dict()
    task = {**(document.get("task") or {})}
    placed = task.pop("position", None) is not None
    return {**document, "task": task}, placed


@dataclass(frozen=True)
class Request:
    """What is asked: the best posture for a problem, or one posture (n,) [rad or m] of the user's own."""

    problem: Problem
    q: tuple[float, ...] | None = None


@dataclass(frozen=True)
class Answer:
    """What there is to show for one request.

    Args:
        reason: why there is no solution, or no full search.
        nearest: the infeasible result, where the full search has looked for it.
        whole: whether the full search gave it, as the command line does.
        gain: share of σ that the full search is below what followed the target; 0 at the same optimum.
        own: the spread at a posture of the user's own; None where the best one is asked for.
    """

    request: Request
    solution: Solution | None = None
    reason: str = ""
    nearest: Solution | None = None
    whole: bool = False
    gain: float = 0.0
    own: Spread | None = None


class Answers:
    """Solves what was asked last."""

    def __init__(self, show: Callable[[Answer], None]) -> None:
        self._show = show
        self._asked: Request | None = None
        self._best: Solution | None = None
        self._ended = False
        self._changed = threading.Condition()
        self._search = OtherProcess()
        self._following = Following()
        self._q: Array | None = None
        self._thread = threading.Thread(target=self._run, name="posture_opt explore", daemon=True)
        self._thread.start()

    def ask(self, request: Request) -> None:
        """Answer this next, whatever else was asked before."""
        with self._changed:
            self._asked = request
            self._changed.notify()
        # What stations take is ended no sooner than after 3 s: a new process takes half of it.
        self._search.stop_if_busy(3.0 if has_stations(request.problem) else 0.0)

    def end(self) -> None:
        """Solve nothing more."""
        with self._changed:
            self._ended = True
            self._changed.notify()
        self._search.end()
        self._following.end()
        if threading.current_thread() is not self._thread:
            self._thread.join(timeout=10.0)

    def _run(self) -> None:
        while (request := self._next()) is not None:
            try:
                self._answer(request)
            except Exception as error:  # one request that cannot be answered does not end the page
                traceback.print_exc()
                self._show(Answer(request, reason=str(defect(error))))

    def _answer(self, request: Request) -> None:
        """Show what answers a request: at once from the last answer, and of the full search once the target rests."""
        if request.q is not None:
            try:
                own = Answer(request, self._best, own=propagate(request.problem, request.q))
            except PostureOptError as error:
                own = Answer(request, reason=str(error))
            self._show(own)
            return
        several = has_stations(request.problem)
        quick = Answer(request, self._best) if several else self.quick(request)
        self._show(quick)
        if not several:
            with self._changed:
                if self._changed.wait_for(lambda: self._ended or self._asked is not None, timeout=0.35):
                    return  # it moves on
        whole = self._whole(quick)
        if whole is not None:
            self._show(whole)

    def _next(self) -> Request | None:
        with self._changed:
            self._changed.wait_for(lambda: self._ended or self._asked is not None)
            request, self._asked = self._asked, None
            return None if self._ended else request

    def quick(self, request: Request) -> Answer:
        """The best posture that searches from the last one find, or what is in its way; all reasons are asked later."""
        try:
            self._best = self._following.solve(request.problem, self._q)
        except NoSolutionError as error:
            self._best = None
            return Answer(request, reason=f"{error}; the full search goes on")
        except PostureOptError as error:
            return Answer(request, reason=str(error))
        self._q = self._best.q
        return Answer(request, self._best)

    def _whole(self, quick: Answer) -> Answer | None:
        found = self._search.call(select_posture, quick.request.problem)
        if found is None:
            return None
        if isinstance(found, NoSolutionError):
            return Answer(quick.request, reason=str(found), nearest=found.solution, whole=True)
        if isinstance(found, PostureOptError):
            return replace(quick, reason=str(found))
        self._q, self._best = found.q, found
        compared = quick.solution is not None and not found.points
        gain = 1.0 - found.sigma / quick.solution.sigma if compared and quick.solution else 0.0
        gain = gain if gain > 1e-3 else 0.0  # of σ: else it is the same branch
        return Answer(quick.request, found, whole=True, gain=gain)


def has_stations(problem: Problem) -> bool:
    """Whether a task has a posture at several places: features, or a path."""
    return problem.task is not None and (bool(problem.task.features) or problem.task.on_path)
