"""``Spec``: the frozen, closed base of everything that a user writes in YAML."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Union

from pydantic import BaseModel, ConfigDict, Field


class Spec(BaseModel):
    """A section of the problem file: its fields are the YAML keys, unknown keys are errors, values never change."""

    model_config: ClassVar[ConfigDict] = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, defer_build=True)


def one_of(kinds: tuple[type[Spec], ...]) -> Any:
    """The type of a section that is one of several kinds, told apart by its key ``kind``."""
    return Annotated[Union[kinds], Field(discriminator="kind")] if len(kinds) > 1 else kinds[0]  # noqa: UP007 – of a tuple
