"""``Confirmation``: what the solver of the problem says of the optimum that the local searches found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from posture_opt.numerics import Array, Json, finite_or_none

AGREEMENT = 1e-6
"""Relative difference of σ up to which the answers of two methods are the same."""
_DISAGREEMENT = 1e-3
"""Relative difference of σ, in three digits, from which the end of a search is no optimum that another method finds."""


@dataclass(frozen=True)
class Confirmation:
    """What a solver says of an optimum.

    Args:
        name: of the solver; ``iterations`` over all postures that went through it.
        kkt: the largest residual of the optimality conditions where it ended, scaled; NaN where it ended nowhere.
        agrees: relative difference of σ between what it was given and where it ended.
        taken: whether its end is the answer, as it is better.
        q: (n,) where it ended [rad or m].
        row_multipliers: (m,) there, of the scaled objective; ``bound_multipliers`` (n,) of the variables.
    """

    name: str
    iterations: int
    kkt: float
    agrees: float
    taken: bool = False
    q: Array = field(default_factory=lambda: np.zeros(0), repr=False)
    row_multipliers: Array = field(default_factory=lambda: np.zeros(0), repr=False)
    bound_multipliers: Array = field(default_factory=lambda: np.zeros(0), repr=False)

    @property
    def differs(self) -> bool:
        """Whether the two methods ended at different answers."""
        return not self.agrees <= AGREEMENT

    @property
    def refutes(self) -> bool:
        """Whether the solver left what it was given for something visibly else that is not the answer."""
        return not self.taken and self.agrees > _DISAGREEMENT

    def to_json(self) -> dict[str, Json]:
        """What the part ``solver`` of a document says of it."""
        kkt, agrees = finite_or_none(self.kkt), finite_or_none(self.agrees)
        return {"name": self.name, "iterations": self.iterations, "kkt": kkt, "agrees": agrees}


UNCONFIRMED_JSON: dict[str, Json] = {"name": "search", "iterations": 0, "kkt": None, "agrees": None}
"""The same of an answer that the search alone gave."""


def joined_confirmation(every: Sequence[Confirmation | None]) -> Confirmation | None:
    """What is said of several answers together: the largest residual and difference; None unless it is said of all."""
    known = [one for one in every if one is not None]
    if not known or len(known) < len(every):
        return None
    kkt, agrees = (float(np.max([getattr(one, name) for one in known])) for name in ("kkt", "agrees"))
    return Confirmation(
        known[0].name, sum(one.iterations for one in known), kkt, agrees, any(one.taken for one in known)
    )
