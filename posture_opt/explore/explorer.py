"""``Explorer``: the handle of a live page; ``explore`` starts one."""

from __future__ import annotations

import shlex
import threading
import webbrowser
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from posture_opt.errors import InputError, Issue
from posture_opt.explore.answers import Answer, Answers, Request
from posture_opt.explore.live_scene import LiveScene
from posture_opt.explore.panel import Panel
from posture_opt.explore.server import server, stop
from posture_opt.explore.settings import settings_of
from posture_opt.files import problems_folder
from posture_opt.numerics import Array
from posture_opt.output import write_file
from posture_opt.problem.plain_data import Plain
from posture_opt.problem.problem import Problem
from posture_opt.report.scene.arm_geometry import ArmGeometry
from posture_opt.report.scene.arm_solids import ArmSolids
from posture_opt.robot.posture import Posture
from posture_opt.selection.answer.selector import PostureSelector
from posture_opt.selection.answer.solution import Solution

DEFAULT_PORT = 8080
_EXPLORED = "_explored"
"""What the name of a saved problem ends in."""


class Explorer:
    """A live page, and what it shows.

    ``target`` can be set, and the page follows; ``solution`` is the latest answer.

    Args:
        problem: with a task of one target.
        host, port: where the page is served; the next free port is taken.
        folder: where "Save problem" writes to.

    Raises:
        InputError: the task has several targets, viser is missing, or the page cannot be served.
        NoSolutionError: there is no posture to begin with.
    """

    def __init__(self, problem: Problem, host: str = "127.0.0.1", port: int = DEFAULT_PORT, folder: Path | None = None):
        first = PostureSelector(problem, compiled=False, offers=False).solve()
        self._stated = self._problem = problem
        self._changes: dict[str, Plain] = {}
        self._folder = folder or Path()
        self._guard, self._drawing = threading.RLock(), threading.Lock()  # what is asked; one picture at a time
        self._closed = threading.Event()
        self._solution: Solution | None = first
        self._shown: Answer | None = None
        self._server = server(host, port, f"posture_opt: {problem.name}")
        arm = ArmSolids(first.spread.tool_point.robot)
        self._scene = LiveScene(self._server, ArmGeometry.of_solution(first), arm, self._dragged)
        self._panel = Panel(
            self._server, problem.name, self._typed, self._changed, self.turn, self._redraw,
            self._save, self._report, self.command,
            problem.robot.joints, settings_of(problem),
        )  # fmt: skip
        stated = _position(problem)
        self._target = np.array(first.spread.position if stated is None else stated)
        self._scene.place_handle(self._target)
        self._panel.place(self._target)
        self._scene.show(first)
        self._answers = Answers(self._answered)
        self._request = Request(problem)
        self._answers.ask(self._request)

    @property
    def url(self) -> str:
        """The address of the page."""
        return f"http://{self._server.get_host()}:{self._server.get_port()}"

    @property
    def problem(self) -> Problem:
        """What is asked at the moment."""
        with self._guard:
            return self._problem

    @property
    def target(self) -> tuple[float, float, float]:
        """Where the tool point is asked for, x, y, z [m], world; the page follows what is set."""
        with self._guard:
            x, y, z = (float(v) for v in self._target)
        return x, y, z

    @target.setter
    def target(self, position: Sequence[float]) -> None:
        place = np.asarray(position, dtype=float)
        if place.shape != (3,) or not np.all(np.isfinite(place)):
            raise InputError(Issue("the target is not three finite numbers", ("target",), position))
        self._ask(place)
        self._scene.place_handle(place)
        self._panel.place(place)

    @property
    def solution(self) -> Solution | None:
        """The latest answer; None while none is feasible."""
        with self._guard:
            return self._solution

    @property
    def posture(self) -> Posture | None:
        """The posture of the latest answer; None while none is feasible."""
        found = self.solution
        return None if found is None else found.posture

    def command(self) -> str:
        """The command line that gives the answer to what is asked."""
        problem = self.problem
        saved = set(self._changes) - {"task__position"}  # what no option states
        file = f"{_stem(problem)}{_EXPLORED}.yaml" if saved else _named(problem)
        words = ["optimize-posture", "--problem", file]
        if _position(problem) is not None and not saved:
            words += ["--position", ", ".join(_millimetres(self.target))]
        return shlex.join(words) + ("   # once the problem is saved" if saved else "")

    def end_search(self) -> None:
        """Solve nothing more: the page stays as it is."""
        self._answers.end()

    def wait(self) -> None:
        """Return when the page was closed."""
        while not self._closed.wait(timeout=0.2):
            pass

    def close(self) -> None:
        """End the page, and everything that it computes."""
        if not self._closed.is_set():
            self._closed.set()
            self._answers.end()
            stop(self._server)

    def __enter__(self) -> Explorer:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _dragged(self, place: Array, _let_go: bool) -> None:
        self._ask(place)
        self._panel.place(place)

    def _typed(self, place: Array) -> None:
        self._ask(place)
        self._scene.place_handle(place)

    def _ask(self, place: Array) -> None:
        """Have the target solved, in tenths of a millimetre: what a file says of it is what was solved."""
        self._changes = {**self._changes, "task__position": _millimetres(place)}
        problem = self._stated.replace(**self._changes)
        with self._guard:
            self._problem, self._target = problem, np.array(_position(problem))
        self._put(Request(problem))

    def _changed(self, changes: dict[str, Plain]) -> None:
        """Have the same target solved with other errors, or another task."""
        kept = {key: value for key, value in self._changes.items() if key == "task__position"}
        self._changes = {**kept, **changes}
        problem = self._stated.replace(**self._changes) if self._changes else self._stated
        with self._guard:
            self._problem = problem
        self._put(Request(problem))

    def turn(self, q: tuple[float, ...] | None) -> None:
        """Show a posture of the user's own; None: go back to the best one."""
        self._put(Request(self.problem, q))

    def _put(self, request: Request) -> None:
        with self._guard:
            self._request = request
        self._answers.ask(request)

    def _answered(self, answer: Answer) -> None:
        """Show an answer, unless something else is asked by now."""
        with self._guard:
            if answer.request is not self._request or self._closed.is_set():
                return
            self._shown, self._solution = answer, answer.solution
        self.show(answer)

    def show(self, answer: Answer) -> None:
        """Show an answer, in the scene and in numbers."""
        self._draw(answer)
        self._panel.show(answer)

    def _redraw(self) -> None:
        """The latest answer once more, with the layers that are asked for now."""
        if self._shown is not None:
            self._draw(self._shown)

    def _draw(self, answer: Answer) -> None:
        """Show an answer in the scene: from the thread that solves, or from that of a checkbox."""
        with self._drawing:
            self._drawn(answer)

    def _drawn(self, answer: Answer) -> None:
        if answer.own is not None:
            self._scene.show_own(answer.own, self._panel.layers)
        elif answer.solution is None:
            self._scene.fade(None if answer.nearest is None else answer.nearest.spread.position)
        else:
            self._scene.show(answer.solution, self._panel.layers)

    def _save(self) -> str:
        """Write the problem with what it needs into the folder that the program was started in."""
        stem = f"{_stem(self._problem)}{_EXPLORED}"
        try:
            for name, content in self.problem.files(stem).items():
                write_file(self._folder / name, content)
        except InputError as error:
            return str(error)
        return f"{stem}.yaml written to {self._folder.resolve()}"

    def _report(self) -> str:
        """Write the report of the latest answer into a folder of that where the program was started."""
        found = self.solution
        if found is None:
            return "There is no posture to report."
        folder = self._folder / f"{_stem(self._problem)}{_EXPLORED}"
        try:
            found.save(folder)
        except InputError as error:
            return str(error)
        return f"Report written to {folder.resolve()}"


