"""``Workers``: whoever works on the parts of a computation, so that the computation need not know.

A computation is a sequence of rounds. The parts of one round are computed by a pure function and depend on nothing but
its arguments, so that no answer depends on who computes them, how many do, or in which order. Arguments and results
travel between processes; results of what a checkpoint keeps are lists, dicts, text and numbers, as JSON has them.
"""

from __future__ import annotations

import threading
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from types import TracebackType
from typing import Any, Self

Part = Callable[[Any, Any], Any]
"""``(shared, item) -> result``, a function of a module: other processes import it by its name."""

AHEAD = 64
"""Parts that other machines have at once: enough for any cluster, and memory does not grow with the work."""
_ONE_AT_A_TIME = threading.RLock()  # a part may have parts of its own


class Workers(ABC):
    """Works on the parts of a round, each a pure function of what all parts share and of its own item."""

    @abstractmethod
    def run(self, part: Part, shared: Any, items: Sequence[Any]) -> Iterator[tuple[int, Any]]:
        """The number of each item with ``part(shared, item)``, in the order in which they are done.

        Args:
            shared: sent to every worker; expensive things pickle as their recipe and are built once in each.
        """

    def in_order(self, part: Part, shared: Any, items: Sequence[Any]) -> list[Any]:
        """The results of all items, in their order."""
        done = dict(self.run(part, shared, items))
        return [done[k] for k in range(len(items))]

    def close(self) -> None:  # noqa: B027 # most have nothing to close
        """Let go of what was started for this; nothing runs on."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def worked(part: Part, shared: Any, item: Any) -> Any:
    """One part, and no other at the same time in this process: solvers are not made for threads."""
    with _ONE_AT_A_TIME:
        return part(shared, item)
