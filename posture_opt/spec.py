"""``Spec``: the frozen, closed base of everything that a user writes in YAML."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Annotated, Any, ClassVar, Union, get_args

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    GetJsonSchemaHandler,
    ValidationInfo,
    field_validator,
    model_validator,
)
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema

from posture_opt.errors import BadValueError
from posture_opt.units import is_bare_zero


class Spec(BaseModel):
    """A section of the problem file: its fields are the YAML keys, unknown keys are errors, values never change."""

    model_config: ClassVar[ConfigDict] = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, defer_build=True)

    @model_validator(mode="before")
    @classmethod
    def _round_to_zero(cls, given: object) -> object:
        """The section as given with zeros for its `NEGLIGIBLE` numbers; names and other texts stay as they are."""
        if not isinstance(given, dict):
            return given
        fields = cls.model_fields.items()
        texts = {key for key, field in fields if str in (field.annotation, *get_args(field.annotation))}
        return {key: value if key in texts else _without_rounding(value) for key, value in given.items()}

    @field_validator("*", mode="after")
    @classmethod
    def _refuse_implausible(cls, value: object, info: ValidationInfo) -> object:
        for number in _numbers_in(value) if info.field_name != "seed" else ():
            if abs(number) > 1e12:  # SI: squares of larger ones lose all digits
                raise BadValueError(f"{number:.6g} is not plausible", "is the exponent right?")
        return value


def _without_rounding(value: object) -> object:
    if isinstance(value, tuple | list):
        return [_without_rounding(entry) for entry in value]
    return 0.0 if isinstance(value, float | str) and is_bare_zero(value) and float(value) else value


class WordOrSection(Spec):
    """A section that a file may abbreviate by one word: ``free``, ``none``."""

    word: ClassVar[str]
    meaning: ClassVar[Mapping[str, object]]  # The keys that the word stands for
    noun: ClassVar[str]
    example: ClassVar[str]  # What could be written in its place

    @model_validator(mode="before")
    @classmethod
    def _expanded_word(cls, value: object) -> object:
        if isinstance(value, str):
            if value.strip() != cls.word:
                raise BadValueError(f"'{value}' is no {cls.noun}", f"write {cls.word} or {cls.example}")
            return dict(cls.meaning)
        return value

    @classmethod
    def __get_pydantic_json_schema__(cls, schema: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        """The schema of the section, or the word."""
        return {"anyOf": [handler(schema), {"const": cls.word}]}


def _numbers_in(value: object) -> Iterator[float]:
    if isinstance(value, float | int):
        if math.isfinite(value):
            yield value
    elif isinstance(value, tuple | list):
        for entry in value:
            yield from _numbers_in(entry)
    elif isinstance(value, dict):
        yield from _numbers_in(list(value.values()))


def one_of(kinds: tuple[type[Spec], ...]) -> Any:
    """The type of a section that is one of several kinds, discriminated by its key ``kind``."""
    return Annotated[Union[kinds], Field(discriminator="kind")] if len(kinds) > 1 else kinds[0]  # noqa: UP007 – of a tuple


def class_name(kind: str) -> str:
    """The class of a kind that has a file of its own.

    Example:
        >>> class_name("joint_scale")
        'JointScale'
    """
    return "".join(word.capitalize() for word in kind.split("_"))
