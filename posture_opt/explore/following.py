"""``Following``: the selectors that follow the target, interpreted until their functions are compiled.

Compiling takes seconds, and a minute on a busy machine. It is done once, in another process, and what it leaves in the
cache is taken as soon as it is there; the interpreted functions give the same answers until then, about ten times
slower.
"""

from __future__ import annotations

import threading
from dataclasses import replace

import numpy as np

from posture_opt.explore.other_process import OtherProcess
from posture_opt.model.toolchain import NotCompiledError, compiled_before
from posture_opt.numerics import Array
from posture_opt.problem.problem import Problem
from posture_opt.selection.answer.selector import PostureSelector
from posture_opt.selection.answer.solution import Solution

STARTS = 4
"""Local searches beside the one from the last answer."""
_TRIES = 3  # of compiling for one problem: another target may need what the first did not


class Following:
    """The best posture near the last one, for problems that differ from the last by the place of the target mostly."""

    def __init__(self) -> None:
        self._process = OtherProcess()
        self._key: object = None
        self._count = self._tried = 0
        self._fast: PostureSelector | None = None
        self._slow: PostureSelector | None = None
        self._compiling: threading.Thread | None = None
        self._first = True

    def solve(self, problem: Problem, known: Array | None) -> Solution:
        """The best posture that a few searches find, one from a ``known`` posture (n,) [rad or m].

        Raises:
            PostureOptError: as `PostureSelector.solve`.
        """
        self._follow(problem)
        # For every position of a slider it would not pay.
        if (self._first or self._count > 1) and not self.compiling and self._tried < _TRIES:
            try:
                with compiled_before():
                    self._fast = self._fast or _selector(problem, None)
                    return _solved(self._fast, problem, known)
            except NotCompiledError:
                self._tried += 1
                self._compiling = threading.Thread(target=self._process.call, args=(compiled, problem), daemon=True)
                self._compiling.start()
        self._slow = self._slow or _selector(problem, False)
        return _solved(self._slow, problem, known)

    @property
    def compiling(self) -> bool:
        """Whether another process compiles."""
        return self._compiling is not None and self._compiling.is_alive()

    def end(self) -> None:
        """Compile nothing more."""
        self._process.stop()

    def _follow(self, problem: Problem) -> None:
        """Drop the selectors of another arm, cell or task."""
        key = all_but_position(problem)
        if key != self._key:
            self._first = self._key is None
            self._key, self._fast, self._slow, self._count, self._tried = key, None, None, 0, 0
            self._process.stop_if_busy()
        self._count += 1


def compiled(problem: Problem) -> None:
    """Compiles into the cache what the search for a problem calls.

    Raises:
        PostureOptError: as `PostureSelector.solve`; everything is compiled then too.
    """
    _solved(_selector(problem, None), problem, None)


def _selector(problem: Problem, compiled: bool | None) -> PostureSelector:
    return PostureSelector(problem, compiled=compiled, offers=False, explains=False)


def _solved(selector: PostureSelector, problem: Problem, known: Array | None) -> Solution:
    target = selector.target
    if problem.task is not None and problem.task.position is not None:
        target = target.with_position(np.array(problem.task.position, dtype=float))
    return replace(selector.solve_target(target, problem.solver.seed, STARTS, known), problem=problem)


def all_but_position(problem: Problem) -> object:
    """What a problem states but for where the target is."""
    document = problem.to_dict()
    task = {**(document.get("task") or {})}
    placed = task.pop("position", None) is not None
    return {**document, "task": task}, placed
