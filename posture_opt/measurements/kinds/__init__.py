"""The kinds of measurement, listed here."""

from posture_opt.measurements.kinds.camera import MarkerPixels
from posture_opt.measurements.kinds.contact import PlaneContact, PlaneSpec, PointContact
from posture_opt.measurements.kinds.distance import AnchorDistance, AnchorSpec
from posture_opt.measurements.kinds.kind import Kind, MeasuredQuantity, Seen
from posture_opt.measurements.kinds.level import Level
from posture_opt.measurements.kinds.mixed import Member, Mixed
from posture_opt.measurements.kinds.pair import PairContact, PairSpec
from posture_opt.measurements.kinds.pose import BoardPose, CameraPose, Pose
from posture_opt.measurements.kinds.position import Position

# All kinds; the columns of a file say which of them it holds
KINDS: tuple[type[Kind], ...] = (
    Position, Pose, PointContact, PlaneContact, AnchorDistance, MarkerPixels, Level, PairContact,
)  # fmt: skip

__all__ = [
    "KINDS",
    "AnchorDistance",
    "AnchorSpec",
    "BoardPose",
    "CameraPose",
    "Kind",
    "Level",
    "MarkerPixels",
    "MeasuredQuantity",
    "Member",
    "Mixed",
    "PairContact",
    "PairSpec",
    "PlaneContact",
    "PlaneSpec",
    "PointContact",
    "Pose",
    "Position",
    "Seen",
]
