"""YAML text as plain data, with the line of every key, and with nothing in it that could surprise.

Values are read by the core schema of YAML 1.2: ``on``, ``yes`` and ``12:30`` stay texts, ``1e-3`` is a number. Keys
are texts as they are written. Duplicate keys, foreign tags and aliases that unfold to very many entries are refused.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import yaml

from posture_opt.errors import InputError, Issue, KeyPath
from posture_opt.files import content, naming
from posture_opt.problem.plain_data import Plain, Section

MAX_BYTES = 1_000_000  # bytes; the largest problem file written by hand has some thousand
_MAX_PARAMETERS_IN_LINE = 2  # parameters; of more, a line breaks between number and unit
_MAX_NODES = 200_000  # after aliases are expanded; a file of the size above has fewer without any
_STARTER_HINT = "'optimize-posture new planar_2r' prints a problem file to start from"


@dataclass(frozen=True)
class ProblemDocument:
    """The data of one problem file.

    Args:
        data: as plain types; ``file`` its name, empty where there is none.
        lines: the line of each key path, from 1.
        issues: what is wrong already.
    """

    data: Section
    file: str = ""
    lines: dict[KeyPath, int] = field(default_factory=dict)
    issues: tuple[Issue, ...] = ()

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
    """The document in a file.

    Raises:
        InputError: no such file, not readable, too large, not UTF-8, not YAML, or no mapping at the top.
    """
    path = Path(path)
    return parse_yaml(_read_text(path), str(path))


def _read_text(path: Path) -> str:
    """The text of a file.

    Raises:
        InputError: it cannot be read, is too large, or is not UTF-8; with the line of the first wrong byte.
    """
    try:
        found = content(path, MAX_BYTES)
    except InputError as error:
        named = naming(path, error).issues
        raise InputError([replace(issue, hint=issue.hint or _STARTER_HINT) for issue in named]) from None
    try:
        return found.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = found[: error.start].count(b"\n") + 1
        message = f"not UTF-8 text (byte 0x{found[error.start]:02x})"
        raise InputError(Issue(message, hint="save the file as UTF-8", file=str(path), line=line)) from None


def parse_yaml(text: str, file: str = "") -> ProblemDocument:
    """The document in a text; ``file`` is what messages call it.

    >>> parse_yaml("robot: {kind: preset, name: ur10}").data["robot"]["name"]
    'ur10'

    Raises:
        InputError: not YAML, empty, nested too deeply, or no mapping at the top.
    """
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
    """The node tree of a text; None of an empty one.

    Raises:
        InputError: not YAML, or characters that no text file has; with the line.
    """
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
    """PyYAML's error with the line that it is in, and a hint for the usual mistakes: tabs, a colon too many,
    indentation, several documents, a text that begins with ``*`` or ``&``.
    """
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
        hint = "a text that begins with * or & stands in quotes"
    return Issue(f"not YAML: {problem}" + (f", at '{here[:60]}'" if here else ""), (), None, hint, file, line)


class _Reader:
    """Converts composed nodes to plain data and notes lines, duplicate keys and foreign tags on the way.

    Args:
        file: what messages call the document.
    """

    def __init__(self, file: str) -> None:
        self.file = file
        self.lines: dict[KeyPath, int] = {}
        self.issues: list[Issue] = []
        self._open: set[int] = set()
        self._nodes = 0

    def value(self, node: yaml.Node, key: KeyPath) -> Plain:
        """The plain value of ``node``, which is at ``key``.

        Raises:
            InputError: aliases that contain themselves or unfold to too many entries.
        """
        self._nodes += 1
        line = node.start_mark.line + 1
        if self._nodes > _MAX_NODES:
            message = f"the aliases (*name) of the file unfold to more than {_MAX_NODES} entries"
            raise InputError(Issue(message, key[:1], hint="write the entries out", file=self.file, line=line))
        if id(node) in self._open:
            raise InputError(Issue("an alias (*name) contains itself", key[:1], None, "", self.file, line))
        self.lines.setdefault(key, line)
        if isinstance(node, yaml.ScalarNode):
            return self._scalar(node, key)
        self._open.add(id(node))
        try:
            if isinstance(node, yaml.MappingNode):
                return self._mapping(node, key)
            return [self.value(child, (*key, i)) for i, child in enumerate(node.value)]
        finally:
            self._open.discard(id(node))

    def _mapping(self, node: yaml.MappingNode, key: KeyPath) -> Section:
        """The entries of a mapping; its own keys take precedence over those that ``<<`` takes over."""
        data: Section = {}
        merged: Section = {}
        for name_node, child in node.value:
            line = name_node.start_mark.line + 1
            if name_node.tag == "tag:yaml.org,2002:merge":
                merged |= self._merged(child, key)
                continue
            name = self._name(name_node, key)
            if name in data:
                first = self.lines[(*key, name)]
                message = f"the key is given twice, first in line {first}"
                self.issues.append(Issue(message, (*key, name), None, "keep one of the two", self.file, line))
                continue
            self.lines[(*key, name)] = line
            data[name] = self.value(child, (*key, name))
        return {**merged, **data}

    def _merged(self, node: yaml.Node, key: KeyPath) -> Section:
        """The entries that ``<<: *name`` takes over."""
        value = self.value(node, key)
        parts = value if isinstance(value, list) else [value]
        if not all(isinstance(part, dict) for part in parts):
            line = node.start_mark.line + 1
            self.issues.append(Issue("'<<' takes over a mapping, nothing else", key, None, "", self.file, line))
            return {}
        return {name: entry for part in reversed(parts) for name, entry in part.items()}

    def _name(self, node: yaml.Node, key: KeyPath) -> str:
        """A key as it is written: a joint may be called 1, on or no."""
        if isinstance(node, yaml.ScalarNode) and node.value:
            return str(node.value)  # as it is written: a joint may be called 1, on or no
        line = node.start_mark.line + 1
        raise InputError(Issue("a key is a text", key, None, "put texts with [ or { in quotes", self.file, line))

    def _scalar(self, node: yaml.ScalarNode, key: KeyPath) -> Plain:
        """The value of a scalar by its tag; integers beyond 300 digits are infinite, as no float can hold them."""
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
            line = node.start_mark.line + 1
            self.issues.append(Issue(f"the tag {node.tag} is not used here", key, None, "remove it", self.file, line))
        return text


class _Dumper(yaml.SafeDumper):
    """PyYAML's writer, which quotes the texts that YAML 1.2 would read as something else."""

    yaml_implicit_resolvers = _Loader.yaml_implicit_resolvers

    def represent_mapping(self, tag: str, mapping: Plain, flow_style: bool | None = None) -> yaml.MappingNode:
        """Parameters with their quantities are written one a line: so they are found and compared."""
        node = super().represent_mapping(tag, mapping, flow_style)
        if len(mapping) > _MAX_PARAMETERS_IN_LINE and all("." in str(name) for name in mapping):
            node.flow_style = False
        return node


