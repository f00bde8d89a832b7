"""What is wrong with one file: alike faults are told a few times and counted."""

from __future__ import annotations

from typing import Any, NoReturn

from posture_opt.errors import InputError, Issue, KeyPath

_LISTED = 20  # a file of another kind has a fault in every cell; what is wrong is seen from the first ones
_ALIKE = 3  # faults of one column with one hint that are listed in full


class Faults:
    """Issues of one file: of those of one column with one hint the first are kept, all are counted."""

    def __init__(self, file: str) -> None:
        self.file = file
        self.count: int = 0
        self._kept: dict[tuple[str, str], list[Issue]] = {}
        self._more: dict[tuple[str, str], list[int]] = {}

    def add(self, message: str, column: str = "", value: Any = None, hint: str = "", line: int = 0) -> None:
        """One more fault; ``column`` is the key of the message."""
        self.count += 1
        alike = (column, hint or message)
        kept = self._kept.setdefault(alike, [])
        if len(kept) < _ALIKE or not line:
            key: KeyPath = (column,) if column else ()
            kept.append(Issue(message, key, value, hint, self.file, line))
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
        rest = [self._rest(alike, lines) for alike, lines in self._more.items()]
        told, left = issues[:_LISTED], len(issues) - _LISTED
        if left > 0:
            rest.append(Issue(f"{left} more {'fault' if left == 1 else 'faults'}", file=self.file))
        raise InputError([*told, *rest])

    def _rest(self, alike: tuple[str, str], lines: list[int]) -> Issue:
        """How many more faults of one kind there are, and where."""
        many = f"{len(lines)} more {'row' if len(lines) == 1 else 'rows'} like these"
        where = f"line {lines[0]}" if len(lines) == 1 else f"lines {min(lines)} to {max(lines)}"
        return Issue(f"{many} ({where})", (alike[0],) if alike[0] else (), file=self.file)

    def stop(self, message: str, hint: str = "", line: int = 0) -> NoReturn:
        """A fault behind which nothing more can be read."""
        self.add(message, hint=hint, line=line)
        self.refuse()
        raise AssertionError("a fault was added")
