"""How files write orientations, and what an orientation is beside a position."""

from __future__ import annotations

from collections.abc import Mapping

from posture_opt.measurements.kinds.kind import MeasuredQuantity

QUATERNION = ("qw", "qx", "qy", "qz")
"""Columns of a unit quaternion; either sign is one rotation."""
ANGLES = ("roll", "pitch", "yaw")
"""Columns of angles about fixed axes: ``R = Rz(yaw) Ry(pitch) Rx(roll)``."""
VECTOR = ("rx", "ry", "rz")
"""Columns of a rotation vector: unit axis times angle [rad]."""
ORIENTATION_GROUPS: Mapping[str, tuple[str, ...]] = {
    "quaternion": QUATERNION,
    "angles": ANGLES,
    "vector": VECTOR,
    "abc": ("a", "b", "c"),
    "wpr": ("w", "p", "r"),
    "matrix": tuple(f"r{row}{column}" for row in (1, 2, 3) for column in (1, 2, 3)),
}
"""Columns that hold an orientation: KUKA's A, B, C and FANUC's W, P, R among them, and a matrix row by row."""
ORIENTATIONS = tuple(name for group in ORIENTATION_GROUPS.values() for name in group)
"""All columns that hold an orientation."""
ORIENTATION = MeasuredQuantity("orientation", "rad", (3, 4, 5))
"""Rotation vector that turns the measured orientation into the model's, about the axes in which errors count."""
POSE_COLUMNS: Mapping[str, str] = {**dict.fromkeys("xyz", "length"), **dict.fromkeys(QUATERNION, "")}
"""Columns of a pose as it is kept -> dimension; empty of the quaternion, which has none."""
