"""The terms: one file each, listed here."""

from __future__ import annotations

from typing import TYPE_CHECKING

from posture_opt.selection.terms.fixed_joints import FixedJoints
from posture_opt.selection.terms.joint_torque import JointTorque
from posture_opt.selection.terms.limit_margin import LimitMargin
from posture_opt.selection.terms.link_height import LinkHeight
from posture_opt.selection.terms.manipulability import Manipulability
from posture_opt.selection.terms.near_posture import NearPosture
from posture_opt.selection.terms.orientation_spread import OrientationSpread
from posture_opt.selection.terms.singularity_margin import SingularityMargin
from posture_opt.selection.terms.spread import SpreadTerm
from posture_opt.selection.terms.success import Success
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
