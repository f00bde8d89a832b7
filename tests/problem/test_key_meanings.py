"""Every key of a problem file has a meaning in the schema, from which the reference and the editors have it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from posture_opt.problem.schema import json_schema


def keys() -> Iterator[tuple[str, dict[str, Any]]]:
    schema = json_schema()
    for part, section in {"": schema, **schema["$defs"]}.items():
        for variant in (section, *section.get("anyOf", ())):
            for key, value in variant.get("properties", {}).items():
                yield f"{part}.{key}", value


def test_every_key_says_what_it_means() -> None:
    found = dict(keys())
    assert len(found) > 300
    bare = {
        name
        for name, value in found.items()
        if not name.endswith(".kind")
        and value.get("description", "") in ("", f"{value.get('dimension')} with its unit")
    }
    assert not bare
