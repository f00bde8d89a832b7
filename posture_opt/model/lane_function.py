"""``LaneFunction``: an SX function of one vector over many rows, several rows side by side in vector registers."""

from __future__ import annotations

import ctypes

import casadi
import numpy as np

from posture_opt.model.c_source import c_source
from posture_opt.model.compiled import BatchFunction, library_of
from posture_opt.numerics import Array

_C_NAME = "posture_opt_lanes"
_MAX_INSTRUCTIONS = 6000
"""A compiler takes some 5 s for as many, more than a million rows would win back."""


class LaneFunction:
    """``rows(Q)[k] = function(Q[k])``, (N, n) -> (N, m): the numbers of a `BatchFunction` to rounding, in less time.

    Sines and cosines are the text's own, within 2e-16 of the mathematics library's; threads may share it.

    Args:
        function: of one vector (n,), with one vector (m,), both dense.
        compiled: None compiles where a C compiler is found; False never; True or an error.

    Attributes:
        compiled: whether generated C is evaluated.

    Raises:
        InputError: ``compiled=True`` and nothing could be compiled.

    Example:
        >>> q = casadi.SX.sym("q", 2)
        >>> rows = LaneFunction(casadi.Function("f", [q], [casadi.sumsqr(q)]), compiled=False)
        >>> rows(np.array([[3.0, 4.0]])).tolist()
        [[25.0]]
    """

    def __init__(self, function: casadi.Function, *, compiled: bool | None = None) -> None:
        self._function, self._wanted = function, compiled
        self._entries = function.nnz_out(0)
        self._library = None
        if compiled is not False and function.n_instructions() <= _MAX_INSTRUCTIONS:
            text, _ = c_source(function, _C_NAME, rows=True)
            self._library, _ = library_of(compiled, lambda: text, lambda: text, "-O3")
        self._batch = None if self._library else BatchFunction(function, compiled=compiled)
        self.compiled: bool = self._batch is None or self._batch.compiled

    def __call__(self, Q: Array) -> Array:
        """(N, m) of finite rows (N, n)."""
        if self._library is None:
            assert self._batch is not None
            found: Array = self._batch(Q)
            return found
        given = np.ascontiguousarray(Q, dtype=float)
        result = np.empty((len(given), self._entries))
        addresses = [ctypes.c_void_p(array.__array_interface__["data"][0]) for array in (given, result)]
        self._library.handle.posture_opt_lanes_rows(ctypes.c_longlong(len(given)), *addresses)
        return result

    def __reduce__(self) -> tuple[object, ...]:
        return _restored_function, (self._function, self._wanted)


def _restored_function(function: casadi.Function, compiled: bool | None) -> LaneFunction:
    """What a pickle is read back by: the library is looked up, or compiled, again."""
    return LaneFunction(function, compiled=compiled)