def dump_yaml(data: Section) -> str:
    """The YAML text that ``parse_yaml`` reads back as ``data``; small lists and mappings are written in one line.

    >>> print(dump_yaml({"robot": {"kind": "preset", "name": "ur10"}}), end="")
    robot: {kind: preset, name: ur10}
    """
    return yaml.dump(data, Dumper=_Dumper, sort_keys=False, allow_unicode=True, default_flow_style=None, width=110)


def dump_flow(data: Plain) -> str:
    """Data as YAML in one line.

    >>> dump_flow({"size": ["10 mm", 2]})
    '{size: [10 mm, 2]}'
    """
    text = yaml.dump(data, Dumper=_Dumper, sort_keys=False, allow_unicode=True, default_flow_style=True, width=math.inf)
    return text.removesuffix("\n").removesuffix("\n...")


def dump_scalar(text: str) -> str:
    """A text as a YAML scalar in one line, in quotes where it needs them."""
    return yaml.dump(text, Dumper=_Dumper, allow_unicode=True, width=math.inf).removesuffix("\n").removesuffix("\n...")


def dump_texts(texts: Sequence[str]) -> str:
    """Texts as a YAML list in one line, each in double quotes.

    >>> print(dump_texts(["joint1", "a: b"]))
    ["joint1", "a: b"]
    """
    return yaml.dump(list(texts), default_style='"', default_flow_style=True, width=math.inf).removesuffix("\n")
