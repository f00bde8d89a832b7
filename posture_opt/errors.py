"""Every error that posture_opt raises on purpose.

::

    PostureOptError
    ├── InputError             bad input or usage                    exit code 2
    ├── NoSolutionError        the problem has no solution           exit code 3
    ├── InsufficientDataError  the data do not suffice               exit code 4
    └── SolverError            the solver failed, which is no proof  exit code 1
                               that the problem has no solution
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

KeyPath = tuple[str | int, ...]


@dataclass(frozen=True)
class Issue:
    """One thing wrong with the input, with everything that is known about its place.

    ``key`` is the path of the entry in the file, e.g. ``("task", "direction")`` or
    ``("robot", "joints", 0, "a")``; ``mend`` says what to write instead.
    """

    message: str
    key: KeyPath = ()
    value: Any = None
    mend: str = ""
    file: str = ""
    line: int = 0

    def __str__(self) -> str:
        place = f"{self.file}:{self.line}: " if self.file and self.line else f"{self.file}: " if self.file else ""
        key = f"{key_text(self.key)}: " if self.key else ""
        mend = f" – {self.mend}" if self.mend else ""
        return f"{place}{key}{self.message}{mend}"

    @classmethod
    def told(cls, text: str, key: KeyPath, value: Any = None) -> Issue:
        """The issue of a validator, which writes ``what is wrong; how to mend it``."""
        message, _, mend = text.partition("; ")
        return cls(message, key, value, mend)

    def at(self, *prefix: str | int) -> Issue:
        """The same issue with ``prefix`` put before its key path."""
        return replace(self, key=(*prefix, *self.key))

    def placed(self, file: str, line: int) -> Issue:
        """The same issue in ``file``, at ``line`` unless it knows its own."""
        return replace(self, file=file, line=self.line or line)


def key_text(key: KeyPath) -> str:
    """A key path as people write it: ``robot.joints[0].a``."""
    text = ""
    for part in key:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else part
    return text


class PostureOptError(Exception):
    """Base of all errors raised on purpose; ``exit_code`` is what the command line returns."""

    exit_code = 1


class InputError(PostureOptError):
    """Input that cannot be used; ``issues`` lists everything wrong with it, not only the first thing."""

    exit_code = 2

    def __init__(self, issues: Iterable[Issue] | Issue | str) -> None:
        if isinstance(issues, str):
            issues = Issue(issues)
        self.issues: tuple[Issue, ...] = (issues,) if isinstance(issues, Issue) else tuple(issues)
        super().__init__("\n".join(map(str, self.issues)))


class NoSolutionError(PostureOptError):
    """No posture meets the requirements; ``solution`` is the infeasible result with the reasons in words."""

    exit_code = 3

    def __init__(self, message: str, solution: Any = None) -> None:
        super().__init__(message)
        self.solution = solution


class InsufficientDataError(PostureOptError):
    """The measurements cannot answer the question; the message says what to measure."""

    exit_code = 4


class SolverError(PostureOptError):
    """The solver gave up although a feasible posture is known."""
