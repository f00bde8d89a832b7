"""Validation errors of pydantic in the words of this package: one issue a cause, with its key and a hint.

pydantic reports every alternative that it tried and stops at the first unknown kind of a section. Here each cause is
reported once, and an unknown kind does not hide what else is wrong with its section.
"""

from __future__ import annotations

import copy
import re
from collections import defaultdict
from collections.abc import Mapping, Sequence

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from posture_opt.errors import BadValueError, Issue, KeyPath, as_given, did_you_mean, nearest, one_of
from posture_opt.problem.plain_data import Plain, Section
from posture_opt.problem.schema import bound_at, example_at, known_keys, nodes_at, read_sections, size_at
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
    """Everything about the sections of a problem file that does not fit the schema; empty where all does.

    Places are those of the file: the names of the alternatives that pydantic tried are left out of them, and of
    the alternatives only the one is reported that was probably meant.
    """
    kinds: list[Issue] = []
    while True:
        try:
            read_sections(data)
            return kinds
        except ValidationError as error:
            placed = [_Placed(details, data) for details in error.errors(include_url=False)]
        misspelt = [(one, meant) for one in placed if (meant := _meant_kind(one))]
        if not misspelt:
            causes = _without_misspelt(_without_rivals(placed), data)
            return _each_once([*kinds, *(_issue(one, data) for one in causes)])
        # pydantic reads nothing of a section of unknown kind; read as the kind that was meant it has more to say
        data = copy.deepcopy(data)
        for one, (word, kind) in misspelt:
            kinds.append(_issue(one, data))
            _entry(data, one.key)[word] = kind


def _meant_kind(error: _Placed) -> tuple[str, str] | None:
    """The discriminating key and the nearest known word where a section has an unknown kind."""
    if error.type != "union_tag_invalid":
        return None
    context = error.details.get("ctx", {})
    if _unknown_task((*error.key, _tag_key(context)), context["tag"]):
        return None
    near = nearest(str(context["tag"]), _quoted(context["expected_tags"]))
    return (_tag_key(context), near) if near else None


def _entry(data: Plain, key: KeyPath) -> Plain:
    """The entry of nested data at a key."""
    for part in key:
        data = data[part]
    return data


class _Placed:
    """An error with its key in the file, and the alternatives pydantic was in: (key of the choice, its name).

    pydantic's location mixes keys of the file with names of the types that it tried; here they are separated by
    following the location through the data.

    Args:
        details: pydantic's error; ``data`` the data that it is about.
    """

    def __init__(self, details: ErrorDetails, data: Plain) -> None:
        self.details = details
        self.type: str = details["type"]
        self.key: KeyPath = ()
        self.choices: list[tuple[KeyPath, str]] = []
        parts = details["loc"]
        for index, part in enumerate(parts):
            absent = self.type == "missing" and index == len(parts) - 1
            if absent or _has(data, part):
                self.key = (*self.key, part)
                data = None if absent else data[part]
            else:
                self.choices.append((self.key, str(part)))

    @property
    def missing(self) -> KeyPath | None:
        """The key that should be there; None where another thing is wrong."""
        if self.type == "union_tag_not_found":
            return (*self.key, _tag_key(self.details["ctx"]))
        return self.key if self.type == "missing" else None


def _has(data: Plain, part: str | int) -> bool:
    """Whether data have an entry: a key of a mapping, a number of a list."""
    if isinstance(part, int):
        return isinstance(data, list | tuple) and part < len(data)
    return isinstance(data, Mapping) and part in data


def _without_rivals(errors: list[_Placed]) -> list[_Placed]:
    """Of several alternatives tried at one place, the errors of the one that went deepest into the data."""
    branches: dict[KeyPath, dict[str, list[_Placed]]] = defaultdict(lambda: defaultdict(list))
    for error in errors:
        for place, name in error.choices:
            branches[place][name].append(error)
    dropped: set[int] = set()
    for rivals in branches.values():
        best = max(rivals.values(), key=lambda group: max(_depth(error) for error in group))
        for group in rivals.values():
            dropped |= {id(error) for error in group if group is not best}
    return [error for error in errors if id(error) not in dropped]


