"""``Run``: how a case ended."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any

from tests.fuzz.case import Case

CPU = 20  # s
MEMORY = 1000  # MB


@dataclass(frozen=True)
class Run:
    """Exit code (negative: that signal), what was printed, CPU [s], peak of memory [MB], and what stayed behind.

    Args:
        left: in words, what should not be there.
        made: new files and folders, with the files' content.
        hidden: keys of JSON documents whose number is not finite; null is written there.
    """

    code: int
    out: str = ""
    err: str = ""
    cpu: float = 0.0
    memory: float = 0.0
    seconds: float = 0.0
    left: tuple[str, ...] = ()
    made: dict[str, bytes] = field(default_factory=dict)
    hidden: tuple[str, ...] = ()

    def with_end(self, cpu: float, memory: float, seconds: float, left: tuple[str, ...]) -> Run:
        """The same with what was seen from outside."""
        return replace(self, cpu=cpu, memory=memory, seconds=seconds, left=(*self.left, *left))


def allowed(name: str, case: Case) -> bool:
    """Whether a case may make a file of this name."""
    if ".posture_opt-" in name:
        return False
    return any(name == made or name.startswith(f"{made}/") for made in (*case.out, *case.kept))


def not_finite(value: Any, key: str = "") -> Iterator[str]:
    """Keys of a document whose number is not finite."""
    if isinstance(value, dict):
        for name, entry in value.items():
            yield from not_finite(entry, f"{key}.{name}" if key else str(name))
    elif isinstance(value, list | tuple):
        for entry in value:
            yield from not_finite(entry, f"{key}[]")
    elif isinstance(value, float) and value - value != 0:
        yield key
