"""What of a problem file can be read where some of it cannot: so that all the rest is checked in the same run.

What the schema refuses is left out entry by entry, the remainder is read, and issues about it are given the numbers
that the entries have in the file.
"""

from __future__ import annotations

import copy
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

from posture_opt.errors import Issue, KeyPath
from posture_opt.problem.issues import schema_issues
from posture_opt.problem.plain_data import Plain, Section

_SEPARABLE_LISTS: tuple[KeyPath, ...] = (
    ("effects",),
    ("task", "minimize"),
    ("task", "subject_to"),
    ("task", "features"),
    ("robot", "shape"),
    ("robot", "shape", "add"),
    ("robot", "shape", "replace"),
    ("cell", "obstacles"),
    ("data", "distances"),
)
"""Lists whose entries speak for themselves: one that cannot be read leaves the others."""

_STAND_IN_VALUES: Section = {"mass": "1 kg", "com": [0, 0, 0]}
"""Values of a joint that replace one that cannot be read, where leaving it out would be a fault of its own."""


@dataclass(frozen=True)
class Readable:
    """Sections that fit the schema, what does not fit left out of them.

    Args:
        data: the sections that are left.
        broken: sections of which something was left out.
        kept: of each list with entries left out, the numbers that the others had.
    """

    data: Section
    broken: frozenset[str]
    kept: Mapping[KeyPath, tuple[int, ...]]

    @classmethod
    def of(cls, data: Mapping[str, Plain], found: Iterable[Issue]) -> Readable:
        """What is left of ``data`` without what the issues ``found`` are about."""
        keys = [issue.key for issue in found if issue.key]
        left = copy.deepcopy(dict(data))
        entries = {key: path for key in keys for path in _SEPARABLE_LISTS if _is_entry(key, path)}
        kept = {path: _thinned(left, path, keys) for path in dict.fromkeys(entries.values())}
        for key in keys:
            if key not in entries:
                _left_out(left, key)
        for issue in schema_issues(left) if keys and "robot" in left else ():  # what could not do without it
            left.pop(str(issue.key[0]) if issue.key else "", None)
        return cls(left, frozenset(str(key[0]) for key in keys), kept)

    def placed(self, issue: Issue) -> Issue:
        """The issue about what is left as one about the file: entries of lists have their own number again."""
        for path, numbers in self.kept.items():
            if _is_entry(issue.key, path):
                number = numbers[int(issue.key[len(path)])]
                return replace(issue, key=(*path, number, *issue.key[len(path) + 1 :]))
        return issue

    def judged(self, issue: Issue) -> bool:
        """Whether the issue does not come from what is left out: only names are judged where a section is broken."""
        return not issue.key or issue.key[0] not in self.broken or len(issue.key) > 2 or issue.key[0] == "effects"


def _is_entry(key: KeyPath, path: KeyPath) -> bool:
    """Whether the key is one in an entry of the list at ``path``."""
    return len(key) > len(path) and key[: len(path)] == path and isinstance(key[len(path)], int)


def _thinned(data: Section, path: KeyPath, keys: Iterable[KeyPath]) -> tuple[int, ...]:
    """Leaves entries out of the list at ``path``; the numbers of those that stay."""
    bad = {key[len(path)] for key in keys if _is_entry(key, path)}
    owner: Plain = data
    for part in path[:-1]:
        owner = owner[part]
    numbers = tuple(k for k in range(len(owner[path[-1]])) if k not in bad)
    owner[path[-1]] = [owner[path[-1]][k] for k in numbers]
    return numbers


def _entry(data: Plain, key: KeyPath) -> Plain:
    """What is at ``key``; None where an issue before has removed it."""
    for part in key:
        try:
            data = data[part]
        except (KeyError, IndexError, TypeError):
            return None
    return data


def _left_out(data: Section, key: KeyPath) -> None:
    """Removes the entry that an issue is about: a value of a joint, else a key of a section, else the section.

    Masses and centres of mass of a joint are replaced by plain ones, as leaving them out would be a fault of its own.
    Correlations are removed with the σ's that they need.
    """
    section = data.get(str(key[0]))
    if len(key) == 1 or not isinstance(section, dict) or key[1] == "kind":
        data.pop(str(key[0]), None)
    elif key[:2] == ("robot", "joints") and len(key) > 3 and isinstance(row := _entry(section, key[1:3]), dict):
        row.pop(key[3], None)
        row.update({key[3]: _STAND_IN_VALUES[str(key[3])]} if key[3] in _STAND_IN_VALUES else {})
    else:
        section.pop(str(key[1]), None)
        if key == ("uncertainty", "sigma"):
            section.pop("correlation", None)
