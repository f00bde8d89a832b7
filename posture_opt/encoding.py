"""JSON documents: from frozen results to plain data, and to text."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Mapping, Sequence
from operator import attrgetter
from typing import TYPE_CHECKING, ClassVar

from posture_opt import __version__

if TYPE_CHECKING:
    from posture_opt.numerics import Json


class Encoded:
    """Frozen data that is a part of a document.

    Args:
        json: the keys with the attributes they hold, ``rows`` or ``interval95=gain.interval``; one with a question
            mark is left out where its value is None; ``*gain`` stands for all keys of a part. All fields of the
            dataclass where nothing is listed.

    Example:
        >>> @dataclasses.dataclass
        ... class Rows(Encoded, json="rows std=error?"):
        ...     rows: int
        ...     error: float | None = None
        >>> Rows(3).to_json()
        {'rows': 3}
    """

    _keys: ClassVar[str] = ""

    def __init_subclass__(cls, json: str = "") -> None:
        cls._keys = json or cls._keys

    def fields_json(self) -> Mapping[str, object]:
        """The entries by their keys: plain values, arrays, other parts, and tuples and mappings of them."""
        return encoded(self, self._keys)

    def to_json(self) -> dict[str, Json]:
        """This part as plain data: SI units and radians."""
        return {key: encode(value) for key, value in self.fields_json().items()}


def encoded(whole: object, keys: str = "") -> dict[str, Json]:
    """Attributes of an object as plain data, by ``keys`` as `Encoded` has them.

    Example:
        >>> encoded(3 + 4j, "real size=imag")
        {'real': 3.0, 'size': 4.0}
    """
    document: dict[str, Json] = {}
    for entry in keys.split() or [own.name for own in dataclasses.fields(whole)]:  # type: ignore[arg-type]
        key, _, path = entry.strip("*?").partition("=")
        value = attrgetter(path or key)(whole)
        if entry.startswith("*"):
            document |= {} if value is None else value.to_json()
        elif value is not None or not entry.endswith("?"):
            document[key] = encode(value)
    return document


def encode(value: object) -> Json:
    """Nested data as JSON has it: lists, objects with texts as keys, null in place of NaN and infinity."""
    if value is None or isinstance(value, bool | int | str):
        return value
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    if hasattr(value, "tolist"):  # an array; completion of a word may not load NumPy
        return encode(value.tolist())
    if isinstance(value, Mapping):
        return {str(key): encode(entry) for key, entry in value.items()}
    if isinstance(value, Sequence):
        return [encode(entry) for entry in value]
    own = getattr(value, "to_json", None)
    return encoded(value) if own is None else own()


def json_text(document: Mapping[str, object]) -> str:
    """A document as JSON text with the version of the program in front.

    Example:
        >>> json_text({"sigma": math.nan}).splitlines()[-2]
        '  "sigma": null'
    """
    whole = encode({"posture_opt": __version__, **document})
    return json.dumps(whole, indent=2, ensure_ascii=False, allow_nan=False)
