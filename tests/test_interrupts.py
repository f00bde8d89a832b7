"""Interrupts that compiled code swallows end the run all the same."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable

import casadi as ca
import numpy as np
import pytest

from posture_opt.interrupts import interruptible
from posture_opt.selection.program.nlp import NonlinearSolver

pytestmark = pytest.mark.skipif(os.name == "nt", reason="signals of POSIX")


def interrupt_after(seconds: float) -> None:
    threading.Timer(seconds, os.kill, (os.getpid(), signal.SIGINT)).start()


def swallowing(seconds: float) -> str:
    """Works for a while and drops whatever is raised meanwhile, as CasADi does."""
    end = time.monotonic() + seconds
    try:
        while time.monotonic() < end:
            time.sleep(0.01)
    except KeyboardInterrupt:
        pass
    return "half an answer"


@interruptible()
def answered(*parts: Callable[[], object]) -> list[object]:
    return [part() for part in parts]


def test_an_interrupt_that_was_swallowed_comes_again() -> None:
    interrupt_after(0.1)
    begun = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        answered(lambda: swallowing(5), lambda: time.sleep(5))
    assert time.monotonic() - begun < 1
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_what_follows_from_an_interrupt_is_one() -> None:
    def misled() -> None:
        swallowing(5)
        raise ImportError("numpy failed to import")

    interrupt_after(0.1)
    with pytest.raises(KeyboardInterrupt):
        answered(misled)
    assert answered(lambda: 1) == [1], "the next one is not interrupted"


def test_cleaning_up_has_its_time() -> None:
    cleaned = []

    def tidy() -> None:
        try:
            time.sleep(5)
        finally:
            time.sleep(0.3)  # longer than the interrupt takes to come again
            cleaned.append("all")

    interrupt_after(0.1)
    with pytest.raises(KeyboardInterrupt):
        answered(tidy)
    assert cleaned == ["all"]


def test_handlers_of_others_go_on_deciding() -> None:
    heard = []
    former = signal.signal(signal.SIGINT, lambda number, frame: heard.append(number))
    try:
        interrupt_after(0.05)
        assert answered(lambda: time.sleep(0.2)) == [None]
    finally:
        signal.signal(signal.SIGINT, former)
    assert heard == [signal.SIGINT]


def test_a_solve_of_ipopt_ends_by_the_interrupt_and_not_by_a_status(capfd: pytest.CaptureFixture[str]) -> None:
    x = ca.SX.sym("x", 40)
    y = x
    for _ in range(60):
        y = ca.sin(y) + ca.cos(y[::-1]) * y
    solver = NonlinearSolver("slow", {"x": x, "f": ca.sumsqr(y), "g": ca.SX(0, 1)}, {"ipopt.max_iter": 100_000})
    far, none = np.full(40, 1e3), np.zeros(0)

    def solves() -> None:
        for seed in range(1000):
            solver.solve(np.random.default_rng(seed).normal(size=40), -far, far, none, none)

    interrupt_after(0.3)
    begun = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        solves()
    assert time.monotonic() - begun < 2
    assert "KeyboardInterrupt" not in "".join(capfd.readouterr())


def test_threads_solve_in_turn() -> None:
    x, p = ca.SX.sym("x", 6), ca.SX.sym("p")
    program = {"x": x, "p": p, "f": ca.sumsqr(x - ca.sin(p * ca.DM(range(6)))), "g": ca.sum1(x**2)}
    solver = NonlinearSolver("shared", program, {})
    far = np.full(6, 10.0)

    def found(k: int) -> np.ndarray:
        return solver.solve(np.ones(6), -far, far, np.array([1.0]), np.array([2.0]), p=float(k)).x

    wanted = [found(k) for k in range(4)]
    answers: dict[tuple[int, int], np.ndarray] = {}
    threads = [
        threading.Thread(target=lambda k=k: answers.update({(k, i): found(k) for i in range(40)})) for k in range(4)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(answers) == 160
    for (k, _), answer in answers.items():
        np.testing.assert_array_equal(answer, wanted[k])
