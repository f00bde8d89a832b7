"""Every error that posture_opt raises on purpose, and what was probably meant in place of a mistyped name.

::

    PostureOptError
    ├── InputError             bad input or usage                    exit code 2
    ├── NoSolutionError        the problem has no solution           exit code 3
    ├── InsufficientDataError  the data do not suffice               exit code 4
    └── SolverError            the solver failed, which is no proof  exit code 1
                               that the problem has no solution

``BadValueError`` never leaves the program: it says what is wrong with one entry before its key and file are known.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

KeyPath = tuple[str | int, ...]  # Keys and list indices from the root of a file to an entry


@dataclass(frozen=True)
class Issue:
    """One thing wrong with the input, with everything that is known about its place.

    Args:
        message: what is wrong, without the place.
        key: path of the entry in the file, e.g. ``("task", "direction")`` or ``("robot", "joints", 0, "a")``.
        value: what was given.
        hint: what to write instead.
        file: name of the file; ``line`` counts from 1, 0 where no line is known.
        id: ``room.what``, by which programs know it.

    Example:
        >>> print(Issue("the angle has no unit", ("joints", 0, "alpha"), 90, "write 90 deg", "arm.yaml", 7))
        arm.yaml:7: joints[0].alpha: the angle has no unit – write 90 deg
    """

    message: str
    key: KeyPath = ()
    value: object = None
    hint: str = ""
    file: str = ""
    line: int = 0
    id: str = "input.invalid"

    def __str__(self) -> str:
        """``file:line: key: message – hint``, without the parts that are not known."""
        place = f"{self.file}:{self.line}: " if self.file and self.line else f"{self.file}: " if self.file else ""
        key = f"{key_text(self.key)}: " if self.key else ""
        hint = f" – {self.hint}" if self.hint else ""
        text = f"{place}{key}{self.message}{hint}"
        # No control characters, which terminals obey or hide.
        return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)

    def to_json(self) -> dict[str, Any]:
        """The entry of ``issues`` in the document of an error; what is not known is null."""
        return {
            "id": self.id,
            "file": self.file or None,
            "line": self.line or None,
            "key": key_text(self.key) or None,
            "value": None if self.value is None else as_given(self.value),
            "message": self.message,
            "hint": self.hint or None,
        }

    def at(self, *prefix: str | int) -> Issue:
        """The same issue with ``prefix`` put before its key path."""
        return replace(self, key=(*prefix, *self.key))

    def placed(self, file: str, line: int) -> Issue:
        """The same issue in ``file``, at ``line`` unless it knows its own."""
        return replace(self, file=file, line=self.line or line)


def key_text(key: KeyPath) -> str:
    """A key path as people write it.

    Example:
        >>> key_text(("robot", "joints", 0, "a"))
        'robot.joints[0].a'
    """
    text = ""
    for part in key:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else part
    return text


def as_given(value: object) -> str:
    """A value in the words of the file: ``'text'``, ``true``, ``a list of 3``; texts are cut at 40 characters."""
    if isinstance(value, list | tuple | Mapping):
        return "a mapping" if isinstance(value, Mapping) else f"a list of {len(value)}"
    if value is None or isinstance(value, bool):
        return "nothing" if value is None else str(value).lower()
    text = str(value)
    return f"'{text[:40]}{'…' if len(text) > 40 else ''}'" if isinstance(value, str) else text


class BadValueError(ValueError):
    """A value that an entry cannot have: what is wrong and how to fix it, as two fields.

    A ValueError, because validators have to raise one; it becomes an ``Issue`` where the key of the entry is known.

    Args:
        message: what is wrong.
        hint: what to write instead; may be empty.
    """

    def __init__(self, message: str, hint: str = "") -> None:
        super().__init__(f"{message}; {hint}" if hint else message)
        self.message: str = message
        self.hint: str = hint

    def issue(self, key: KeyPath, value: object = None) -> Issue:
        """The issue about the entry at ``key``, which holds ``value``."""
        return Issue(self.message, key, value, self.hint)


MOST_TOLD = 20  # issues: a file of another kind is wrong throughout, as the first ones show


class PostureOptError(Exception):
    """Base of all errors raised on purpose; ``exit_code`` is what the command line returns.

    Example:
        >>> from posture_opt import load_problem
        >>> try:
        ...     load_problem("insert_planar_2x")
        ... except PostureOptError as error:
        ...     print(error.exit_code)
        2
    """

    exit_code = 1
    # What the document of this error has besides, where not to have an answer is one.
    answer: Mapping[str, Any] = MappingProxyType({})

    def to_json(self) -> dict[str, Any]:
        """The document of this error: its exit code and its issues."""
        ids = {3: "selection.no-solution", 4: "measurements.insufficient"}
        issues = getattr(self, "issues", ()) or (Issue(str(self), id=ids.get(self.exit_code, "input.invalid")),)
        told, left = [issue.to_json() for issue in issues[:MOST_TOLD]], len(issues) - MOST_TOLD
        more = {"more": left} if left > 0 else {}
        return {**self.answer, "error": {"code": self.exit_code, "issues": told, **more}}


class InputError(PostureOptError):
    """Input that cannot be used.

    Args:
        issues: everything wrong with it, not only the first thing; a plain text is one issue without a place. Its text
            has the first 20, and how many more there are, and so has its document.
    """

    exit_code = 2

    def __init__(self, issues: Iterable[Issue] | Issue | str) -> None:
        if isinstance(issues, str):
            issues = Issue(issues)
        self.issues: tuple[Issue, ...] = (issues,) if isinstance(issues, Issue) else tuple(issues)
        lines, left = [str(issue) for issue in self.issues[:MOST_TOLD]], len(self.issues) - MOST_TOLD
        super().__init__("\n".join([*lines, f"and {left} more"] if left > 0 else lines))


class NoSolutionError(PostureOptError):
    """No posture meets the requirements.

    Args:
        message: which requirement fails, and by how much.
        solution: the infeasible result with the reasons in words.
    """

    exit_code = 3
    shown = False  # whether the document of the solution stands on standard output

    def __init__(self, message: str, solution: Any = None) -> None:
        super().__init__(message)
        self.solution = solution


class InsufficientDataError(PostureOptError):
    """The measurements cannot answer the question; the message says what to measure."""

    exit_code = 4


class SolverError(PostureOptError):
    """The solver failed although a feasible posture is known: no proof that the problem has no solution."""


def nearest(word: str, known: Iterable[str]) -> str:
    """The known name written most like ``word``, case ignored; empty where none is like it.

    Likeness is difflib's ratio, at least 0.6, its own default.
    """
    by_lower = {name.lower(): name for name in known}
    found = difflib.get_close_matches(word.lower(), by_lower, 1, 0.6)
    return by_lower[found[0]] if found else ""


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """``did you mean 'x'?``, or the list of what is known where nothing is like ``word``."""
    names = list(known)
    name = nearest(word, names)
    if name:
        return f"did you mean '{name}'?"
    return f"known are {listed(names)}" if names else "none is known"


def either(names: Iterable[str]) -> str:
    """Names as alternatives.

    Example:
        >>> either(["a", "b", "c"])
        "'a', 'b' or 'c'"
    """
    return enumerated((f"'{name}'" for name in names), "or")


def one_of(word: str, known: Iterable[str], what: str = "one of") -> str:
    """The nearest name where one is like ``word``, and all that are known.

    Example:
        >>> one_of("elbo", ["shoulder", "elbow"])
        "did you mean 'elbow'? one of: shoulder, elbow"
    """
    names = list(known)
    name = nearest(word, names)
    return (f"did you mean '{name}'? " if name else "") + f"{what}: {listed(names)}"


def enumerated(words: Iterable[str], last: str = "and") -> str:
    """Words in one text; empty without any.

    Example:
        >>> enumerated(["a", "b", "c"])
        'a, b and c'
        >>> enumerated(["a", "b", "c"], "or")
        'a, b or c'
    """
    *others, end = [*words] or [""]
    return f"{', '.join(others)} {last} {end}" if others else end


def listed(names: Iterable[str], most: int = 40) -> str:
    """The first ``most`` names of a list, as text, and how many there are where that is not all."""
    every = list(names)
    return ", ".join(every[:most]) + (f", … ({len(every)} in all)" if len(every) > most else "")
