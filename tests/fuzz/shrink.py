"""Makes a case small that breaks a rule: lines and pieces of lines go as long as it breaks the same rule."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace

from tests.fuzz.case import Case
from tests.fuzz.child import Server
from tests.fuzz.rules import faults

_PIECES = (re.compile(rb"[^\n]*\n?"), re.compile(rb"\s+|[\[\]{},:]|[^\s\[\]{},:]+"), re.compile(rb"."))
_CHARACTERS = 200  # bytes; of larger files no single characters are tried


def shrunk(server: Server, case: Case) -> Case:
    """The smallest case found whose first fault is the same, numbers and names aside."""
    kind = _kind(server, case)

    def still(candidate: Case) -> bool:
        return _kind(server, candidate) == kind

    assert kind
    case = _fewer_words(_fewer_files(case, still), still)
    for pattern in _PIECES:
        for name, entry in case.files.items():
            if isinstance(entry, bytes) and (pattern is not _PIECES[2] or len(entry) < _CHARACTERS):
                case = _fewer_pieces(case, name, [piece for piece in pattern.findall(entry) if piece], still)
    return case


def _kind(server: Server, case: Case) -> str:
    return re.sub(r"\d+(\.\d+)?|'[^']*'", "#", next(faults(case, server.run(case)), ""))[:60]


def _fewer_files(case: Case, still: Callable[[Case], bool]) -> Case:
    for name in list(case.files):
        candidate = replace(case, files={other: entry for other, entry in case.files.items() if other != name})
        case = candidate if still(candidate) else case
    return case


def _fewer_words(case: Case, still: Callable[[Case], bool]) -> Case:
    for count in (2, 1):
        at = 0
        while at < len(case.words):
            candidate = replace(case, words=case.words[:at] + case.words[at + count :])
            if still(candidate):
                case = candidate
            else:
                at += 1
    return case


def _fewer_pieces(case: Case, name: str, pieces: list[bytes], still: Callable[[Case], bool]) -> Case:
    """Delta debugging: drops ever shorter runs of pieces (Zeller, Hildebrandt 2002)."""
    length = len(pieces) // 2
    while length:
        at = 0
        while at < len(pieces):
            fewer = pieces[:at] + pieces[at + length :]
            candidate = replace(case, files={**case.files, name: b"".join(fewer)})
            if still(candidate):
                case, pieces = candidate, fewer
            else:
                at += length
        length //= 2
    return case
