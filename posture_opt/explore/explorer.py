"""``Explorer``: the handle of a live page; ``explore`` starts one."""

from __future__ import annotations

import threading
import webbrowser
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from posture_opt.collision.scene import narrowest
from posture_opt.errors import InputError, Issue
from posture_opt.explore.answers import Answer, Answers, Request, has_stations
from posture_opt.explore.live_scene import LiveScene
from posture_opt.explore.panel import Actions, Panel
from posture_opt.explore.server import served, stop
from posture_opt.explore.taken_away import TakenAway, millimetres, places_of, position_of
from posture_opt.measurements.measurements import Measurements
from posture_opt.numerics import Array
from posture_opt.problem.problem import Problem
from posture_opt.problem.yaml_source import Plain
from posture_opt.report.scene.arm_geometry import ArmGeometry
from posture_opt.report.scene.arm_solids import ArmSolids
from posture_opt.robot.posture import Posture, drawn_between
from posture_opt.selection.answer.solution import Solution
from posture_opt.uncertainty.spread import Spread, propagate

_TARGET = "target"  # The group of keys that a command line states by options


class Explorer:
    """A live page, and what it shows."""

    def __init__(
        self, problem: Problem, host: str = "127.0.0.1", port: int = 8080, data: Measurements | None = None
    ) -> None:
        places = places_of(problem)
        spread = propagate(problem, posture_near(problem, places[0] if len(places) else None))
        geometry = ArmGeometry.of_spread(spread)
        self._stated = self._problem = problem
        self._changes: dict[str, dict[str, Plain]] = {}  # by groups of keys
        self._away = TakenAway(problem)
        self._guard, self._drawing = threading.RLock(), threading.Lock()  # what is asked; one picture at a time
        self._closed = threading.Event()
        self._solution: Solution | None = None
        self._shown: Answer | None = None
        self._served = served(host, port, f"posture_opt: {problem.name}")
        self._server = self._served.viser
        arm = ArmSolids(spread.tool_point.robot)
        self._cell = problem.scene
        self._panel = Panel(self._server, problem, geometry, self._actions(), data is not None)
        obstacle_moved = self._panel.obstacles.move
        if data is not None:
            places = np.concatenate([places, np.atleast_2d(problem.arm.position(data.q))])
        self._scene = LiveScene(self._server, geometry, arm, self._dragged, obstacle_moved, places)
        self._scene.cell.show(self._cell)
        stated = position_of(problem)
        self._target = np.array(spread.position if stated is None else stated)
        self._show_target(self._target)
        self._scene.show(spread)
        self._scene.fade()
        self._scene.handle.visible = not has_stations(problem)
        self._answers = Answers(self._answered)
        self._request = Request(problem)
        self._answers.ask(self._request)
        if data is not None:
            self._panel.measured.show(data)

    @property
    def url(self) -> str:
        """The address of the page."""
        return self._served.url

    @property
    def reach(self) -> str:
        """Who else than this machine can open the page, as a sentence; empty where nobody can."""
        return self._served.reach

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
        self._show_target(place)

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
        return self._away.command(self.problem, any(v for group, v in self._changes.items() if group != _TARGET))

    def wait(self) -> None:
        """Return when the page was closed."""
        while not self._closed.wait(timeout=0.2):
            pass

    def close(self) -> None:
        """End the page, and everything that it computes."""
        if not self._closed.is_set():
            self._closed.set()
            self._panel.map.end()
            self._panel.measured.end()
            if self._panel.stations is not None:
                self._panel.stations.end()
            self._answers.end()
            stop(self._server)

    def __enter__(self) -> Explorer:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _dragged(self, place: Array) -> None:
        if self._tried(place):
            self._panel.place(place)

    def _typed(self, place: Array) -> None:
        if self._tried(place):
            self._scene.handle.position = tuple(place)

    def _show_target(self, place: Array) -> None:
        self._scene.handle.position = tuple(place)
        self._panel.place(place)

    def _tried(self, place: Array) -> bool:
        """Have a target solved that somebody put there; one that no problem can have is refused, in words."""
        try:
            self._ask(place)
        except InputError as error:
            self._show_target(self._target)
            self._panel.say(str(error))
            return False
        return True

    def _actions(self) -> Actions:
        return Actions(
            moved=self._typed, changed=self.change, turned=self.turn, redraw=self._redraw,
            chosen=lambda place: self._scene.cell.choose(place),
            save=lambda: self._away.save(self.problem), report=lambda: self._away.report(self.solution),
            picture=self._away.picture, command=self.command, asked=lambda: self.problem,
        )  # fmt: skip

    def _ask(self, place: Array) -> None:
        """Have the target solved, in tenths of a millimetre: what a file says of it is what was solved."""
        problem = self._replaced(_TARGET, {"task__position": millimetres(place)})
        with self._guard:
            self._target = np.array(position_of(problem))
        self._put(Request(problem))

    def change(self, group: str, values: dict[str, Plain]) -> bool:
        """Have the same target solved with other values at some keys of the problem file."""
        try:
            problem = self._replaced(group, values)
        except InputError as error:
            self._panel.say(str(error))
            return False
        self._panel.obstacles.follow(problem)
        if group == "obstacles":
            with self._drawing:
                self._cell = problem.scene
                self._scene.cell.show(self._cell)
        self._put(Request(problem))
        return True

    def _replaced(self, group: str, values: dict[str, Plain]) -> Problem:
        with self._guard:
            changes = {**self._changes, group: values}
            every = {key: value for part in changes.values() for key, value in part.items()}
            problem = self._stated.replace(**every) if every else self._stated
            self._changes, self._problem = changes, problem
            return problem

    def turn(self, q: tuple[float, ...] | None) -> None:
        """Show a posture of the user's own; None: go back to the best one."""
        self._put(Request(self.problem, q))

    def _put(self, request: Request) -> None:
        with self._guard:
            self._request = request
        self._answers.ask(request)

    def _answered(self, answer: Answer) -> None:
        with self._guard:
            late = answer.request is not self._request
            if self._closed.is_set() or (late and not has_stations(answer.request.problem)):
                return
            answer = replace(answer, whole=answer.whole and not late)  # stations take too long to be left out
            self._shown, self._solution = answer, answer.solution
        found = answer.solution
        if found is not None and not found.points and position_of(answer.request.problem) is None:
            with self._guard:  # the task asks for no place: the handle is where the tool point is
                self._target = np.array(found.spread.position)
            self._show_target(self._target)
        self._draw(answer)
        self._panel.show(answer)

    def _redraw(self) -> None:
        if self._shown is not None:
            self._draw(self._shown)

    def _draw(self, answer: Answer) -> None:
        with self._drawing:
            shown: Spread | Solution | None = answer.own or answer.solution
            if isinstance(shown, Solution) and shown.points and self._panel.stations is not None:
                shown = self._panel.stations.show(shown, bool(self._changes.get("placement")))
            self._scene.cell.show_gap(None if shown is None else narrowest(self._cell, np.asarray(shown.q)))
            if shown is not None:
                self._scene.show(shown, self._panel.layers)
            else:
                self._scene.fade(None if answer.nearest is None else answer.nearest.spread.position)


def explore(
    problem: Problem, *, host: str = "127.0.0.1", port: int = 8080, browser: bool = True,
    data: Measurements | None = None,
) -> Explorer:  # fmt: skip
    """A live page of a problem: drag the target, and the best posture follows."""
    page = Explorer(problem, host, port, data=data)
    if browser:
        webbrowser.open_new_tab(page.url)
    return page


def posture_near(problem: Problem, place: Sequence[float] | None) -> Array:
    """A posture (n,) [rad or m] whose tool point is near a place [m]: of random ones the nearest that is clear."""
    robot = problem.robot
    low, high = drawn_between(robot)
    Q = np.random.default_rng(0).uniform(low, high, (2000, robot.n))  # takes some ms
    points = np.asarray(problem.arm.position(Q))
    middle = points[points[:, 0] >= min(0.0, points[:, 0].max())].mean(axis=0) if place is None else np.asarray(place)
    away = np.linalg.norm(points - middle, axis=1)
    Q = Q[np.argsort(away, kind="stable")[:50]]
    return np.asarray(Q[int(np.argmax(problem.scene.least(Q) > 0.0))])
