"""What one move of the target costs on the live page: `python -m benchmarks.explore`.

CPU time of the three things that follow a move: the problem with the new target, the solve from the last answer, and
what is sent to the page. 20 pictures a second leave 50 ms.
"""

from __future__ import annotations

import argparse
import statistics
import time

import numpy as np

import posture_opt as po
from benchmarks.machine import machine_line
from benchmarks.tables import table
from posture_opt.explore.answers import Answers, Request, compiled
from posture_opt.explore.explorer import Explorer

PROBLEMS = ("insert_planar_2r_fixed_hole", "insert_panda", "insert_ur10", "insert_ur10_cell")
_CIRCLE_M = 0.06  # radius of the path of the target


def costs(name: str, moves: int) -> list[float]:
    """Medians of problem, solve, page and their sum over a circle of targets [ms of CPU]."""
    with po.load_problem(name).explore(port=18300) as page:
        assert isinstance(page, Explorer)
        page._answers.end()
        compiled(page.problem)  # as another process does while the first answers are interpreted
        answers, start, parts = Answers(lambda _: None), np.array(page.target), []
        try:
            for k in range(moves):
                at = start + _CIRCLE_M * np.array([np.sin(k / 8), np.cos(k / 8) - 1, 0.0])
                parts.append(_move(page, answers, at))
        finally:
            answers.end()
    medians = [
        1e3 * statistics.median(column) for column in zip(*parts[1:], strict=True)
    ]  # the first one loads what was compiled
    return [*medians, sum(medians)]


def _move(page: Explorer, answers: Answers, at: np.ndarray) -> tuple[float, float, float]:
    """CPU seconds of problem, solve and page of one move."""
    began = time.process_time()
    problem = page.problem.replace(task__position=[f"{1e3 * v:.1f} mm" for v in at])
    asked = time.process_time()
    answer = answers.quick(Request(problem))
    solved = time.process_time()
    page.show(answer)
    return asked - began, solved - asked, time.process_time() - solved


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--moves", type=int, default=60)
    moves = parser.parse_args().moves
    rows = [[name, *(found := costs(name, moves)), 1e3 / found[-1]] for name in PROBLEMS]
    print(machine_line("posture_opt", "viser", "numpy"))
    head = ["problem", "problem ms", "solve ms", "page ms", "sum ms", "a second"]
    print(table(head, rows, ("", ".1f", ".1f", ".1f", ".1f", ".0f")))


if __name__ == "__main__":
    main()
