"""The reference of the problem file, read off its JSON Schema: every section, every kind, every key."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from typing import Any

from posture_opt.problem.schema import json_schema

Schema = dict[str, Any]
TITLES = {  # the sections of a file by the names of their keys
    "robot": "what moves",
    "uncertainty": "where the scatter comes from",
    "task": "what is to be done, and where",
    "cell": "obstacles, and whether the arm may collide with itself",
    "effects": "what moves or spreads the tool point beyond the geometry",
    "solver": "how the best posture is searched for",
    "data": "what is known about measurements besides their file",
}
PARTS = {  # sections within sections
    "JointSpec": "A joint of `dh` and `mdh`",
    "FrameSpec": "A frame: `base`, `tool`",
    "CapsuleSpec": "A capsule of `shape`",
    "ShapeSection": "`shape` as a section",
    "ToolSpec": "`tool`",
    "MountingSpec": "`mounting`",
    "MeasurementSpec": "`measurement`",
    "WorkpieceErrors": "`workpiece`: errors of where it stands",
    "FeatureErrors": "`feature`: errors of where a feature is in it",
    "Region": "`region`",
    "Workpiece": "`workpiece`",
    "Feature": "A feature",
    "PlaneSpec": "A plane of `planes`",
    "AnchorSpec": "An anchor of `anchors`",
    "CameraSpec": "A camera of `cameras`",
    "IntrinsicsSigma": "A `sigma` of intrinsics",
    "MarkersSpec": "A board of `markers`",
    "GridSpec": "A grid of points: `chessboard`, `grid`",
    "CharucoSpec": "A ChArUco board: `charuco`",
    "PairSpec": "A second arm of `pairs`",
}
PARTS_OF = {"JointSpec": "robot", "FrameSpec": "robot", "CapsuleSpec": "robot", "ShapeSection": "robot"}
PARTS_OF |= {"ToolSpec": "robot", "MountingSpec": "cell"}
PARTS_OF |= dict.fromkeys(("MeasurementSpec", "WorkpieceErrors", "FeatureErrors"), "uncertainty")
OF_DATA = (
    "PlaneSpec",
    "AnchorSpec",
    "CameraSpec",
    "IntrinsicsSigma",
    "MarkersSpec",
    "GridSpec",
    "CharucoSpec",
    "PairSpec",
)
PARTS_OF |= dict.fromkeys(OF_DATA, "data")
PARTS_OF |= {"Region": "task", "Workpiece": "task", "Feature": "task"}


def problem_file_page() -> str:
    """All sections in the order of the schema."""
    schema = json_schema()
    defs = {name: with_keys(part) for name, part in schema["$defs"].items()}
    parts = [f"## Top level\n\n{key_table(schema, set(schema['properties']), defs)}"]
    for name, title in TITLES.items():
        parts += [f"## `{name}`: {title}\n", *section(schema["properties"][name], defs)]
        parts += [f"### {PARTS[p]}\n\n{described(defs[p], defs)}" for p, at in PARTS_OF.items() if at == name]
    terms = defs["Insert"]["properties"]["subject_to"]
    parts += ["## Terms: `minimize`, `subject_to`\n", *section(terms, defs)]
    return "\n".join(parts)


def with_keys(schema: Schema) -> Schema:
    """The part that has keys, of a section that may also be a single word (``free``, ``none``)."""
    return next((part for part in (schema, *schema.get("anyOf", ())) if "properties" in part), schema)


def section(schema: Schema, defs: Schema) -> Iterator[str]:
    """The keys of a section; of one that comes in kinds, those that all share and then kind by kind."""
    kinds = kinds_of(schema, defs)
    if not kinds:
        for name in references(schema):
            yield described(defs[name], defs)
            for key, value in defs[name].get("properties", {}).items():
                yield from inner_kinds(key, value, defs)
        return
    yield from kind_tables(kinds, defs)


def inner_kinds(key: str, schema: Schema, defs: Schema) -> Iterator[str]:
    kinds = kinds_of(schema, defs)
    if kinds:
        yield f"Kinds of `{key}`:\n"
        yield from kind_tables(kinds, defs)


def kind_tables(kinds: dict[str, Schema], defs: Schema) -> Iterator[str]:
    shared = set.intersection(*({*kind["properties"]} for kind in kinds.values())) - {"kind"}
    if len(kinds) > 1 and shared:
        first = next(iter(kinds.values()))
        yield f"Keys of every kind:\n\n{key_table(first, shared, defs)}"
    for name, kind in kinds.items():
        own = set(kind["properties"]) - (shared if len(kinds) > 1 else set()) - {"kind"}
        table = key_table(kind, own, defs) if own else ""
        yield f"### `{name}`\n\n{doc(kind)}{table}"


def kinds_of(schema: Schema, defs: Schema) -> dict[str, Schema]:
    """Kind -> its schema, where a section or the items of a list come in kinds."""
    for part in (schema, schema.get("items", {}), *schema.get("anyOf", ())):
        if "discriminator" in part:
            mapping = part["discriminator"]["mapping"]
            return {kind: defs[ref.rpartition("/")[2]] for kind, ref in sorted(mapping.items())}
    return {}


def described(schema: Schema, defs: Schema) -> str:
    return doc(schema) + key_table(schema, set(schema["properties"]), defs)


def doc(schema: Schema) -> str:
    """The docstring as Markdown: code in one pair of backticks, formulas left as code."""
    text = re.sub(r"``(.+?)``", r"`\1`", schema.get("description", ""))
    text = re.sub(r" \(see `[A-Z]\w+`\)", "", text)  # a class has no page here
    paragraphs = [" ".join(p.split()) for p in text.split("\n\n") if not p.startswith("Args:")]
    return "\n\n".join(paragraphs) + "\n\n" if paragraphs else ""


def key_table(schema: Schema, keys: set[str], defs: Schema) -> str:
    rows = []
    for key, value in schema["properties"].items():
        if key in keys:
            required = key in schema.get("required", ())
            rows.append(f"| `{key}` | {value_text(value)} | {default(value, required)} | {meaning(value, defs)} |")
    return "| key | value | default | meaning |\n| --- | --- | --- | --- |\n" + "\n".join(rows) + "\n"


def meaning(value: Schema, defs: Schema) -> str:
    text = str(value.get("description", "")).replace("``", "`").replace("|", r"\|")
    return "" if "dimension" in value and text == f"{value['dimension']} with its unit" else text


def default(value: Schema, required: bool) -> str:
    if required:
        return "required"
    given = value.get("default")
    if given in (None, {}, [], "") or isinstance(given, dict):
        return ""
    return f"`{json.dumps(given, ensure_ascii=False).replace('.0', '')}`"


def value_text(value: Schema) -> str:
    """What may stand there, with an example where it has a unit."""
    if "const" in value:
        return f"`{value['const']}`"
    if "enum" in value:
        return ", ".join(f"`{x}`" for x in value["enum"])
    if "discriminator" in value:
        return "one of the kinds below"
    if options := value.get("anyOf"):
        return " or ".join(dict.fromkeys(value_text(o) for o in options if o.get("type") != "null"))
    if "$ref" in value:
        return section_name(value["$ref"].rpartition("/")[2])
    if value.get("type") == "array":
        return array_text(value)
    if value.get("type") == "object":
        inner = value.get("additionalProperties")
        return f"`NAME`: {value_text(inner)}" if isinstance(inner, dict) and inner else "keys with values"
    if examples := value.get("examples"):
        return " or ".join(f"`{example}`" for example in examples)
    kinds = value.get("type", "text")
    names = {"string": "text", "boolean": "`true`, `false`", "integer": "integer", "number": "number"}
    return " or ".join(names.get(k, k) for k in ([kinds] if isinstance(kinds, str) else kinds))


def array_text(value: Schema) -> str:
    if items := value.get("prefixItems"):
        texts = [value_text(item) for item in items]
        if len(set(texts)) == 1:
            return f"{len(texts)} × {texts[0]}"
        return "[" + ", ".join(texts) + "]"
    return f"list: {value_text(value.get('items', {}))}"


def section_name(name: str) -> str:
    if name == "FrameSpec":
        return "a frame, or `free`"
    if name == "Ipopt":  # the only kind of solver
        return "see `solver`"
    return PARTS.get(name, f"see `{name.removesuffix('Spec').lower()}`").replace("A ", "a ").replace("An ", "an ")


def references(schema: Schema) -> list[str]:
    parts = (schema, *schema.get("anyOf", ()))
    return [part["$ref"].rpartition("/")[2] for part in parts if "$ref" in part]
