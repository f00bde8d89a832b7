"""Everything wrong with one file of measurements, gathered while it is read."""

from __future__ import annotations

from typing import Any, NoReturn

from posture_opt.errors import InputError, Issue, KeyPath

_LISTED = 20  # a column of texts has a fault in every row; what is wrong is seen from the first ones


class Faults:
    """Issues of one file: the first ones are kept, all are counted."""

    def __init__(self, file: str) -> None:
        self.file = file
        self.count = 0
        self._kept: list[Issue] = []

    def add(self, message: str, column: str = "", value: Any = None, mend: str = "", line: int = 0) -> None:
        """One more fault; ``column`` is the key of the message."""
        self.count += 1
        if len(self._kept) < _LISTED:
            key: KeyPath = (column,) if column else ()
            self._kept.append(Issue(message, key, value, mend, self.file, line))

    def refuse(self) -> None:
        """Ends the reading where anything was wrong.

        Raises:
            InputError: the issues in the order of their lines, and how many more there are.
        """
        if not self.count:
            return
        issues = sorted(self._kept, key=lambda issue: issue.line)
        if more := self.count - len(issues):
            issues.append(Issue(f"{more} more {'fault' if more == 1 else 'faults'} of this kind", file=self.file))
        raise InputError(issues)

    def stop(self, message: str, mend: str = "", line: int = 0) -> NoReturn:
        """A fault behind which nothing more can be read."""
        self.add(message, mend=mend, line=line)
        self.refuse()
        raise AssertionError("a fault was added")
