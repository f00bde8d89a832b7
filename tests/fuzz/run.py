"""``Run``: how a case ended."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from tests.fuzz.case import Case

CPU = 20  # s
MEMORY = 1000  # MB


@dataclass(frozen=True)
class Run:
    """Exit code (negative: that signal), what was printed, CPU [s], peak of memory [MB], and what stayed behind.

    Args:
        left: in words, what should not be there.
        made: new files and folders, with the files' content.
    """

    code: int
    out: str = ""
    err: str = ""
    cpu: float = 0.0
    memory: float = 0.0
    seconds: float = 0.0
    left: tuple[str, ...] = ()
    made: dict[str, bytes] = field(default_factory=dict)

    def with_end(self, cpu: float, memory: float, seconds: float, left: tuple[str, ...]) -> Run:
        """The same with what was seen from outside."""
        return replace(self, cpu=cpu, memory=memory, seconds=seconds, left=(*self.left, *left))


def allowed(name: str, case: Case) -> bool:
    """Whether a case may make a file of this name."""
    if ".posture_opt-" in name:
        return False
    return any(name == made or name.startswith(f"{made}/") for made in (*case.out, *case.kept))
