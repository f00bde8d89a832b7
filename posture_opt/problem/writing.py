"""A problem as the text of its files: quantities with units, sections as plain data, covariances as CSV."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from posture_opt.problem.yaml_source import dump_yaml
from posture_opt.robot.robot import Factor, Robot
from posture_opt.uncertainty.covariance_file import covariance_text
from posture_opt.uncertainty.sources import Sources
from posture_opt.units import DIMENSIONS

_POSE = ("x", "y", "z", "roll", "pitch", "yaw")


def quantity(value: float, factor: Factor) -> str:
    """A value of a parameter as files have it, to 1e-11 m or rad: 12.3456789 mm, 0.0123456789 deg."""
    number = f"{math.degrees(value):.10f}" if factor.kind == "rotate" else f"{value * 1e3:.8f}"
    number = number.rstrip("0").rstrip(".")
    return f"{'0' if number == '-0' else number} {'deg' if factor.kind == 'rotate' else 'mm'}"


def rounded(sigma: float, factor: Factor) -> tuple[float, str]:
    """A standard deviation to four digits [rad or m], and as files have it: 0.005012 deg."""
    turns = factor.kind == "rotate"
    number = float(f"{math.degrees(sigma) if turns else sigma * 1e3:.4g}")
    text = f"{number:.12f}".rstrip("0").rstrip(".")
    return (math.radians(number), f"{text} deg") if turns else (number * 1e-3, f"{text} mm")


def frame_texts(parameters: Mapping[str, Factor], frame: str) -> dict[str, list[str]]:
    """A frame, ``base`` or ``tool``, as numbers."""
    factors = [parameters[f"{frame}.{part}"] for part in _POSE]
    texts = [quantity(factor.nominal, factor) for factor in factors]
    return {"xyz": texts[:3], "rpy": texts[3:]}


def sources_text(robot: Robot, effects: Sequence[Any], sources: Sources) -> str:
    """The CSV of the covariance of sources: lengths in mm, angles in mrad, parameters of effects in SI units."""
    units = {name: "mrad" if factor.kind == "rotate" else "mm" for name, factor in robot.parameters.items()}
    for effect in effects:
        for name, (_, dimension) in zip(effect.parameter_names, effect.dimensions, strict=True):
            units[name] = "1" if dimension == "ratio" else DIMENSIONS[dimension][0]
    return covariance_text(sources.names, sources.covariance, [units[name] for name in sources.names])


def commented(header: Sequence[str], document: Mapping[str, Any]) -> str:
    """The YAML text of a document, with lines of comment before it."""
    return "".join(f"# {line}\n" for line in header) + dump_yaml(dict(document))