def explore(problem: Problem, *, host: str = "127.0.0.1", port: int = DEFAULT_PORT, browser: bool = True) -> Explorer:
    """A live page of a problem: drag the target, and the best posture follows.

    Args:
        problem: with a task of one target.
        host: an address of this machine.
        port: the next free one is taken.
        browser: whether a browser is opened.

    Raises:
        InputError, NoSolutionError: as `Explorer`.
    """
    page = Explorer(problem, host, port)
    if browser:
        webbrowser.open_new_tab(page.url)
    return page


def _position(problem: Problem) -> tuple[float, ...] | None:
    """Where the task asks the tool point for [m]; None where it may be anywhere."""
    return None if problem.task is None or problem.task.position is None else tuple(problem.task.position)


def _millimetres(place: Sequence[float] | Array) -> list[str]:
    """A place [m] in tenths of a millimetre, as files write it."""
    return [f"{1e3 * v + 0.0:.1f} mm" for v in np.round(np.asarray(place, dtype=float), 4) + 0.0]


def _named(problem: Problem) -> str:
    """The file of a problem, as a command line names it; of a built-in one the name."""
    file = Path(problem.origin.file or problem.name)
    return file.stem if file.parent == problems_folder() else str(file)


def _stem(problem: Problem) -> str:
    """The name of the file of a problem, or a plain word."""
    return Path(problem.origin.file).stem if problem.origin.file else "problem"
