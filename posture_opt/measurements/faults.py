"""What is wrong with one file: alike faults are listed a few times and counted."""

from __future__ import annotations

from typing import NoReturn

from posture_opt.errors import InputError, Issue, KeyPath

_MAX_LISTED_FAULTS = 20
"""A file of another kind has a fault in every cell; what is wrong is seen from the first ones."""
_MAX_ALIKE_FAULTS = 3
"""Faults of one column with one hint that are listed in full."""


class Faults:
    """Issues of one file: of those of one column with one hint the first are kept, all are counted.

    Args:
        file: its name, for every message.
    """

    def __init__(self, file: str) -> None:
        self.file = file
        self.count: int = 0
        self._kept: dict[tuple[str, str], list[Issue]] = {}
        self._more: dict[tuple[str, str], list[int]] = {}

    def add(self, message: str, column: str = "", value: object = None, hint: str = "", line: int = 0,
            id: str = "input.invalid") -> None:  # fmt: skip
        """Add one fault.

        Args:
            message: what is wrong.
            column: the key of the message; empty for the whole file.
            value: what was given.
            hint: how to fix it.
            line: where, from 1; 0 where it concerns no single line.
            id: of the issue, for programs.
        """
        self.count += 1
        alike = (column, hint or message)
        kept = self._kept.setdefault(alike, [])
        if len(kept) < _MAX_ALIKE_FAULTS or not line:
            key: KeyPath = (column,) if column else ()
            kept.append(Issue(message, key, value, hint, self.file, line, id))
        else:
            self._more.setdefault(alike, []).append(line)

    def refuse(self) -> None:
        """Ends the reading where anything was wrong.

        Raises:
            InputError: the issues in the order of their lines, and how many more there are.
        """
        if not self.count:
            return
        issues = sorted((issue for kept in self._kept.values() for issue in kept), key=lambda issue: issue.line)
        rest = [self._rest_issue(alike, lines) for alike, lines in self._more.items()]
        listed, left = issues[:_MAX_LISTED_FAULTS], len(issues) - _MAX_LISTED_FAULTS
        if left > 0:
            rest.append(Issue(f"{left} more {'fault' if left == 1 else 'faults'}", file=self.file))
        raise InputError([*listed, *rest])

    def _rest_issue(self, alike: tuple[str, str], lines: list[int]) -> Issue:
        """How many more faults of one kind there are, and where."""
        many = f"{len(lines)} more {'row' if len(lines) == 1 else 'rows'} like these"
        where = f"line {lines[0]}" if len(lines) == 1 else f"lines {min(lines)} to {max(lines)}"
        return Issue(f"{many} ({where})", (alike[0],) if alike[0] else (), file=self.file)

    def stop(self, message: str, hint: str = "", line: int = 0) -> NoReturn:
        """Add a fault behind which nothing more can be read.

        Raises:
            InputError: always, with all faults so far.
        """
        self.add(message, hint=hint, line=line)
        self.refuse()
        raise AssertionError("a fault was added")
