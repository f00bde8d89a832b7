"""``Answers``: the loop of solving, which never keeps the page waiting.

One thread solves, the newest request wins. While the target moves, a few local searches start from the last answer;
once it rests, the full search of `select_posture` decides, and is stopped when the target moves on.
"""

from __future__ import annotations

import threading
import traceback
from collections.abc import Callable
from dataclasses import dataclass, replace

from posture_opt.errors import NoSolutionError, PostureOptError
from posture_opt.explore.following import Following
from posture_opt.explore.other_process import OtherProcess, defect
from posture_opt.numerics import Array
from posture_opt.problem.problem import Problem
from posture_opt.selection.answer.solution import Solution
from posture_opt.selection.select_posture import select_posture
from posture_opt.uncertainty.spread.spread import Spread, propagate

RESTS_S = 0.35
"""A target that has not moved for so long [s] rests."""
_PATIENCE_S = 3.0  # [s]: what stations take is ended by a new request no sooner; a new process takes half of it
_BETTER = 1e-3  # of σ: by so much the full search has to be better for the arm to have gone to another branch


@dataclass(frozen=True)
class Request:
    """What is asked: the best posture for a problem, or one posture (n,) [rad or m] of the user's own."""

    problem: Problem
    q: tuple[float, ...] | None = None


@dataclass(frozen=True)
class Answer:
    """What there is to show for one request.

    Args:
        request: what was asked.
        solution: None where nothing is feasible, or nothing is known yet.
        reason: why there is none, or no full search, in words; else empty.
        nearest: the infeasible result, where the full search has looked for it.
        whole: whether the full search gave it: what the command line says of this problem.
        gain: share of σ that the full search is below what followed the target; 0 where it is the same optimum.
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
    """Solves what was asked last.

    Args:
        show: called with every answer, from the thread that solves.
    """

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
        self._search.stop_if_busy(_PATIENCE_S if has_stations(request.problem) else 0.0)

    def end(self) -> None:
        """Solve nothing more."""
        with self._changed:
            self._ended = True
            self._changed.notify()
        self._search.stop()
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
            self._show(self._at(request, request.q))
            return
        several = has_stations(request.problem)
        quick = Answer(request, self._best) if several else self.quick(request)
        self._show(quick)
        if several or self._rests():
            whole = self._whole(quick)
            if whole is not None:
                self._show(whole)

    def _next(self) -> Request | None:
        """What was asked last, once something is; None at the end."""
        with self._changed:
            self._changed.wait_for(lambda: self._ended or self._asked is not None)
            request, self._asked = self._asked, None
            return None if self._ended else request

    def _rests(self) -> bool:
        """Whether nothing else is asked for a while."""
        with self._changed:
            return not self._changed.wait_for(lambda: self._ended or self._asked is not None, timeout=RESTS_S)

    def _at(self, request: Request, q: tuple[float, ...]) -> Answer:
        """The spread at a posture of the user's own, beside the best one that is known."""
        try:
            return Answer(request, self._best, own=propagate(request.problem, q))
        except PostureOptError as error:
            return Answer(request, reason=str(error))

    def quick(self, request: Request) -> Answer:
        """The best posture that searches from the last one find; which reason there is for none, is asked later."""
        try:
            self._best = self._following.solve(request.problem, self._q)
        except NoSolutionError:
            self._best = None
            return Answer(request)
        except PostureOptError as error:
            return Answer(request, reason=str(error))
        self._q = self._best.q
        return Answer(request, self._best)

    def _whole(self, quick: Answer) -> Answer | None:
        """The answer of the full search; None where it was stopped."""
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
        return Answer(quick.request, found, whole=True, gain=gain if gain > _BETTER else 0.0)


def has_stations(problem: Problem) -> bool:
    """Whether a task has a posture at several places: features, or a path."""
    return problem.task is not None and (bool(problem.task.features) or problem.task.on_path)
