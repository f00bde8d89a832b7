"""What the solver of the problem says of an answer, as a statement."""

from __future__ import annotations

import math

from posture_opt.selection.search.confirmation import Confirmation
from posture_opt.statements import Quantity, Statement, state


def confirmed(said: Confirmation | None) -> tuple[Statement, ...]:
    """Whether the solver ends at the answer too; nothing where it was not asked."""
    if said is None:
        return ()
    if not said.differs:
        name = "confirmed"
    elif math.isnan(said.agrees):
        name = "confirmation-failed"
    else:
        name = f"confirmation-{'better' if said.taken else 'worse'}"
    return (state(f"selection.{name}", iterations=said.iterations, difference=Quantity(said.agrees, "share")),)
