"""The terms: one file each, listed here."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from posture_opt.selection.terms.limit_margin import LimitMargin
from posture_opt.selection.terms.link_height import LinkHeight
from posture_opt.selection.terms.near_posture import NearPosture
from posture_opt.selection.terms.singularity_margin import SingularityMargin
from posture_opt.selection.terms.spread import SpreadTerm
from posture_opt.selection.terms.term import Term

TERMS: tuple[type[Term], ...] = (SpreadTerm, LimitMargin, LinkHeight, SingularityMargin, NearPosture)

TermSpec = Annotated[
    SpreadTerm | LimitMargin | LinkHeight | SingularityMargin | NearPosture, Field(discriminator="kind")
]

__all__ = ["TERMS", "Term", "TermSpec"]
