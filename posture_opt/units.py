"""Quantities with units in files and reports, SI and radians inside."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import BeforeValidator, PlainValidator, WithJsonSchema

from posture_opt.errors import BadValueError, as_given

if TYPE_CHECKING:
    from pint import UnitRegistry

DIMENSIONS: dict[str, tuple[str, str]] = {
    # dimension -> (SI unit, an example for messages)
    "length": ("m", "10 mm"),
    "angle": ("rad", "1 deg"),
    "mass": ("kg", "2.5 kg"),
    "temperature": ("K", "20 K"),
    "time": ("s", "10 s"),
    "velocity": ("m/s", "20 mm/s"),
    "angular velocity": ("rad/s", "120 deg/s"),
    "torque": ("N m", "50 N m"),
    "angle per torque": ("rad/(N m)", "8 urad/(N m)"),
    "angle mass per torque": ("rad kg/(N m)", "30 urad kg/(N m)"),
    "length per temperature": ("m/K", "12 um/K"),
    "angle per temperature": ("rad/K", "10 urad/K"),
    "per temperature": ("1/K", "12e-6 / K"),
    "per length": ("1/m", "2e-5 / m"),
    "length per length": ("m/m", "6 um/m"),
    "length per angle": ("m/rad", "0.8 mm/rad"),
    "pixel": ("px", "0.2 px"),
}

LARGEST: dict[str, float] = {
    # dimension -> SI value beyond which no arm and no workpiece is; covariances of what is larger would lose all
    # digits. 1e8 of the others.
    "length": 1e5,
    "angle": 1e5,
    "mass": 1e6,
    "temperature": 1e5,
    "time": 1e10,
}
# SI value up to which a number is zero: the rounding of programs that write −2.09e-37, far below any arm's errors.
NEGLIGIBLE = 1e-15

SHOWN: dict[str, tuple[float, str]] = {
    # dimension -> factor from SI and unit that reports use
    "angle": (1e3, "mrad"),
    "time": (1 / 60, "min"),
    "angle per torque": (1e6, "µrad/(N m)"),
    "angle mass per torque": (1e6, "µrad kg/(N m)"),
    "length per temperature": (1e6, "µm/K"),
    "angle per temperature": (1e6, "µrad/K"),
    "per temperature": (1e6, "µm/(m K)"),
    "per length": (1e6, "ppm/m"),
    "length per length": (1e6, "µm/m"),
    "length per angle": (1e3, "mm/rad"),
    "ratio": (1e3, "mrad per rad"),
    "share": (1e2, "%"),
    "factor": (1.0, ""),
}
# SI unit -> factor and unit that reports use for errors: deviations, their σ, what is left of them. Angles are in
# deg, errors of angles in mrad, which are mm at a lever of a metre.
ERROR_UNITS: dict[str, tuple[float, str]] = {
    **{si: SHOWN.get(name, (1.0, si)) for name, (si, _) in DIMENSIONS.items()},
    "m": (1e3, "mm"),
    "1": (1.0, ""),
}
UNKNOWN = "not known"  # What reports write in place of NaN and infinity
# Decimals of any number with a unit of reports: nanometres in mm, nanoradians in mrad. What is less is rounding.
_MAX_DECIMALS = 6

# Only what a robot file can need. The whole of pint's table takes 0.3 s to read, and it would accept
# 'min', 'a' (year) or 'd' (day) where a typing error is far more likely.
_DEFINITIONS = [
    "micro- = 1e-6 = µ- = μ- = u-",
    "milli- = 1e-3 = m-",
    "centi- = 1e-2 = c-",
    "kilo- = 1e3 = k-",
    "nano- = 1e-9 = n-",
    "meter = [length] = m = metre",
    "inch = 0.0254 * meter = in",
    "radian = [angle] = rad",
    "degree = 0.017453292519943295 * radian = deg = ° = º = Grad = Grd",  # the last two in German
    "arcminute = degree / 60 = arcmin",
    "arcsecond = degree / 3600 = arcsec",
    "turn = 6.283185307179586 * radian = rev",
    "gram = [mass] = g",
    "second = [time] = s",
    "minute = 60 * second = min",
    "hour = 3600 * second = h",
    "kelvin = [temperature] = K",
    "pixel = [pixel] = px",
    "newton = 1000 * gram * meter / second ** 2 = N",
]

_UNIT = re.compile(r"(?:1\s*(?=/))?(?:[A-Za-z°ºµμ]+(?:\s*(?:\*\*|\^)\s*-?\d(?!\d))?|[*/()]|\s)+")
_NUMBER = re.compile(r"^\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(.*?)\s*$")


# What nearly every file uses, so that the usual command does not wait 0.2 s for pint to load.
_COMMON_FACTORS: dict[tuple[str, str], float] = {
    ("m", "length"): 1.0,
    ("mm", "length"): 1e-3,
    ("um", "length"): 1e-6,
    ("rad", "angle"): 1.0,
    ("mrad", "angle"): 1e-3,
    ("deg", "angle"): math.pi / 180,
    ("kg", "mass"): 1.0,
    ("px", "pixel"): 1.0,
    ("mm/s", "velocity"): 1e-3,
    ("rad/s", "angular velocity"): 1.0,
    ("deg/s", "angular velocity"): math.pi / 180,
}


@cache
def registry() -> UnitRegistry[float]:
    """The units that files may use, as pint has them; made once, in 0.2 s."""
    from pint import UnitRegistry

    units: UnitRegistry[float] = UnitRegistry(None)
    for line in _DEFINITIONS:
        units.define(line)
    return units


@cache
def _unit_factor(unit: str, dimension: str) -> float:
    if (unit, dimension) in _COMMON_FACTORS:
        return _COMMON_FACTORS[unit, dimension]
    si, example = DIMENSIONS[dimension]
    if unit == si:
        return 1.0
    if any(unit == other for other, kind in _COMMON_FACTORS if {kind, dimension} == {"length", "angle"}):
        raise BadValueError(f"'{unit}' is not a unit of {dimension}", f"write for example {example}")
    if unit[:1] in (",", "."):
        raise BadValueError("a number has one decimal point and no other sign", f"write for example {example}")
    if len(unit) > 40 or not _UNIT.fullmatch(unit):  # pint would compute 9**9**9**9
        raise BadValueError(f"unknown unit '{unit[:40]}'", f"write for example {example}")
    units = registry()
    # "N m" is how people write a product of units; pint wants an operator between them.
    text = re.sub(r"(?<=[A-Za-z°ºµμ)\d])\s+(?=[A-Za-z°ºµμ(])", "*", unit)
    try:
        quantity: Any = units.Quantity(f"1 {text}" if text.startswith("/") else f"1 * {text}")
        return float(quantity.to(units.Unit(si)).magnitude)
    except Exception as error:  # pint raises a dozen kinds, among them plain tokenizer errors
        other = type(error).__name__ == "DimensionalityError"
        text = f"'{unit}' is not a unit of {dimension}" if other else f"unknown unit '{unit}'"
        raise BadValueError(text, f"write for example {example}") from None


def parse_quantity(value: object, dimension: str) -> float:
    """The SI value of a text such as ``"0.05 mm"``; a bare zero is zero in every unit, and so is what is `NEGLIGIBLE`.

    Example:
        >>> parse_quantity("0.05 mm", "length"), parse_quantity("180 deg", "angle")
        (5e-05, 3.141592653589793)
    """
    si, example = DIMENSIONS[dimension]
    if isinstance(value, bool) or not isinstance(value, str | int | float):
        wanted = f"{'an' if dimension.startswith('a') else 'a'} {dimension} with its unit"
        raise BadValueError(f"expected {wanted}, not {as_given(value)}", f"write for example {example}")
    if isinstance(value, int | float):
        if not math.isfinite(value):
            raise BadValueError(f"{value} is not a finite number", f"write for example {example}")
        if abs(value) <= NEGLIGIBLE:
            return 0.0
        units = dict.fromkeys((example.split(" ", 1)[1], si))
        hint = " or ".join(f"{value:g} {unit}" for unit in units)
        raise BadValueError(f"the {dimension} has no unit (here {value:g})", f"write {hint}")
    match = _NUMBER.match(value)
    if match is None:
        raise BadValueError(f"{as_given(value)} is not a finite number with a unit", f"write for example {example}")
    number, unit = match.groups()
    if not unit:
        return parse_quantity(float(number), dimension)
    result = float(number) * _unit_factor(unit, dimension)
    if not math.isfinite(result):
        raise BadValueError(f"{as_given(value)} is not a finite number", f"write for example {example}")
    if abs(result) > LARGEST.get(dimension, 1e8):
        raise ImplausibleError(f"{as_given(value)} is not plausible", "is the exponent right?")
    return result if abs(result) > NEGLIGIBLE else 0.0


class ImplausibleError(BadValueError):
    """A quantity that is written as it should be, and far too large to be meant."""


# Schema of a text with a unit; the bounds are those of a bare number, which can only be zero, rounding allowed.
_TEXT_OR_ZERO: dict[str, Any] = {"type": ["string", "number"], "minimum": -NEGLIGIBLE, "maximum": NEGLIGIBLE}


def _quantity_type(dimension: str) -> Any:
    def read(value: object) -> float:
        return parse_quantity(value, dimension)

    example = DIMENSIONS[dimension][1]
    schema = {
        **_TEXT_OR_ZERO,
        "description": f"{dimension} with its unit",
        "examples": [example],
        "dimension": dimension,  # our own word: messages write bounds in a unit of it
    }
    return Annotated[float, BeforeValidator(read), WithJsonSchema(schema)]


BY_NAME = "angle or length"  # The dimension of what the name of a joint or a parameter decides

# A parameter's name decides, so the text is read when the robot is known.
Quantity = Annotated[Any, WithJsonSchema({**_TEXT_OR_ZERO, "examples": ["1 deg", "10 mm"], "dimension": BY_NAME})]


# The type of the joint decides, so the text is read when the robot is known.
BY_JOINT_TYPE = "angular velocity or velocity"  # The dimension of what the type of a joint decides
JointVelocity = Annotated[
    Any, WithJsonSchema({**_TEXT_OR_ZERO, "examples": ["120 deg/s", "0.5 m/s"], "dimension": BY_JOINT_TYPE})
]


@dataclass(frozen=True)
class JointQuantity:
    """An angle [rad] or a length [m], whichever the text states; a bare zero has no ``dimension``.

    Args:
        value: [rad] or [m].
    """

    value: float
    dimension: str

    @property
    def unit(self) -> str:
        """SI unit of the value; empty for a bare zero."""
        return {"angle": "rad", "length": "m"}.get(self.dimension, "")

    def suits(self, dimension: str) -> bool:
        """Whether this can be the value of a joint that takes this dimension."""
        return self.dimension in (dimension, "")


def is_bare_zero(text: Any) -> bool:
    """Whether this is zero without a unit, rounding allowed, which is an angle or a length alike."""
    try:
        return not isinstance(text, bool) and abs(float(text)) <= NEGLIGIBLE
    except (TypeError, ValueError):
        return False


def _joint_quantity(text: object) -> JointQuantity:
    if isinstance(text, JointQuantity):
        return text
    if is_bare_zero(text):
        return JointQuantity(0.0, "")
    try:
        return JointQuantity(parse_quantity(text, "angle"), "angle")
    except ImplausibleError:
        raise
    except BadValueError as error:
        try:
            return JointQuantity(parse_quantity(text, "length"), "length")
        except ImplausibleError:
            raise
        except BadValueError:
            raise error from None


def joint_text(value: float, unit: str) -> str:
    """An angle [rad] or a length [m] in degrees or millimetres, to four digits.

    Args:
        value: [rad] or [m].

    Example:
        >>> joint_text(0.5, "rad"), joint_text(0.0521, "m")
        ('28.65 deg', '52.1 mm')
    """
    return f"{math.degrees(value):.4g} deg" if unit == "rad" else f"{value * 1e3:.4g} mm"


# The value of a joint: an angle of a revolute one, a length of a prismatic one.
JointValue = Annotated[
    JointQuantity,
    PlainValidator(_joint_quantity),
    WithJsonSchema(
        {
            **_TEXT_OR_ZERO,
            "description": "angle or length with its unit",
            "examples": ["30 deg", "80 mm"],
            "dimension": BY_NAME,
        }
    ),
]


def parse_share(value: object) -> float:
    """The number of a share such as ``"3 %"`` or 0.03.

    Example:
        >>> parse_share("3 %"), parse_share(0.03)
        (0.03, 0.03)
    """
    match = None if isinstance(value, bool) else _NUMBER.match(str(value))
    if match is None or match[2] not in ("", "%"):
        raise BadValueError(f"{as_given(value)} is no share", "write for example 3 %")
    return float(match[1]) / (100.0 if match[2] else 1.0)


def parse_celsius(value: object) -> float:
    """The temperature [degC] of a text such as ``"23.5 degC"``."""
    match = _NUMBER.match(value) if isinstance(value, str) else None
    if match is None or match[2] not in ("degC", "°C") or not abs(float(match[1])) <= LARGEST["temperature"]:
        raise BadValueError(f"{as_given(value)} is no temperature", "write for example 23.5 degC")
    return float(match[1])


def number(value: float, digits: int = 3, beside: float = 0.0) -> str:
    """``value`` with ``digits`` significant digits or more, six decimals at most, and no exponent: 0.0123, 1.23, 1234.

    A larger number ``beside`` it limits the decimals to two more than that one has; what is less is 0.

    Example:
        >>> number(0.012345), number(1234.5), number(3.33e-6, beside=0.069), number(1.28e-13)
        ('0.0123', '1234', '0.000003', '0')
    """
    if not math.isfinite(value):
        return UNKNOWN
    most = min(_significant_decimals(beside, digits) + 2, _MAX_DECIMALS) if beside else _MAX_DECIMALS
    text = f"{value:.{min(_significant_decimals(value, digits), most)}f}"
    return text if float(text) else "0"


def _significant_decimals(value: float, digits: int) -> int:
    if value == 0 or not math.isfinite(value):
        return 0
    rounded = float(f"{value:.{digits - 1}e}")  # 9.996 has one digit more before the point once it is rounded
    return max(0, digits - 1 - math.floor(math.log10(abs(rounded))))


def fixed(value: float, decimals: int = 2) -> str:
    """The number with so many decimals, and no negative zero.

    Example:
        >>> fixed(-0.001), fixed(2.0, 1)
        ('0.00', '2.0')
    """
    if not math.isfinite(value):
        return UNKNOWN
    text = f"{value:.{decimals}f}"
    return text.lstrip("-") if float(text) == 0 else text


def plus_minus(value: float, std: float, factor: float = 1.0, unit: str = "") -> str:
    """A number times ``factor`` with its standard error to two digits.

    Example:
        >>> plus_minus(2.61e-4, 1.2e-5, 1e3, "mrad")
        '0.261 ± 0.012 mrad'
    """
    value, std = value * factor, std * factor
    if not math.isfinite(std) or std <= 0:
        return f"{number(value)} {unit}".strip()
    decimals = min(max(0, 1 - math.floor(math.log10(std))), _MAX_DECIMALS)
    error = fixed(max(std, 10.0**-decimals), decimals)
    return f"{fixed(value, decimals)} ± {error} {unit}".strip()


def shown(value: float, dimension: str, std: float = math.nan) -> str:
    """A small quantity of a dimension in the unit that reports use.

    Args:
        value, std: [SI]; lengths below 10 µm are written in µm, others in mm; times below 1 s in ms, others in min.

    Example:
        >>> shown(8e-6, "angle per torque"), shown(2.61e-4, "angle", 1.2e-5)
        ('8.00 µrad/(N m)', '0.261 ± 0.012 mrad')
    """
    if dimension == "length":
        return plus_minus(value, std, *((1e6, "µm") if abs(value) < 1e-5 else (1e3, "mm")))
    if dimension == "time" and abs(value) < 1.0:
        return plus_minus(value, std, 1e3, "ms")
    return plus_minus(value, std, *SHOWN[dimension])


if TYPE_CHECKING:
    Celsius = float
    Share = float
    Length = float
    Angle = float
    Mass = float
    Time = float
    Velocity = float
    Torque = float
    Pixels = float
    LengthPerLength = float
else:
    Celsius = Annotated[
        float, BeforeValidator(parse_celsius), WithJsonSchema({"type": "string", "examples": ["23.5 degC"]})
    ]
    _share = {"type": ["string", "number"], "description": "share: 0.03, or 3 %", "examples": ["3 %"]}
    Share = Annotated[float, BeforeValidator(parse_share), WithJsonSchema(_share)]
    Length = _quantity_type("length")
    Angle = _quantity_type("angle")
    Mass = _quantity_type("mass")
    Time = _quantity_type("time")
    Velocity = _quantity_type("velocity")
    Torque = _quantity_type("torque")
    Pixels = _quantity_type("pixel")
    LengthPerLength = _quantity_type("length per length")
