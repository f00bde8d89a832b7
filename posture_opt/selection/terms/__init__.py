"""The terms, listed here."""

from __future__ import annotations

from typing import TYPE_CHECKING

from posture_opt.selection.terms.arm_terms import JointTorque, LinkHeight
from posture_opt.selection.terms.dexterity import Manipulability, SingularityMargin
from posture_opt.selection.terms.joint_terms import FixedJoints, LimitMargin, NearPosture
from posture_opt.selection.terms.spreads import OrientationSpread, SpreadTerm, Success
from posture_opt.selection.terms.term import Term
from posture_opt.spec import one_of

TERMS: tuple[type[Term], ...] = (
    SpreadTerm,
    OrientationSpread,
    Success,
    LimitMargin,
    LinkHeight,
    SingularityMargin,
    Manipulability,
    JointTorque,
    NearPosture,
    FixedJoints,
)

if TYPE_CHECKING:
    TermSpec = Term
else:
    TermSpec = one_of(TERMS)

__all__ = ["TERMS", "Term", "TermSpec"]
