"""Elementary functions of a scalar of the forward model: a float, an array (N,) or a CasADi expression."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from posture_opt.model.chain import Scalar


def _symbolic(x: Scalar) -> bool:
    return isinstance(x, ca.SX | ca.MX)


def sin(x: Scalar) -> Any:
    """Sine."""
    return ca.sin(x) if _symbolic(x) else np.sin(x)


def cos(x: Scalar) -> Any:
    """Cosine."""
    return ca.cos(x) if _symbolic(x) else np.cos(x)


def exp(x: Scalar) -> Any:
    """Exponential function."""
    return ca.exp(x) if _symbolic(x) else np.exp(x)


def magnitude(x: Scalar) -> Any:
    """``|x|``."""
    return ca.fabs(x) if _symbolic(x) else np.abs(x)


def nearest_integer(x: Scalar) -> Any:
    """``x`` rounded."""
    return ca.floor(x + 0.5) if _symbolic(x) else np.floor(np.asarray(x) + 0.5)


def at_least(x: Scalar, bound: float) -> Any:
    """1 where ``x >= bound``, else 0."""
    return ca.SX(x >= bound) if _symbolic(x) else np.asarray(np.asarray(x) >= bound, dtype=float)
