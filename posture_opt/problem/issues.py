"""Validation errors of pydantic in the words of this package: one issue a cause, with its key and a hint."""

from __future__ import annotations

import copy
import re
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import replace

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from posture_opt.errors import BadValueError, Issue, KeyPath, as_given, did_you_mean, nearest, one_of
from posture_opt.problem.schema import bound_at, entry_at, example_at, known_keys, nodes_at, read_sections, size_at
from posture_opt.problem.yaml_source import Plain, Section
from posture_opt.selection.registered_tasks import registered_tasks

_MESSAGE_OF_TYPE: dict[str, str] = {
    # pydantic's type of error -> what is wrong, in its context
    "finite_number": "{value} is not a finite number",
    "greater_than": "must be greater than {gt}, not {value}",
    "greater_than_equal": "must be {ge} or greater, not {value}",
    "less_than": "must be less than {lt}, not {value}",
    "less_than_equal": "must be {le} or less, not {value}",
    "int_from_float": "{value} is not a whole number",
    "string_too_short": "the text is empty",
    "too_long": "{actual_length} entries, {max_length} expected",
    "too_short": "{actual_length} entries, at least {min_length} expected",
    "multiple_of": "must be a multiple of {multiple_of}, not {value}",
}
_EXPECTED_OF_TYPE: dict[str, str] = {
    # the start of pydantic's type of error -> what is expected there
    "float": "a number",
    "int": "a whole number",
    "bool": "true or false",
    "string": "a text",
    "list": "a list",
    "tuple": "a list",
    "dict": "a mapping of keys to values",
    "model": "a mapping of keys to values",
    "mapping": "a mapping of keys to values",
}


def schema_issues(data: Section) -> list[Issue]:
    """Everything about the sections of a problem file that does not fit the schema; empty where all does."""
    found: list[Issue] = []
    written: dict[KeyPath, str] = {}  # key as it was meant -> its last word as the file has it
    while True:
        try:
            read_sections(data)
            placed: list[_Placed] = []
        except ValidationError as error:
            placed = [_Placed(details, data) for details in error.errors(include_url=False)]
        # pydantic reads nothing of a section of unknown kind or name; read as it was meant it has more to say
        kinds = [(one, meant) for one in placed if (meant := _meant_kind(one))]
        causes = [one for one, _ in kinds] or _without_rivals(placed)
        keys = {} if kinds else _meant_keys(causes, data)
        for one in [one for one in causes if one.key in keys] or causes:
            issue = _issue(one, data)
            as_written = (written.get(issue.key[: n + 1], word) for n, word in enumerate(issue.key))
            found.append(replace(issue, key=tuple(as_written)))
        if not (kinds or keys):
            # The alternatives that pydantic tries can have the same fault.
            return list({(issue.key, issue.message): issue for issue in reversed(found)}.values())[::-1]
        data = copy.deepcopy(data)
        for one, (word, kind) in kinds:
            entry_at(data, one.key)[word] = kind
        for key, word in keys.items():
            section = entry_at(data, key[:-1])
            section[word] = section.pop(key[-1])
            written[(*key[:-1], word)] = str(key[-1])


def _meant_kind(error: _Placed) -> tuple[str, str] | None:
    if error.type != "union_tag_invalid":
        return None
    context = error.details.get("ctx", {})
    if _unknown_task((*error.key, _tag_key(context)), context["tag"]):
        return None
    near = nearest(str(context["tag"]), _quoted(context["expected_tags"]))
    return (_tag_key(context), near) if near else None


def _meant_keys(errors: list[_Placed], data: Plain) -> dict[KeyPath, str]:
    """Misspelt key -> the word that was meant, where its section has no entry of that name."""
    found: dict[KeyPath, str] = {}
    taken: set[KeyPath] = set()
    for error in errors:
        section = error.key[:-1]
        near = nearest(str(error.key[-1]), known_keys(section, data)) if error.type == "extra_forbidden" else None
        if near and near not in entry_at(data, section) and (*section, near) not in taken:
            found[error.key] = near
            taken.add((*section, near))
    return found


class _Placed:
    """An error with its key in the file, and the alternatives pydantic was in: (key of the choice, its name)."""

    def __init__(self, details: ErrorDetails, data: Plain) -> None:
        self.details = details
        self.type: str = details["type"]
        self.key: KeyPath = ()
        self.choices: list[tuple[KeyPath, str]] = []
        parts = details["loc"]
        for index, part in enumerate(parts):
            absent = self.type == "missing" and index == len(parts) - 1
            listed = isinstance(part, int) and isinstance(data, list | tuple) and part < len(data)
            if absent or listed or (isinstance(part, str) and isinstance(data, Mapping) and part in data):
                self.key = (*self.key, part)
                data = None if absent else data[part]
            else:
                self.choices.append((self.key, str(part)))