def _without_misspelt(errors: list[_Placed], data: Plain) -> list[_Placed]:
    """Drops the missing keys that an unknown key in the same mapping is a misspelling of.

    ``postion: …`` is one mistake: an unknown key with a suggestion, and no missing ``position``.
    """
    if not any(error.missing for error in errors):
        return errors
    meant = {
        (*error.key[:-1], nearest(str(error.key[-1]), known_keys(error.key[:-1], data)))
        for error in errors
        if error.type == "extra_forbidden"
    }
    return [error for error in errors if error.missing not in meant]


def _depth(error: _Placed) -> tuple[int, bool]:
    """How far an alternative was read: the number of keys; at equal depth, whether a check refused a value."""
    return len(error.key), error.type == "value_error"


def _issue(error: _Placed, data: Plain) -> Issue:
    """The error in the words of this package, with the value and a hint where the schema has an example."""
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
        words = _quoted(context["expected"])
        return _unknown_word(key, value, words)
    if kind == "value_error":
        fault = context["error"]
        return (fault if isinstance(fault, BadValueError) else BadValueError(str(fault))).issue(key, value)
    if kind in _MESSAGE_OF_TYPE:
        bounds = {name: bound_at(key, data, bound) for name, bound in context.items()}
        message = _MESSAGE_OF_TYPE[kind].format(value=as_given(value), **bounds)
        return Issue(message, key, value, _such_as(key, data))
    return _type_issue(key, kind, value, data, error.details["msg"])


def _tag_issue(key: KeyPath, kind: str, context: Mapping[str, Plain], data: Plain) -> Issue:
    """A section without a kind, or of an unknown one, with the kinds that there are."""
    name = _tag_key(context)
    if kind == "union_tag_not_found":
        words = sorted(str(word) for word in _tags(key))
        return Issue("is missing", (*key, name), None, f"write {name}: {' | '.join(words)}", id="input.missing-key")
    place, value = (*key, name), _entry(data, key).get(name)
    return _unknown_task(place, value) or _unknown_word(place, value, _quoted(context["expected_tags"]))


def _tag_key(context: Mapping[str, Plain]) -> str:
    """The key that says of which kind a section is; pydantic quotes it."""
    return str(context["discriminator"]).strip("'")


def _unknown_task(key: KeyPath, value: Plain) -> Issue | None:
    """The reason why a task that another package registers is not known."""
    broken = next((task for task in registered_tasks().broken if task.name == value), None)
    if key != ("task", "kind") or broken is None:
        return None
    return Issue(str(broken), key, value, f"repair {broken.package}, or uninstall it")


def _unknown_word(key: KeyPath, value: Plain, words: Sequence[str]) -> Issue:
    """A value that is not one of the known words, with the nearest of them."""
    message = "nothing is given here" if value is None else f"{as_given(value)} is not known here"
    return Issue(message, key, value, one_of(str(value), words), id="input.unknown-value")


def _tags(key: KeyPath) -> list[str]:
    """The kinds that the schema knows of a section."""
    return [tag for node in nodes_at((*key, "kind"), None) for tag in [node.get("const")] if tag]


def _quoted(words: Plain) -> list[str]:
    """The words that pydantic lists in quotes."""
    return re.findall(r"'([^']*)'", str(words))


def _type_issue(key: KeyPath, kind: str, value: Plain, data: Plain, fallback: str) -> Issue:
    """A value of the wrong type: what it is, what is expected, and an example; an unquoted text in quotes."""
    expected = next((word for start, word in _EXPECTED_OF_TYPE.items() if kind.startswith(start)), "")
    if not expected:
        message = fallback.removeprefix("Input ").replace("valid ", "")
        return Issue(f"{message} (here {as_given(value)})", key, value)
    if value is None:
        return Issue(f"nothing is given here, {expected} is expected", key, value, _such_as(key, data))
    hint = f"put it in quotes: '{value}'" if kind == "string_type" and not _container(value) else _such_as(key, data)
    return Issue(f"{as_given(value)} is not {expected}", key, value, hint)


def _such_as(key: KeyPath, data: Plain, name: str = "") -> str:
    """The hint "write for example …"; empty where the schema has no example for the key."""
    example = example_at(key, data)
    return f"write for example {name + ': ' if name else ''}{example}" if example else ""


def _container(value: Plain) -> bool:
    """Whether a value is a list or a mapping."""
    return isinstance(value, list | tuple | Mapping)


def _each_once(issues: list[Issue]) -> list[Issue]:
    """One issue for each key and message: the alternatives that pydantic tries can have the same fault."""
    return list({(issue.key, issue.message): issue for issue in reversed(issues)}.values())[::-1]
