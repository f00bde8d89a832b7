"""Measurements that look wrong as a whole: another unit, swapped columns, a mirrored frame, another robot's file.

What is guessed is reported and never applied: the user knows what was measured.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from posture_opt.measurements.affine_fit import AffineFit, Misfit, affine_fit, reach, sample_rows, touch_misfit
from posture_opt.measurements.columns import AXES, Column
from posture_opt.measurements.faults import Faults
from posture_opt.measurements.measurements import Measurements, nominal_poses
from posture_opt.numerics import Array
from posture_opt.robot.robot import Robot

_LENGTH_UNITS = {"m": 1.0, "mm": 1e-3, "um": 1e-6, "cm": 1e-2, "in": 0.0254}
"""Units of length -> [m], in which coordinates may have been written."""
_POOR_MISFIT = 0.03
"""Unexplained share of the motion from which a wrong column is looked for; joint errors of 2 deg leave as much."""
_POOR_ERROR = 0.012
"""What is left over the reach of the arm, from which on columns may be exchanged or reversed: `_POOR_MISFIT` of the
motion through a whole workspace. In a small volume joint errors of 2 deg leave up to 0.19 of the motion, and 0.007."""
_GOOD_MISFIT = 0.05
"""Unexplained share that a guess must leave at most."""
_IMPROVEMENT_FACTOR = 5.0
"""How many times less than the columns as given a guess must leave."""
_UNLIKE_MISFIT = 0.1
"""Unexplained share from which a warning says that another robot may have been measured."""
_MAX_DISTANCE_RATIO = 1e4
"""Lengths of the arm from the middle of all points; a wrong unit makes a thousand of one."""
_TRUSTED_MISFIT = 0.2
"""Unexplained share up to which scale and sign of the fitted map mean something."""


@dataclass(frozen=True)
class Guess:
    """Columns read in another way.

    Args:
        q: (m, n) the joint values that follow [rad or m].
        message: what is assumed.
        hint: how to correct the file.
        column: the key of the message.
        unit: whether it is the unit, by which a value is many times another one; else joints are exchanged or reversed.
    """

    q: Array
    message: str
    hint: str
    column: str
    unit: bool = False


def plausibility_checks(data: Measurements, robot: Robot, columns: dict[str, Column], faults: Faults) -> list[str]:
    """Warnings on data that can be used; what cannot be meant as it is joins ``faults``.

    Args:
        data: all rows; a sample of at most 400 is checked.
        robot: the nominal arm.
        columns: of the file, for names and units.
        faults: of the file.
    """
    rows = sample_rows(data)
    q = data.q[rows]
    if data.position is None and not data.touches:
        return []
    if data.position is None:
        point = data.point[rows]
        misfit = touch_misfit(robot, q, point)
        guessed = _guess_columns(lambda q: touch_misfit(robot, q, point), (misfit, misfit), q, robot, columns, faults)
        return [] if guessed else _unlike_note(misfit, None, "how far the touches of one point lie apart")
    if _far_off(data, data.position[:, data.measured_axes], robot, faults):
        return []
    measured = data.position[rows][:, data.measured_axes]
    found = affine_fit(robot, q, measured)
    named = [axis for axis in AXES if axis in columns]
    left = found.misfit, found.misfit * float(np.sqrt(np.sum(np.var(measured, axis=0)))) / reach(robot)
    if _guess_columns(lambda q: affine_fit(robot, q, measured).misfit, left, q, robot, columns, faults):
        return []
    if _wrong_lengths(found, measured, q, robot, [columns[axis] for axis in named], faults):
        return []
    if _is_mirrored(found, robot, named, faults):
        return []
    return [
        *_unlike_note(found.misfit, _motion_scale(found), "of the measured motion"),
        *_turned_note(found, robot, named),
    ]


def _far_off(data: Measurements, position: Array, robot: Robot, faults: Faults) -> bool:
    """Whether rows were measured where no instrument could have seen the tool: no outlier of an instrument."""
    size = max(reach(robot), 1.0)
    off = np.linalg.norm(position - np.median(position, axis=0), axis=1)
    far = np.flatnonzero(off > _MAX_DISTANCE_RATIO * size)
    for row in map(int, far):
        message = f"the point lies {off[row]:.3g} m from the middle of all, and the arm is {size:.3g} m long"
        faults.add(message, hint="leave out the row", line=int(data.line[row]))
    return bool(len(far))


def _motion_scale(found: AffineFit) -> float | None:
    """How many times as far as the nominal tool the measured point moves; None where the fit is too poor."""
    if found.map is None or not found.misfit < _TRUSTED_MISFIT:
        return None
    return float(np.sqrt(np.sum(found.map**2) / len(found.axes)))


def _wrong_lengths(
    found: AffineFit, measured: Array, q: Array, robot: Robot, columns: list[Column], faults: Faults
) -> bool:
    """Whether coordinates look like another unit of length, each column for itself where the data determine that."""
    scales: Array
    if found.misfit < _TRUSTED_MISFIT and found.map is not None and len(found.axes) == len(columns):
        scales = np.linalg.norm(found.map, axis=1)
    else:
        scales = np.full(len(columns), _motion_scale(found) or _distance_ratio(measured, q, robot))
    guesses = [_likely_unit(scale, column) for scale, column in zip(scales, columns, strict=True)]
    for unit in dict.fromkeys(guess for guess in guesses if guess):
        those = [column for column, guess in zip(columns, guesses, strict=True) if guess == unit]
        ratio = float(scales[guesses.index(unit)])
        names = ", ".join(column.name for column in those)
        message = f"the measured points move {ratio:.3g} times as far along {names} as the nominal robot's tool"
        hint = f"the numbers look like {unit}: write " + ", ".join(f"{column.name} [{unit}]" for column in those)
        faults.add(message, those[0].name, hint=hint)
    return any(guesses)


def _distance_ratio(measured: Array, q: Array, robot: Robot) -> float:
    """The median ratio of distances between measured points to those of the nominal tool points; NaN for none."""
    points, _ = nominal_poses(robot, q)
    order = np.random.default_rng(0).permutation(len(q))
    nominal = np.linalg.norm(points[order] - points[np.roll(order, 1)], axis=1)
    distance = np.linalg.norm(measured[order] - measured[np.roll(order, 1)], axis=1)
    # A tool offset that is not known yet moves the point too: postures that leave the nominal point say nothing.
    far = nominal > 0.05 * reach(robot)
    return float(np.median(distance[far] / nominal[far])) if far.any() else math.nan


def _likely_unit(scale: float, column: Column) -> str:
    """The unit that the numbers of a column seem to have, by the scale of their motion; empty where it is the stated
    one.
    """
    if not scale > 0 or 0.2 < scale < 5:
        return ""
    for units, tolerance in ((("m", "mm", "um"), 5.0), (("cm", "in"), 1.3)):
        for unit in units:
            if abs(math.log(scale * _LENGTH_UNITS[unit] / column.factor)) < math.log(tolerance):
                return unit
    return ""


def _guess_columns(
    misfit_of: Misfit, left: tuple[float, float], q: Array, robot: Robot, columns: dict[str, Column], faults: Faults
) -> bool:
    """Whether the joints are only plausible when read in another way; the best guess is then a fault.

    Within a small volume other columns may explain data better by chance, so joints are taken for exchanged or reversed
    only where what is left of the data as given is far more than an arm can be off by.

    Args:
        misfit_of: unexplained share of joint values (m, n).
        left: that of ``q`` (m, n) as given, and what is unexplained over the reach of the arm.
    """
    misfit, error = left
    if not misfit > _POOR_MISFIT:
        return False
    bad = misfit > _TRUSTED_MISFIT or error > _POOR_ERROR
    tried = [(misfit_of(guess.q), guess) for guess in _possible_guesses(q, robot, columns) if guess.unit or bad]
    best, guess = min(tried, key=lambda pair: pair[0], default=(math.inf, None))
    if guess is None or not best < min(_GOOD_MISFIT, misfit / _IMPROVEMENT_FACTOR):
        return False
    said = f"the nominal robot explains the data to {_explained_percent(best)} if {guess.message}, as given only to"
    faults.add(f"{said} {_explained_percent(misfit)}", guess.column, hint=guess.hint)
    return True


def _explained_percent(misfit: float) -> str:
    """The explained share in per cent, at least 0."""
    return f"{100 * max(1 - misfit, 0):.3g} %"


def _possible_guesses(q: Array, robot: Robot, columns: dict[str, Column]) -> Iterator[Guess]:
    """Every way in which units, signs or headers of joint columns may have been mistaken."""
    names = robot.joint_names
    for stated, meant, factor, kind in (
        ("deg", "rad", 180 / math.pi, "revolute"),
        ("rad", "deg", math.pi / 180, "revolute"),
        ("mm", "m", 1e3, "prismatic"),
        ("m", "mm", 1e-3, "prismatic"),
    ):
        those = [j for j, joint in enumerate(robot.joints) if joint.type == kind and columns[names[j]].unit == stated]
        for some in dict.fromkeys([tuple(those), *((j,) for j in those)]):
            if some and (factor > 1 or _beyond_limits(q, robot, some)):
                other = q.copy()
                other[:, some] *= factor
                which = ", ".join(names[j] for j in some)
                hint = "write " + ", ".join(f"{names[j]} [{meant}]" for j in some)
                yield Guess(other, f"the numbers of {which} are {meant}", hint, names[some[0]], unit=True)
    for i, name in enumerate(names):
        other = q.copy()
        other[:, i] *= -1
        message = f"{name} counts in the opposite direction"
        yield Guess(other, message, f"turn the sign of the numbers of {name}, or its axis in the problem file", name)
    for i, j in combinations(range(robot.n), 2):
        if robot.joints[i].type == robot.joints[j].type:
            other = q.copy()
            other[:, [i, j]] = q[:, [j, i]]
            message = f"the columns {names[i]} and {names[j]} are exchanged"
            yield Guess(other, message, "are the two swapped? exchange their headers", names[i])


def _beyond_limits(q: Array, robot: Robot, some: tuple[int, ...]) -> bool:
    """Whether any of these joints leaves its limits: numbers that are too large for their unit do."""
    return any(q[:, j].max() > robot.upper[j] or q[:, j].min() < robot.lower[j] for j in some)


def _square_map(found: AffineFit) -> Array | None:
    """The map (k, k) between as many axes as are measured, where the fit is good enough to trust its sign."""
    if found.map is None or found.map.shape[0] != found.map.shape[1] or not found.misfit < _TRUSTED_MISFIT:
        return None
    return found.map


def _is_mirrored(found: AffineFit, robot: Robot, named: list[str], faults: Faults) -> bool:
    """Whether the measured frame is left-handed, which no robot's motion can be."""
    square = _square_map(found)
    if square is None or np.linalg.det(square) > 0 or np.linalg.cond(square) > 2:
        return False
    guess = "two of the columns are swapped, or one has the opposite sign"
    if not robot.base_free:
        guess = _mirrored_columns(square, named) or guess
    message = f"the measured frame is left-handed: the points are the mirror image of the nominal robot's ({guess})"
    faults.add(message, named[0], hint=f"correct the columns {', '.join(named)}")
    return True


