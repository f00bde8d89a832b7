"""Values that files and options should not have, and some that they should."""

from __future__ import annotations

import random
from typing import Any

NUMBERS: tuple[Any, ...] = (
    0, -0.0, 1, -1, 2, 3, 7, 0.5, 1e-3, 1e-9, 1e-30, 5e-324, 1e-308, 1e-200, 1e3, 1e6, 1e9, 1e15, 1e30, 1e100, 1e155,
    1e200, 1e308, -1e308, 2**31, 2**63, -(2**63), 10**40, 10**310, 3.141592653589793, 180, 360, 1e-17, float("nan"),
    float("inf"), float("-inf"), True, False,
)  # fmt: skip
WORDS: tuple[str, ...] = (
    "", " ", "x", "nan", "inf", "null", "none", "all", "free", "yes", "on", "~", "1", "0", "-0", "joint1", "joint2",
    "joint1.theta", "joint2.a", "joint9.theta", "base.x", "tool.yaw", "base", "tool", "world", "payload", "kind",
    "é", "σ", "µ", "\u200b", "\ufeff", "ß" * 40, "日本語", "🤖", "a" * 300, "x" * 5000, "$a_$", "$\\frac{", "%s", "%n",
    "{0}", "{name}", "<b>", "<script>", "&amp;", "a\nb", "a\tb", "a\rb", "\x1b[31m", "\x07", "..", "../..", "/",
    "//", ".", "~root", "~nobody-of-that-name/x", "C:\\x", "a/b", "=", "-", "--", "-x", "__class__", "__init__",
    "self", "1 mm", "0.02 deg", "5 N", "1e5000 mm", "1 mm^2", "9**9**9**9 mm", "1 m/m", "1 mm mm", "1_000 mm",
    "1,5 mm", "1.5.2 mm", "0x10 mm", "+1 mm", "- 1 mm", "1mm", "1 MM", "1 Mm", "٣ mm", "１ mm", "½ mm", "1 deg2",
    "1 m**-9", "1 (((((m)))))", "1 m/", "1 * m", "1 /m", "nan mm", "inf deg", "-inf mm", "1e400 deg", "1e308 m",
    "-1e308 deg", "1e155 m", "1e-320 mm", "0 mm", "0 deg", "-1 mm", "1e10 rad", "400 deg", "1e3 kg", "-5 kg",
    "1 degC", "-300 degC",
)  # fmt: skip
UNITS = {
    "length": ("m", "mm", "um", "cm", "in"),
    "angle": ("deg", "rad", "mrad", "arcsec", "urad"),
    "mass": ("kg", "g"),
    "time": ("s", "min", "h"),
}
_SIZES = {"length": 0.4, "angle": 0.5, "mass": 2.0, "time": 60.0}
_IN_SI = {"m": 1, "mm": 1e-3, "um": 1e-6, "cm": 1e-2, "in": 0.0254, "deg": 0.0174533, "rad": 1, "mrad": 1e-3,
          "arcsec": 4.848e-6, "urad": 1e-6, "kg": 1, "g": 1e-3, "s": 1, "min": 60, "h": 3600}  # fmt: skip


def odd(rng: random.Random) -> Any:
    """Anything that YAML can hold, rarely what is asked for."""
    choice = rng.random()
    if choice < 0.4:
        return rng.choice(NUMBERS)
    if choice < 0.85:
        return rng.choice(WORDS)
    if choice < 0.9:
        return None
    if choice < 0.95:
        return [odd(rng) for _ in range(rng.randrange(5))]
    return {word(rng): odd(rng) for _ in range(rng.randrange(4))}


def word(rng: random.Random) -> str:
    """A text, odd or made of few letters."""
    return rng.choice(WORDS) if rng.random() < 0.5 else "".join(rng.choices("abcxyz_.- 019\"'", k=rng.randrange(1, 9)))


def size(rng: random.Random, dimension: str) -> str:
    """A quantity as people write it: of a plausible size, or far from it."""
    unit = rng.choice(UNITS.get(dimension, ("deg", "mm")))
    scale = _SIZES.get(dimension, 1e-3) * 10 ** rng.choice((0, 0, 0, 0, -1, -2, -3, -5, -8, 1, 2))
    value = rng.uniform(-1, 1) * scale / _IN_SI[unit]
    return f"{value if rng.random() < 0.5 else abs(value):.4g} {unit}"


def number_text(rng: random.Random) -> str:
    """A number as text, odd at times."""
    if rng.random() < 0.5:
        return f"{rng.gauss(0, 1) * 10 ** rng.randrange(-3, 4):.{rng.randrange(7)}f}"
    return str(rng.choice(NUMBERS))
