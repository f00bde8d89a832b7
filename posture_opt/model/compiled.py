"""CasADi functions as fast batch functions: generated C where a compiler is found, else CasADi's interpreter."""

from __future__ import annotations

import ctypes
import functools
import threading
from collections.abc import Callable, Sequence
from typing import Any

import casadi
import numpy as np
import numpy.typing as npt

from posture_opt.errors import InputError, Issue, SolverError
from posture_opt.model.c_source import c_source, c_text, row_function
from posture_opt.model.toolchain import BuildError, Library, shared_library

__all__ = ["BatchFunction", "c_source", "library_of"]

Array = npt.NDArray[np.float64]
"""Real numbers, as of ``numerics``; also from lists and other types that NumPy converts."""

_ROW_NAME = "posture_opt_row"
_WIDTHS = (256, 16, 1)
"""Rows that are interpreted in one call, as many as there are: the first bounds the memory, a single row takes a call
from Python of thrice its own time.
"""
_BATCH_LOOP_C = """
#include <stdlib.h>

CASADI_SYMBOL_EXPORT long long posture_opt_batch(long long rows, const double* const* inputs,
    const long long* steps, double* const* outputs, const long long* sizes) {
  casadi_int sz_arg, sz_res, sz_iw, sz_w, i;
  long long row, failed = 0;
  const double** arg; double** res; casadi_int* iw; double* w;
  posture_opt_row_work(&sz_arg, &sz_res, &sz_iw, &sz_w);
  arg = malloc((sz_arg + 1) * sizeof *arg);
  res = malloc((sz_res + 1) * sizeof *res);
  iw = malloc((sz_iw + 1) * sizeof *iw);
  w = malloc((sz_w + 1) * sizeof *w);
  if (!arg || !res || !iw || !w) failed = -1;
  for (row = 0; row < rows && !failed; ++row) {
    for (i = 0; i < posture_opt_row_n_in(); ++i) arg[i] = inputs[i] + row * steps[i];
    for (i = 0; i < posture_opt_row_n_out(); ++i) res[i] = outputs[i] + row * sizes[i];
    if (posture_opt_row(arg, res, iw, w, 0)) failed = row + 1;
  }
  free(arg); free(res); free(iw); free(w);
  return failed;
}
"""
"""C text of a loop over rows; returns 0, −1 where memory is short, or the number from 1 of the row that failed."""