def _mirrored_columns(square: Array, named: list[str]) -> str:
    """The two swapped columns or the reversed one, by a map (k, k) in a frame that is known; empty where neither
    fits.
    """
    for i, j in combinations(range(len(named)), 2):
        swapped = np.eye(len(named))[[j if k == i else i if k == j else k for k in range(len(named))]]
        if np.abs(square - swapped).max() < 0.3:
            return f"{named[i]} and {named[j]} look swapped"
    for i, name in enumerate(named):
        flipped = np.diag([-1.0 if k == i else 1.0 for k in range(len(named))])
        if np.abs(square - flipped).max() < 0.3:
            return f"{name} looks as if it had the opposite sign"
    return ""


def _turned_note(found: AffineFit, robot: Robot, named: list[str]) -> list[str]:
    """A warning where the problem states the base and the data are in another frame, by more than 10 deg."""
    square = _square_map(found)
    if robot.base_free or square is None:
        return []
    left, _, right = np.linalg.svd(square)
    cosine = (np.trace(left @ right) - (1 if len(named) == 3 else 0)) / 2
    angle = math.degrees(math.acos(min(1.0, max(-1.0, cosine))))
    if angle < 10:
        return []
    return [
        f"the measured frame is turned by {angle:.0f} deg against the base of the problem file: state the base, or "
        "write base: free to have it found"
    ]


def _unlike_note(misfit: float, scale: float | None, what: str) -> list[str]:
    """A warning where no base and no tool lets the nominal robot come near the data."""
    if misfit > _UNLIKE_MISFIT:
        return [
            f"whatever base and tool, the nominal robot leaves {100 * misfit:.3g} % unexplained ({what}): is it "
            "another robot's file, or are signs or zeros of joints different?"
        ]
    if scale is not None and not 0.9 < scale < 1.1:
        return [
            f"the measured points move {scale:.3g} times as far as the nominal robot's: is it another robot's file?"
        ]
    return []