def _without_rivals(errors: list[_Placed]) -> list[_Placed]:
    branches: dict[KeyPath, dict[str, list[_Placed]]] = defaultdict(lambda: defaultdict(list))
    for error in errors:
        for place, name in error.choices:
            branches[place][name].append(error)
    dropped: set[int] = set()
    for rivals in branches.values():
        best = max(
            rivals.values(), key=lambda group: max((len(error.key), error.type == "value_error") for error in group)
        )
        for group in rivals.values():
            dropped |= {id(error) for error in group if group is not best}
    return [error for error in errors if id(error) not in dropped]


def _issue(error: _Placed, data: Plain) -> Issue:
    value, context = error.details["input"], error.details.get("ctx", {})
    key, kind = error.key, error.type
    if kind == "missing" and isinstance(key[-1], int):
        given, wanted = len(value), size_at(key[:-1], data)
        message = f"{given} {'entry' if given == 1 else 'entries'}, {wanted} expected"
        return Issue(message, key[:-1], value, _such_as(key[:-1], data))
    if kind == "missing":
        return Issue("is missing", key, None, _such_as(key, data, name=str(key[-1])), id="input.missing-key")
    if kind == "extra_forbidden":
        known = did_you_mean(str(key[-1]), known_keys(key[:-1], data))
        return Issue("unknown key", key, value, known, id="input.unknown-key")
    if kind.startswith("union_tag"):
        return _tag_issue(key, kind, context, data)
    if kind in ("literal_error", "enum"):
        return _unknown_word(key, value, _quoted(context["expected"]))
    if kind == "value_error":
        fault = context["error"]
        return (fault if isinstance(fault, BadValueError) else BadValueError(str(fault))).issue(key, value)
    if kind in _MESSAGE_OF_TYPE:
        bounds = {name: bound_at(key, data, bound) for name, bound in context.items()}
        message = _MESSAGE_OF_TYPE[kind].format(value=as_given(value), **bounds)
        return Issue(message, key, value, _such_as(key, data))
    return _type_issue(key, kind, value, data, error.details["msg"])


def _tag_issue(key: KeyPath, kind: str, context: Mapping[str, Plain], data: Plain) -> Issue:
    name = _tag_key(context)
    if kind == "union_tag_not_found":
        words = sorted(str(node["const"]) for node in nodes_at((*key, "kind"), None) if node.get("const"))
        return Issue("is missing", (*key, name), None, f"write {name}: {' | '.join(words)}", id="input.missing-key")
    place, value = (*key, name), entry_at(data, key).get(name)
    return _unknown_task(place, value) or _unknown_word(place, value, _quoted(context["expected_tags"]))


def _tag_key(context: Mapping[str, Plain]) -> str:
    return str(context["discriminator"]).strip("'")


def _unknown_task(key: KeyPath, value: Plain) -> Issue | None:
    broken = next((task for task in registered_tasks().broken if task.name == value), None)
    if key != ("task", "kind") or broken is None:
        return None
    return Issue(str(broken), key, value, f"repair {broken.package}, or uninstall it")


def _unknown_word(key: KeyPath, value: Plain, words: Sequence[str]) -> Issue:
    message = "nothing is given here" if value is None else f"{as_given(value)} is not known here"
    return Issue(message, key, value, one_of(str(value), words), id="input.unknown-value")


def _quoted(words: Plain) -> list[str]:
    return re.findall(r"'([^']*)'", str(words))


def _type_issue(key: KeyPath, kind: str, value: Plain, data: Plain, fallback: str) -> Issue:
    expected = next((word for start, word in _EXPECTED_OF_TYPE.items() if kind.startswith(start)), "")
    if not expected:
        message = fallback.removeprefix("Input ").replace("valid ", "")
        return Issue(f"{message} (here {as_given(value)})", key, value)
    if value is None:
        return Issue(f"nothing is given here, {expected} is expected", key, value, _such_as(key, data))
    hint = (
        f"put it in quotes: '{value}'"
        if kind == "string_type" and not isinstance(value, list | tuple | Mapping)
        else _such_as(key, data)
    )
    return Issue(f"{as_given(value)} is not {expected}", key, value, hint)


def _such_as(key: KeyPath, data: Plain, name: str = "") -> str:
    example = example_at(key, data)
    return f"write for example {name + ': ' if name else ''}{example}" if example else ""
