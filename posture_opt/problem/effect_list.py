"""The type of the section ``effects``: the effects are imported where a file has some, as few files do."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import GetCoreSchemaHandler, GetJsonSchemaHandler, TypeAdapter
from pydantic_core import CoreSchema, core_schema


@cache
def _adapter() -> TypeAdapter[Any]:
    from posture_opt.model.effects import EffectSpec

    return TypeAdapter(tuple[EffectSpec, ...])


class _WhenGiven:
    """Validates by the schema of all effects, which is built on first use: it takes as long as the rest together."""

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.no_info_plain_validator_function(lambda value: _adapter().validate_python(value))

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        return handler(_adapter().core_schema)


if TYPE_CHECKING:
    from posture_opt.model.effects import EffectSpec

    EffectList = tuple[EffectSpec, ...]
else:
    EffectList = Annotated[Any, _WhenGiven()]
