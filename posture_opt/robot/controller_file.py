"""What a controller, or its ROS driver, stores of the calibration of one arm.

A UR's ``calibration.conf`` has what is added to the Denavit-Hartenberg table of its type, ``delta_theta``, ``delta_a``,
``delta_d``, ``delta_alpha`` [rad, m]; the YAML of UR's and UFACTORY's drivers has the origin of each joint in the frame
of the joint before, ``x y z roll pitch yaw`` (a URDF's). Sources: ur_calibration, algorithm (docs.ros.org);
xarm_ros2, xarm_description/config/kinematics.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from pathlib import Path

from posture_opt.errors import BadValueError, InputError, Issue
from posture_opt.files import located, named_content
from posture_opt.robot.axes import axes_of, beside_bodies, nearest_values
from posture_opt.robot.robot import Factor, Robot, frame_factors

CALIBRATED_MAKERS = ("Universal Robots", "UFACTORY")  # whose files are read; the names of their presets begin so
_MOST_BYTES = 1_000_000
_DELTA = re.compile(r"^\s*delta_?(theta|alpha|a|d)\s*=\s*\[([^\]]*)\]", re.IGNORECASE | re.MULTILINE)
_UR_LINKS = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")
_ORIGIN = ("x", "y", "z", "roll", "pitch", "yaw")


def controller_values(nominal: Robot, folder: Path, file: str) -> dict[str, float]:
    """What the file adds to the parameters of the nominal arm [rad or m], frames beside the nominal ones."""
    path = located(folder, file)
    text = named_content(path, _MOST_BYTES).decode("utf-8", "replace")
    try:
        deltas = {name.lower(): _numbers(values, nominal) for name, values in _DELTA.findall(text)}
        return beside_bodies(nominal, _corrections(deltas, nominal)) if deltas else _of_origins(text, nominal)
    except BadValueError as error:
        raise InputError(Issue(error.message, hint=error.hint, file=str(path))) from None


def _numbers(text: str, nominal: Robot) -> list[float]:
    try:
        found = [float(word) for word in text.split(",")]
    except ValueError:
        found = []
    if len(found) != nominal.n or not all(map(math.isfinite, found)):
        raise BadValueError(f"a list has not {nominal.n} numbers, one a joint", "is it of another arm?")
    return found


def _corrections(deltas: Mapping[str, list[float]], nominal: Robot) -> dict[str, float]:
    # A turn more is the same angle: math.remainder is nearest to zero.
    given = {
        f"{joint}.{name}": math.remainder(value, math.tau) if name in ("theta", "alpha") else value
        for name, values in deltas.items()
        for joint, value in zip(nominal.joint_names, values, strict=True)
    }
    if not nominal.name.startswith("Universal Robots"):
        raise BadValueError(f"a calibration.conf is of an arm of Universal Robots, not of {nominal.name}")
    if missing := sorted({*given} - {*nominal.parameters}):
        raise BadValueError(f"the arm has no parameter {missing[0]}", "name a preset with a Denavit-Hartenberg table")
    return given


def _of_origins(text: str, nominal: Robot) -> dict[str, float]:
    import yaml

    try:
        found = yaml.safe_load(text)
    except yaml.YAMLError:
        found = None
    found = found.get("kinematics", found) if isinstance(found, dict) else None
    links = found.items() if isinstance(found, dict) else ()
    rows = {name: row for name, row in links if isinstance(row, dict) and {*_ORIGIN} <= {*row}}
    names = _UR_LINKS if {*_UR_LINKS} == {*rows} else sorted(rows, key=str)
    if len(names) != nominal.n:
        hint = "a UR's calibration.conf, or a driver's YAML with x, y, z, roll, pitch, yaw of each joint"
        raise BadValueError(f"{len(names)} joints are calibrated here, the arm has {nominal.n}", hint)
    try:
        origins = [[float(rows[name][key]) for key in _ORIGIN] for name in names]
    except (TypeError, ValueError):
        origins = [[math.nan]]
    if not all(math.isfinite(value) for origin in origins for value in origin):
        raise BadValueError("an origin of a joint is no number", "x, y, z in m and roll, pitch, yaw in rad")
    factors: list[Factor] = []
    for index, (x, y, z, *rpy) in enumerate(origins):
        factors += [*frame_factors("base", (x, y, z), tuple(rpy)), Factor("rotate", 2, joint=index)]
    return nearest_values(nominal.links, *axes_of(factors))