class BatchFunction:
    """A CasADi function evaluated over rows: ``batch(*arrays)[k] = function(*(array[k] for array in arrays))``.

    Compiled rows run without Python's lock, and threads may share both ways of calling. Both give the same digits,
    pickle, and let NaN and infinity through.

    Args:
        function: inputs and outputs of any sparsity; both are dense outside.
        compiled: None compiles where a C compiler is found; False never; True or an error.

    Attributes:
        compiled: whether generated C is evaluated.
        reason: why it is not; empty where it is.

    Raises:
        InputError: ``compiled=True`` and nothing could be compiled.

    Example:
        >>> x = casadi.SX.sym("x", 2)
        >>> BatchFunction(casadi.Function("f", [x], [casadi.sumsqr(x)]), compiled=False)([[3, 4], [6, 8]]).tolist()
        [[25.0], [100.0]]
    """

    def __init__(self, function: casadi.Function, *, compiled: bool | None = None) -> None:
        self.function = function
        self._wanted = compiled
        self._fallible = not function.is_a("SXFunction")  # asking for the return code costs a microsecond
        self._row = row_function(function, _ROW_NAME)
        self._names = [function.name_in(i) for i in range(function.n_in())]
        self._sizes = [function.numel_in(i) for i in range(function.n_in())]
        self._shapes = [_output_shape(function, i) for i in range(function.n_out())]
        library, reason = library_of(compiled, self._row.serialize, lambda: c_text([self._row]) + _BATCH_LOOP_C)
        self.reason: str = reason
        self.compiled: bool = library is not None
        if library:
            self._row = casadi.external(_ROW_NAME, str(library.path))
        self._kept = threading.local()
        self._fill = functools.partial(_fill_compiled, library) if library else self._fill_interpreted

    def __call__(self, *arrays: npt.ArrayLike) -> Any:
        """Evaluate all rows.

        Args:
            arrays: one an input, (N, size), or (size,) or (1, size) for the same in every row; matrices
                column-major.

        Returns:
            (N, r) of a vector output, (N, r, c) of a matrix; a tuple of them for several outputs.

        Raises:
            InputError: an input of another shape.
            SolverError: the function itself reports a failure.
        """
        rows, inputs = self._read_inputs(arrays)
        outputs = [np.empty((rows, *shape)) for shape in self._shapes]
        if rows:
            self._fill(rows, inputs, outputs)
        return outputs[0] if len(outputs) == 1 else tuple(outputs)

    def one(self, *arrays: npt.ArrayLike) -> Any:
        """Evaluate once with buffers that each thread keeps: each input (size,), outputs (r,) or (r, c).

        It saves the tens of microseconds that a call of the CasADi function costs.

        Raises:
            InputError: an input of another shape.
            SolverError: the function itself reports a failure.
        """
        buffered, views = self._thread_buffer
        try:
            _assign_slots(buffered.inputs, arrays)
        except (TypeError, ValueError):  # not (size,): accept one row, else name what is wrong
            rows, inputs = self._read_inputs(arrays)
            if rows != 1:
                raise InputError(f"{rows} rows given, one wanted") from None
            _assign_slots(buffered.inputs, [array[0] for array in inputs])
        buffered.evaluate()
        outputs = [view.copy() for view in views]
        return outputs[0] if len(outputs) == 1 else tuple(outputs)

    def __reduce__(self) -> tuple[Any, ...]:
        return functools.partial(BatchFunction, compiled=self._wanted), (self.function,)

    @property
    def _thread_buffer(self) -> tuple[_Buffered, list[Array]]:
        """The buffer of this thread and views of its outputs: two threads must not write to one."""
        try:
            kept: tuple[_Buffered, list[Array]] = self._kept.single
        except AttributeError:
            buffered = _Buffered(self._row, self._fallible)
            views = [slot.reshape(shape) for slot, shape in zip(buffered.outputs, self._shapes, strict=True)]
            kept = self._kept.single = buffered, views
        return kept

    def _read_inputs(self, arrays: tuple[npt.ArrayLike, ...]) -> tuple[int, list[Array]]:
        """The number of rows N and the inputs (N, size) or (1, size).

        Raises:
            InputError: another number of arrays, or arrays of other shapes.
        """
        if len(arrays) != len(self._names):
            raise InputError(f"{len(arrays)} arrays given, {len(self._names)} wanted: {', '.join(self._names)}")
        inputs = [_contiguous_rows(array) for array in arrays]
        rows = next((len(array) for array in inputs if len(array) != 1), 1)
        issues = [
            Issue(f"input {name} has shape {np.shape(given)}", hint=f"give ({size},) or ({rows}, {size})")
            for name, size, array, given in zip(self._names, self._sizes, inputs, arrays, strict=True)
            if array.ndim != 2 or array.shape[1] != size or len(array) not in (1, rows)
        ]
        if issues:
            raise InputError(issues)
        return rows, inputs

    def _fill_interpreted(self, rows: int, inputs: list[Array], outputs: list[Array]) -> None:
        """Evaluate by CasADi's interpreter, rows at a time as `_WIDTHS` has them; outputs (N, …) are written to."""
        spread, begin = [np.broadcast_to(array, (rows, array.shape[1])) for array in inputs], 0
        for width in _WIDTHS:
            end = rows - (rows - begin) % width
            if end > begin:
                _fill_buffered(self._thread_map(width), range(begin, end, width), width, spread, outputs)
            begin = end

    def _thread_map(self, width: int) -> _Buffered:
        """The function of so many rows, with buffers that each thread keeps: a map and its buffers cost more than 16
        rows.
        """
        maps: dict[int, _Buffered] = self._kept.__dict__.setdefault("maps", {})
        if width not in maps:
            maps[width] = _Buffered(self._row.map(width) if width > 1 else self._row)
        return maps[width]


class _Buffered:
    """One CasADi function bound to memory of its own.

    Args:
        function: dense.
        fallible: whether its return code is asked for, which costs a microsecond.
    """

    def __init__(self, function: casadi.Function, fallible: bool = True) -> None:
        self._buffer: Any
        self._fallible = fallible
        self.inputs = [np.zeros(function.nnz_in(i)) for i in range(function.n_in())]
        self.outputs = [np.zeros(function.nnz_out(i)) for i in range(function.n_out())]
        self._buffer, self._trigger = function.buffer()
        for i, array in enumerate(self.inputs):
            self._buffer.set_arg(i, array.data)
        for i, array in enumerate(self.outputs):
            self._buffer.set_res(i, array.data)

    def evaluate(self) -> None:
        """Evaluate on the arrays ``inputs``, into the arrays ``outputs``.

        Raises:
            SolverError: the function reports a failure.
        """
        self._trigger()
        if self._fallible and self._buffer.ret():
            raise SolverError("the function reports a failure")


