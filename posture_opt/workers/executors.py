"""``ExecutorWorkers``: any executor of `concurrent.futures`."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, CancelledError, Future, wait
from concurrent.futures import Executor as FuturesExecutor
from itertools import islice

from posture_opt.errors import InputError, Issue
from posture_opt.workers import MAX_SUBMITTED_PARTS, Part, R, S, T, Workers, worked


class ExecutorWorkers(Workers):
    """Works on parts wherever an executor sends them; it is not shut down."""

    def __init__(self, executor: FuturesExecutor) -> None:
        self._executor = executor

    def run(self, part: Part[S, T, R], shared: S, items: Sequence[T]) -> Iterator[tuple[int, R]]:
        """As of `Workers`."""
        numbers, running = iter(range(len(items))), dict[Future[R], int]()
        try:
            while True:
                for k in islice(numbers, MAX_SUBMITTED_PARTS - len(running)):
                    running[self._executor.submit(worked, part, shared, items[k])] = k
                if not running:
                    return
                for future in wait(running, return_when=FIRST_COMPLETED).done:
                    yield running.pop(future), future.result()
        except (BrokenExecutor, CancelledError) as error:
            hint = "start it again; what a --checkpoint holds is not lost"
            raise InputError(Issue(f"the executor lost its workers ({type(error).__name__})", hint=hint)) from error
        finally:
            for future in running:
                future.cancel()
