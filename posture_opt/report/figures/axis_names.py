"""What an axis of a figure is called, by what it means to the task; and its numbers where it is logarithmic."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from posture_opt.numerics import Array
from posture_opt.report.text.words import PARTS, line_words

if TYPE_CHECKING:
    from matplotlib.axis import Axis

    from posture_opt.uncertainty.regions.critical import Critical

_MAX_LABELLED_DECADES = 2.5  # more of them need no ticks between
_PARALLEL_SINE = 1e-6  # sine of the angle below which two lines are one
_UP = np.array([0.0, 0.0, 1.0])


def axis_name(axis: Array, direction: Array | None = None) -> str:
    """What the axis of a figure is called.

    A coordinate axis by its letter, else by the direction of the task, by the horizontal or, with neither, as
    "sideways" or "steepest" of the plane drawn.

    Args:
        axis: (3,) unit vector, world.
        direction: (3,) unit vector of the task, world; None where there is none.
    """
    letter = line_words(axis)
    if len(letter) == 1:
        return letter
    if direction is not None and _parallel(axis, direction):
        return "along the direction of the task"
    across = direction is not None and abs(float(axis @ direction)) < _PARALLEL_SINE
    where = "horizontally" if abs(float(axis[2])) < _PARALLEL_SINE else "upwards"
    return f"across the direction, {where}" if across else f"{where} in the plane drawn"


def levelled(plane: Array) -> Array:
    """Another orthonormal basis (2, 3) of a plane (2, 3): along coordinate axes, else with the first horizontal.

    Signs are chosen so that the largest entry of the first is positive and the second points upwards.
    """
    if all(len(line_words(axis)) == 1 for axis in plane):
        return plane
    normal = np.cross(plane[0], plane[1])
    letters = [e for e in np.eye(3) if abs(float(e @ normal)) < _PARALLEL_SINE]
    if len(letters) == 2:
        return np.array(letters)
    first = np.cross(_UP, normal)
    first = first / np.linalg.norm(first)
    first = first * np.sign(first[np.argmax(np.abs(first))])
    second = np.cross(normal, first)
    return np.array([first, second * (1.0 if second[2] >= 0 else -1.0)])


def critical_axis(critical: Critical) -> str:
    """Where the part that counts scatters most: "along the worst axis across the direction (x)"."""
    part = PARTS[critical.within]
    return with_letter(part if len(critical.covariance) == 1 else f"along the worst axis {part}", critical.worst_axis)


def with_letter(words: str, axis: Array) -> str:
    """Words for an axis, and its letter where it is one of the world's."""
    letter = line_words(axis)
    return f"{words} ({letter})" if len(letter) == 1 else words


def _parallel(a: Array, b: Array) -> bool:
    """Whether two unit vectors (3,) lie along one line."""
    return bool(np.linalg.norm(np.cross(a, b)) < _PARALLEL_SINE)


def decimals(axis: Axis) -> None:
    """Ticks of a logarithmic axis (x or y of some axes) as plain decimals; between decades where there are few."""
    from matplotlib.ticker import LogLocator, NullFormatter

    low, high = axis.get_view_interval()
    few = high / low < 10**_MAX_LABELLED_DECADES
    axis.set_major_locator(LogLocator(subs=(1, 2, 5) if few else (1,), numticks=20))
    axis.set_major_formatter(lambda value, _: f"{value:g}")
    axis.set_minor_formatter(NullFormatter())
