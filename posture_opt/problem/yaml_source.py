"""YAML text as plain data, with the line of every key; and edited text with all its comments."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from os import PathLike, fspath
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml

from posture_opt.errors import InputError, Issue, KeyPath
from posture_opt.files import named_content
from posture_opt.limits import MAX_YAML_BYTES

Plain = Any  # A value of a problem file before its schema has read it: text, number, or lists and mappings of them
Section = dict[str, Plain]  # A section of a problem file, or all of them, by their keys


def plain(value: object) -> Plain:
    """Mappings, sequences, arrays and paths as the plain types that a file would give, all of them new."""
    if isinstance(value, Mapping):
        return {"on" if key is True else str(key): plain(entry) for key, entry in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, list | tuple):
        return [plain(entry) for entry in value]
    if isinstance(value, int) and abs(value) > 10**300:  # beyond it no float can follow: it is infinite
        return math.inf if value > 0 else -math.inf
    return fspath(value) if isinstance(value, PathLike) else value


_MAX_NODES = 200_000  # after aliases are expanded; a file of the size above has fewer without any
_STARTER_HINT = "'optimize-posture new planar_2r' prints a problem file to start from"


@dataclass(frozen=True)
class ProblemDocument:
    """The data of one problem file."""

    data: Section  # as plain types
    file: str = ""  # its name, empty where there is none
    lines: dict[KeyPath, int] = field(default_factory=dict)  # the line of each key path, from 1
    issues: tuple[Issue, ...] = ()  # what is wrong already

    def placed(self, issue: Issue) -> Issue:
        """The issue with file and line of its key, or of the nearest entry around it."""
        if issue.file or not self.file:
            return issue
        key = issue.key
        while key and key not in self.lines:
            key = key[:-1]
        return issue.placed(self.file, self.lines.get(key, 0))


class _Loader(yaml.SafeLoader):
    """PyYAML's composer with the scalars of YAML 1.2."""

    yaml_implicit_resolvers: Section = {}  # noqa: RUF012 – PyYAML's own name, filled below