def _contiguous_rows(array: npt.ArrayLike) -> Array:
    """The array as contiguous rows of doubles; one that is so already passes as it is."""
    if type(array) is np.ndarray and array.ndim == 2 and array.dtype == np.float64 and array.flags.c_contiguous:
        return array
    return np.ascontiguousarray(np.atleast_2d(np.asarray(array, dtype=float)))


def _assign_slots(slots: list[Array], arrays: Sequence[Any]) -> None:
    """Copy arrays into buffers of the same length.

    Raises:
        ValueError: another length, or nothing that converts.
    """
    for slot, array in zip(slots, arrays, strict=True):
        if len(array) != len(slot):  # NumPy would broadcast a single number
            raise ValueError
        slot[:] = array


def _fill_buffered(buffered: _Buffered, starts: range, width: int, inputs: list[Array], outputs: list[Array]) -> None:
    """Evaluate blocks of ``width`` rows that begin at ``starts``."""
    given = [(slot.reshape(width, array.shape[1]), array) for slot, array in zip(buffered.inputs, inputs, strict=True)]
    taken = [
        (slot.reshape(width, *array.shape[1:]), array) for slot, array in zip(buffered.outputs, outputs, strict=True)
    ]
    for start in starts:
        rows = slice(start, start + width)
        for slot, array in given:
            slot[:] = array[rows]
        buffered.evaluate()
        for slot, array in taken:
            array[rows] = slot


def _fill_compiled(library: Library, rows: int, inputs: list[Array], outputs: list[Array]) -> None:
    """Evaluate all rows by the loop in C; an input of one row has step 0 and is the same in every row.

    Raises:
        MemoryError: the loop got no memory.
        SolverError: the function reports a failure, with its row.
    """
    steps = [array.shape[1] if len(array) == rows else 0 for array in inputs]
    sizes = [array.size // rows for array in outputs]
    failed = library.handle.posture_opt_batch(
        ctypes.c_longlong(rows),
        _pointer_array(inputs),
        _integer_array(steps),
        _pointer_array(outputs),
        _integer_array(sizes),
    )
    if failed:
        raise MemoryError if failed < 0 else SolverError(f"the function reports a failure in row {failed - 1}")


def _pointer_array(arrays: list[Array]) -> ctypes.Array[ctypes.c_void_p]:
    """Addresses of the data of contiguous arrays, as C takes them."""
    return (ctypes.c_void_p * len(arrays))(*[array.__array_interface__["data"][0] for array in arrays])


def _integer_array(values: list[int]) -> ctypes.Array[ctypes.c_longlong]:
    """Whole numbers of 64 bits, as C takes them."""
    return (ctypes.c_longlong * len(values))(*values)


def library_of(
    wanted: bool | None, identity: Callable[[], str], source: Callable[[], str], level: str = "-O1"
) -> tuple[Library | None, str]:
    """The compiled ``source``, found by its ``identity`` where it was compiled before.

    Args:
        wanted: None compiles where it can; False never; True or an error.
        identity: what determines the source; cheaper to have than the source itself.
        source: gives the C text.
        level: of the compiler's optimisation.

    Returns:
        The library and an empty text; or None and why there is none.

    Raises:
        InputError: ``wanted`` is True and nothing could be compiled.
    """
    if wanted is False:
        return None, "interpreted on request"
    try:
        # CasADi's version stands for its code generator, the batch loop's text for ours.
        return shared_library(f"{casadi.CasadiMeta.version()}{_BATCH_LOOP_C}{identity()}", source, level), ""
    except (BuildError, RuntimeError) as error:  # RuntimeError: CasADi has no C for a part of the function
        if wanted:
            raise InputError(Issue(f"nothing compiled: {error}", hint="install a C compiler or set CC")) from error
        return None, str(error)


def _output_shape(function: casadi.Function, i: int) -> tuple[int, ...]:
    """(r,) of a vector output, (r, c) of a matrix."""
    rows, columns = function.size_out(i)
    return (rows,) if columns == 1 else (rows, columns)
