"""Texts from outside: which characters a text may hold that reports, figures, programs and tables repeat.

Every text of a file passes `checked`, whatever its format: names end up in comments of robot programs, where a line
break would put what follows it on a line of its own.
"""

from __future__ import annotations

import re
from typing import Any

from posture_opt.errors import Issue, KeyPath

_REFUSED = re.compile(r"[\x00-\x1f\x7f-\x9f\u2028\u2029\ud800-\udfff\ufffe\uffff]")
"""Control characters, halves of characters, and all that some language ends a line at."""
_LINE_ENDS = "\n\v\f\r\x1c\x1d\x1e\x85\u2028\u2029"
_BLANKS = f"\t{_LINE_ENDS}"


def text_fault(text: str) -> tuple[str, str] | None:
    r"""What is wrong with a text, and how to fix it; None where nothing is.

    Example:
        >>> text_fault("pin 1"), text_fault("pin\n1")
        (None, ('the text holds a line break (U+000A)', 'write it in one line'))
    """
    found = _REFUSED.search(text)
    if found is None:
        return None
    code = f"U+{ord(found[0]):04X}"
    if found[0] in _LINE_ENDS:
        return f"the text holds a line break ({code})", "write it in one line"
    if found[0] == "\t":
        return f"the text holds a tab ({code})", "write a blank"
    return f"the text holds the character {code}, which no text has", "remove it"


def one_line(text: str) -> str:
    r"""The text with a blank for each line break and tab, and ``?`` for what else no text may hold.

    For names that cannot be refused, and for whatever is written to where a line break counts.

    Example:
        >>> one_line("a\nmovej()")
        'a movej()'
    """
    return _REFUSED.sub(lambda found: " " if found[0] in _BLANKS else "?", text)


def checked(data: Any, key: KeyPath = ()) -> tuple[Any, list[Issue]]:
    """Plain data with every text in `one_line`, and an issue for each text and name of a key that was not.

    Args:
        data: text, number, or lists and mappings of them.
        key: of ``data`` in the whole, for the issues.
    """
    if isinstance(data, str):
        fault = text_fault(data)
        return (data, []) if fault is None else (one_line(data), [Issue(fault[0], key, None, fault[1])])
    issues: list[Issue] = []
    if isinstance(data, dict):
        entries = {}
        for name, entry in data.items():
            sound, found = checked(name, key)
            entries[sound], more = checked(entry, (*key, sound))
            issues += [*found, *more]
        return entries, issues
    if isinstance(data, list | tuple):
        rows = []
        for index, entry in enumerate(data):
            sound, found = checked(entry, (*key, index))
            rows.append(sound)
            issues += found
        return rows, issues
    return data, issues