for _tag, _pattern, _first in (
    ("bool", r"true|True|TRUE|false|False|FALSE", "tTfF"),
    ("int", r"[-+]?[0-9]+|0o[0-7]+|0x[0-9a-fA-F]+", "-+0123456789"),
    ("float", r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?", "-+.0123456789"),
    ("float", r"[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)", "-+."),
    ("null", r"~|null|Null|NULL|", ["~", "n", "N", ""]),
    ("merge", r"<<", "<"),
):
    _Loader.add_implicit_resolver(f"tag:yaml.org,2002:{_tag}", re.compile(f"^(?:{_pattern})$"), list(_first))


def read_yaml(path: str | Path) -> ProblemDocument:
    """The document in a file."""
    path = Path(path)
    try:
        found = named_content(path, MAX_YAML_BYTES)
    except InputError as error:
        raise InputError([replace(issue, hint=issue.hint or _STARTER_HINT) for issue in error.issues]) from None
    try:
        text = found.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = found[: error.start].count(b"\n") + 1
        message = f"not UTF-8 text (byte 0x{found[error.start]:02x})"
        raise InputError(Issue(message, hint="save the file as UTF-8", file=str(path), line=line)) from None
    return parse_yaml(text, str(path))


def parse_yaml(text: str, file: str = "") -> ProblemDocument:
    """The document in a text; ``file`` is what messages call it."""
    node = compose(text, file)
    if node is None:
        raise InputError(Issue("the file is empty", file=file, hint=_STARTER_HINT))
    if not isinstance(node, yaml.MappingNode):
        kind = "a list" if isinstance(node, yaml.SequenceNode) else "a single value"
        line = node.start_mark.line + 1
        message = f"the file holds {kind} where a mapping of sections belongs"
        begin = f"begin with 'name:', 'robot:' and so on; {_STARTER_HINT}"
        hint = "it looks like XML: a URDF goes with --robot, and into a problem file as robot: {file: ...}"
        raise InputError(Issue(message, (), None, hint if text.lstrip().startswith("<") else begin, file, line))
    reader = _Reader(file)
    try:
        data = reader.value(node, ())
    except RecursionError:
        raise InputError(Issue("the file is nested too deeply", file=file)) from None
    return ProblemDocument(data, file, reader.lines, tuple(reader.issues))


def compose(text: str, file: str = "") -> yaml.Node | None:
    """The node tree of a text; None of an empty one."""
    try:
        loader = _Loader(text)
        try:
            return loader.get_single_node()
        finally:
            loader.dispose()
    except yaml.MarkedYAMLError as error:
        raise InputError(_yaml_issue(error, text, file)) from None
    except yaml.reader.ReaderError as error:
        line = text[: error.position].count("\n") + 1
        code = error.character if isinstance(error.character, int) else ord(error.character)
        message = f"not YAML: the character U+{code:04X} is not allowed in a text file"
        raise InputError(Issue(message, file=file, line=line)) from None
    except RecursionError:
        raise InputError(Issue("the file is nested too deeply", file=file)) from None


def _yaml_issue(error: yaml.MarkedYAMLError, text: str, file: str) -> Issue:
    mark = error.problem_mark or error.context_mark
    line = mark.line + 1 if mark else 0
    problem = (error.problem or error.context or "").rstrip(".")
    if "single document" in (error.context or ""):
        return Issue("the file holds several YAML documents", (), None, "keep one; remove the line '---'", file, line)
    lines = text.splitlines()
    here = lines[line - 1].strip() if 0 < line <= len(lines) else ""
    hint = "indent with spaces, not tabs" if "'\\t'" in problem else ""
    if "mapping values are not allowed" in problem:
        hint = "is a ':' too many in the line, or is the indentation wrong?"
    elif "expected <block end>" in problem:
        hint = "is the line indented like its neighbours?"
    elif "undefined alias" in problem:
        hint = "put a text that begins with * or & in quotes"
    return Issue(f"not YAML: {problem}" + (f", at '{here[:60]}'" if here else ""), (), None, hint, file, line)


class _Reader:
    """Converts composed nodes to plain data and notes lines, duplicate keys and foreign tags on the way."""

    def __init__(self, file: str) -> None:
        self.file = file
        self.lines: dict[KeyPath, int] = {}
        self.issues: list[Issue] = []
        self._open: set[int] = set()
        self._nodes = 0

    def value(self, node: yaml.Node, key: KeyPath) -> Plain:
        """The plain value of ``node``, which is at ``key``."""
        self._nodes += 1
        if self._nodes > _MAX_NODES:
            message = f"the aliases (*name) of the file unfold to more than {_MAX_NODES} entries"
            raise InputError(self._issue(node, message, key[:1], "write the entries out"))
        if id(node) in self._open:
            raise InputError(self._issue(node, "an alias (*name) contains itself", key[:1]))
        self.lines.setdefault(key, node.start_mark.line + 1)
        if isinstance(node, yaml.ScalarNode):
            return self._scalar(node, key)
        self._open.add(id(node))
        try:
            if isinstance(node, yaml.MappingNode):
                return self._mapping(node, key)
            return [self.value(child, (*key, i)) for i, child in enumerate(node.value)]
        finally:
            self._open.discard(id(node))

    def _issue(self, node: yaml.Node, message: str, key: KeyPath, hint: str = "") -> Issue:
        return Issue(message, key, None, hint, self.file, node.start_mark.line + 1)

    def _mapping(self, node: yaml.MappingNode, key: KeyPath) -> Section:
        """The entries of a mapping; its own keys take precedence over those that ``<<`` takes over."""
        data: Section = {}
        merged: Section = {}
        for name_node, child in node.value:
            if name_node.tag == "tag:yaml.org,2002:merge":
                merged |= self._merged(child, key)
                continue
            if not isinstance(name_node, yaml.ScalarNode) or not name_node.value:
                raise InputError(self._issue(name_node, "a key is a text", key, "put texts with [ or { in quotes"))
            name = str(name_node.value)  # as it is written: a joint may be called 1, on or no
            if name in data:
                message = f"the key is given twice, first in line {self.lines[(*key, name)]}"
                self.issues.append(self._issue(name_node, message, (*key, name), "keep one of the two"))
                continue
            self.lines[(*key, name)] = name_node.start_mark.line + 1
            data[name] = self.value(child, (*key, name))
        return {**merged, **data}

    def _merged(self, node: yaml.Node, key: KeyPath) -> Section:
        """The entries that ``<<: *name`` takes over."""
        value = self.value(node, key)
        parts = value if isinstance(value, list) else [value]
        if not all(isinstance(part, dict) for part in parts):
            self.issues.append(self._issue(node, "'<<' takes over a mapping, nothing else", key))
            return {}
        return {name: entry for part in reversed(parts) for name, entry in part.items()}

    def _scalar(self, node: yaml.ScalarNode, key: KeyPath) -> Plain:
        text: str = node.value
        kind = node.tag.removeprefix("tag:yaml.org,2002:")
        try:
            if kind == "int" and len(text) < 300:  # beyond it no float can follow: it is infinite
                return int(text, 0) if text.lstrip("+-")[:2] in ("0o", "0x") else int(text)
            if kind == "int":
                return -math.inf if text.startswith("-") else math.inf
            if kind == "float":
                return float(re.sub(r"\.(?=[inIN])", "", text))  # YAML writes .inf and .nan
        except ValueError:  # only an explicit tag can claim a number where none is
            pass
        if kind == "bool":
            return text.lower() == "true"
        if kind == "null":
            return None
        if kind not in ("str", "merge"):
            self.issues.append(self._issue(node, f"the tag {node.tag} is not used here", key, "remove it"))
        return text


class _Dumper(yaml.SafeDumper):
    """PyYAML's writer, which quotes the texts that YAML 1.2 would read as something else."""

    yaml_implicit_resolvers = _Loader.yaml_implicit_resolvers

    def represent_mapping(self, tag: str, mapping: Plain, flow_style: bool | None = None) -> yaml.MappingNode:
        """Parameters with their quantities are written one a line: so they are found and compared."""
        node = super().represent_mapping(tag, mapping, flow_style)
        if len(mapping) > 2 and all("." in str(name) for name in mapping):
            node.flow_style = False
        return node


def dump_yaml(data: Section) -> str:
    """The YAML text that ``parse_yaml`` reads back as ``data``; small lists and mappings are written in one line."""
    return yaml.dump(data, Dumper=_Dumper, sort_keys=False, allow_unicode=True, default_flow_style=None, width=110)


def dump_flow(data: Plain) -> str:
    """Data as YAML in one line; texts in quotes where they need them."""
    text = yaml.dump(data, Dumper=_Dumper, sort_keys=False, allow_unicode=True, default_flow_style=True, width=math.inf)
    return text.removesuffix("\n").removesuffix("\n...")


def dump_texts(texts: Sequence[str]) -> str:
    """Texts as a YAML list in one line, each in double quotes."""
    return yaml.dump(list(texts), default_style='"', default_flow_style=True, width=math.inf).removesuffix("\n")


class _Edit(NamedTuple):
    """Characters ``start`` to ``end`` of a text, and what comes in their place."""

    start: int
    end: int
    text: str


def edited(text: str, data: Mapping[str, Plain]) -> str | None:
    """The text of a problem file with the values of ``data``; only what differs is written anew."""
    try:
        before, node = parse_yaml(text).data, compose(text)
        edits = sorted(_edits(text, node, before, data), reverse=True)
        for edit in edits:
            text = text[: edit.start] + edit.text + text[edit.end :]
        return text if parse_yaml(text).data == data else None
    except InputError:
        return None


def _edits(text: str, node: yaml.Node | None, before: Plain, after: Plain) -> Iterator[_Edit]:
    if before == after or node is None:
        return
    if isinstance(node, yaml.MappingNode) and isinstance(after, Mapping) and after:
        yield from _of_mapping(text, node, before, after)
    elif isinstance(node, yaml.SequenceNode) and isinstance(after, list) and len(after) == len(before):
        for child, old, new in zip(node.value, before, after, strict=True):
            yield from _edits(text, child, old, new)
    else:
        yield _Edit(node.start_mark.index, _end(text, node), dump_flow(after))


def _of_mapping(text: str, node: yaml.MappingNode, before: Section, after: Mapping[str, Plain]) -> Iterator[_Edit]:
    children = {str(name.value): (name, child) for name, child in node.value}
    for key, (name, child) in children.items():
        if key in after:
            yield from _edits(text, child, before.get(key), after[key])
        elif node.flow_style:  # a comma before or after it would have to go too
            yield _Edit(node.start_mark.index, _end(text, node), dump_flow(dict(after)))
            return
        else:
            yield _Edit(text.rfind("\n", 0, name.start_mark.index) + 1, _line_end(text, _end(text, child)), "")
    new = {key: value for key, value in after.items() if key not in children}
    if not new:
        return
    if node.flow_style:
        end = _end(text, node) - 1
        yield _Edit(end, end, "".join(f", {dump_flow({key: value})[1:-1]}" for key, value in new.items()))
    else:
        end = _line_end(text, _end(text, node))
        indent = " " * node.start_mark.column
        lines = "".join(f"{indent}{dump_flow({key: value})[1:-1]}\n" for key, value in new.items())
        yield _Edit(end, end, lines if text[:end].endswith("\n") else f"\n{lines}")


def _end(text: str, node: yaml.Node) -> int:
    if isinstance(node, yaml.CollectionNode) and not node.flow_style:
        last = node.value[-1]
        return _end(text, last[1] if isinstance(last, tuple) else last)
    return int(node.end_mark.index)


def _line_end(text: str, at: int) -> int:
    found = text.find("\n", at)
    return len(text) if found < 0 else found + 1
