"""``RowLoop``: a loop in C around generated functions, so that an iteration of many rows is one call from Python."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping
from functools import cache
from typing import Any

import casadi
import numpy as np

from posture_opt.model.c_source import c_text, row_function
from posture_opt.model.compiled import library_of
from posture_opt.numerics import Array

_MEMORY_C = """
#include <math.h>
#include <stdlib.h>

typedef struct { const double** arg; double** res; casadi_int* iw; double* w; } po_memory;
typedef int (*po_sizes)(casadi_int*, casadi_int*, casadi_int*, casadi_int*);

static void po_close(po_memory* m) { free((void*)m->arg); free(m->res); free(m->iw); free(m->w); }
static int po_open(po_memory* m, po_sizes work) {
  casadi_int arg, res, iw, w;
  work(&arg, &res, &iw, &w);
  m->arg = malloc((arg + 1) * sizeof *m->arg);
  m->res = malloc((res + 1) * sizeof *m->res);
  m->iw = malloc((iw + 1) * sizeof *m->iw);
  m->w = malloc((w + 1) * sizeof *m->w);
  return m->arg && m->res && m->iw && m->w;
}
"""
"""C text that opens and closes the working memory of a generated function."""


class RowLoop:
    """``long long posture_opt_loop(…)`` of a C text that may call the functions given, by their names.

    The text has ``po_memory`` with ``po_open(&memory, NAME_work)`` and ``po_close``; a function is called by
    ``NAME(memory.arg, memory.res, memory.iw, memory.w, 0)``. Loops run without Python's lock.

    Args:
        functions: by name; all inputs and outputs are dense.
        text: C99.
        compiled: None compiles where a C compiler is found; False never; True or an error.

    Attributes:
        compiled: whether there is anything to call; where not, the caller has a loop of its own.

    Raises:
        InputError: ``compiled=True`` and nothing could be compiled.
    """

    def __init__(self, functions: Mapping[str, casadi.Function], text: str, compiled: bool | None) -> None:
        whole = _MEMORY_C + text

        @cache
        def rows() -> list[casadi.Function]:  # written out where they are compiled: large ones take half a second
            return [row_function(function, name) for name, function in functions.items()]

        self._library, _ = library_of(
            compiled, lambda: whole + "".join(row.serialize() for row in rows()), lambda: c_text(rows()) + whole
        )
        self.compiled: bool = self._library is not None

    def __call__(self, *arguments: Array | int | float) -> int:
        """Run the loop: C-contiguous arrays of doubles are passed by address and written to, numbers by value.

        Returns:
            What the loop returns, zero or more.

        Raises:
            MemoryError: the loop returned a negative number.
        """
        assert self._library is not None
        returned = int(self._library.handle.posture_opt_loop(*map(_c_argument, arguments)))
        if returned < 0:
            raise MemoryError
        return returned


def _c_argument(argument: Array | int | float) -> Any:
    """The address of an array, or a number, as C takes it."""
    if isinstance(argument, np.ndarray):
        assert argument.dtype == np.float64
        assert argument.flags.c_contiguous
        return ctypes.c_void_p(argument.__array_interface__["data"][0])
    return ctypes.c_longlong(argument) if isinstance(argument, int) else ctypes.c_double(argument)
