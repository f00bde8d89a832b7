"""CasADi functions as fast batch functions: generated C where a compiler is found, else CasADi's interpreter."""

from __future__ import annotations

import ctypes
import functools
import threading
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from typing import Any

import casadi
import numpy as np
import numpy.typing as npt

from posture_opt.errors import InputError, Issue, SolverError
from posture_opt.files import packaged
from posture_opt.model.c_source import c_source, c_text, row_function
from posture_opt.model.toolchain import BuildError, Library, shared_library

__all__ = ["BatchFunction", "c_source", "library_of"]

Array = npt.NDArray[np.float64]  # Real numbers, as of numerics; also from lists and other types that NumPy converts

_ROW_NAME = "posture_opt_row"
# Rows that are interpreted in one call, as many as there are: the first bounds the memory, a single row takes a call
# from Python of thrice its own time
_WIDTHS = (256, 16, 1)
# C text of a loop over rows; returns 0, −1 where memory is short, or the number from 1 of the row that failed
_BATCH_LOOP_C = packaged("posture_opt.model", "batch_loop.c")


class BatchFunction:
    """A CasADi function evaluated over rows: ``batch(*arrays)[k] = function(*(array[k] for array in arrays))``.
    Compiled rows run without Python's lock, and threads may share both ways of calling. Both give the same digits,
    pickle, and let NaN and infinity through. function: inputs and outputs of any sparsity; both are dense outside;
    compiled: None compiles where a C compiler is found; False never; True or an error."""

    def __init__(self, function: casadi.Function, *, compiled: bool | None = None) -> None:
        self.function = function
        self._wanted = compiled
        self._fallible = not function.is_a("SXFunction")  # asking for the return code costs a microsecond
        self._row = row_function(function, _ROW_NAME)
        self._names = [function.name_in(i) for i in range(function.n_in())]
        self._sizes = [function.numel_in(i) for i in range(function.n_in())]
        self._shapes = [(r,) if c == 1 else (r, c) for r, c in map(function.size_out, range(function.n_out()))]
        library, reason = library_of(compiled, self._row.serialize, lambda: c_text([self._row]) + _BATCH_LOOP_C)
        self.reason: str = reason
        self.compiled: bool = library is not None
        if library:
            self._row = casadi.external(_ROW_NAME, str(library.path))
        self._kept = threading.local()
        self._fill = functools.partial(_fill_compiled, library) if library else self._fill_interpreted

    def __call__(self, *arrays: npt.ArrayLike) -> Any:
        """(N, r) or (N, r, c), a tuple for several outputs, of inputs (N, size), or (size,) in every row; matrices
        column-major."""
        rows, inputs = self._read_inputs(arrays)
        outputs = [np.empty((rows, *shape)) for shape in self._shapes]
        if rows:
            self._fill(rows, inputs, outputs)
        return outputs[0] if len(outputs) == 1 else tuple(outputs)

    def one(self, *arrays: npt.ArrayLike) -> Any:
        """Evaluate once with buffers of this thread, inputs (size,), outputs (r,) or (r, c): saves tens of
        microseconds."""
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
        try:
            kept: tuple[_Buffered, list[Array]] = self._kept.single
        except AttributeError:
            buffered = _Buffered(self._row, self._fallible)
            views = [slot.reshape(shape) for slot, shape in zip(buffered.outputs, self._shapes, strict=True)]
            kept = self._kept.single = buffered, views
        return kept

    def _read_inputs(self, arrays: tuple[npt.ArrayLike, ...]) -> tuple[int, list[Array]]:
        """The number of rows N and the inputs (N, size) or (1, size)."""
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
        maps: dict[int, _Buffered] = self._kept.__dict__.setdefault("maps", {})
        if width not in maps:
            maps[width] = _Buffered(self._row.map(width) if width > 1 else self._row)
        return maps[width]


class _Buffered:
    """One dense CasADi function bound to memory of its own; asking a ``fallible`` one costs a microsecond."""

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
        """Evaluate on the arrays ``inputs``, into the arrays ``outputs``."""
        self._trigger()
        if self._fallible and self._buffer.ret():
            raise SolverError("the function reports a failure")


def _contiguous_rows(array: npt.ArrayLike) -> Array:
    if type(array) is np.ndarray and array.ndim == 2 and array.dtype == np.float64 and array.flags.c_contiguous:
        return array
    return np.ascontiguousarray(np.atleast_2d(np.asarray(array, dtype=float)))


def _assign_slots(slots: list[Array], arrays: Sequence[Any]) -> None:
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
    return (ctypes.c_void_p * len(arrays))(*[array.__array_interface__["data"][0] for array in arrays])


def _integer_array(values: list[int]) -> ctypes.Array[ctypes.c_longlong]:
    return (ctypes.c_longlong * len(values))(*values)


def library_of(
    wanted: bool | None, identity: Callable[[], str], source: Callable[[], str], level: str = "-O1"
) -> tuple[Library | None, str]:
    """The compiled ``source``, cached by its ``identity``, and an empty text; or None and the reason."""
    if wanted is False:
        return None, "interpreted on request"
    try:
        # CasADi's version stands for its code generator, the batch loop's text for ours.
        return shared_library(f"{casadi.CasadiMeta.version()}{_BATCH_LOOP_C}{identity()}", source, level), ""
    except (BuildError, RuntimeError) as error:  # RuntimeError: CasADi has no C for a part of the function
        if wanted:
            raise InputError(Issue(f"nothing compiled: {error}", hint="install a C compiler or set CC")) from error
        return None, str(error)


class LaneFunction:
    """``rows(Q)[k] = function(Q[k])``, (N, n) -> (N, m): the numbers of a `BatchFunction` to rounding, in less time.

    Several rows are side by side in vector registers. Sines and cosines are the text's own, within 2e-16 of the
    mathematics library's; threads may share it. ``compiled`` as of `BatchFunction`.
    """

    def __init__(self, function: casadi.Function, *, compiled: bool | None = None) -> None:
        self._function, self._wanted, self._library = function, compiled, None
        # A compiler takes some 5 s for 6000 instructions, more than a million rows would win back.
        if compiled is not False and function.n_instructions() <= 6000:
            text, _ = c_source(function, "posture_opt_lanes", rows=True)
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
        result = np.empty((len(given), self._function.nnz_out(0)))
        self._library.handle.posture_opt_lanes_rows(ctypes.c_longlong(len(given)), *map(_address, (given, result)))
        return result

    def __reduce__(self) -> tuple[Any, ...]:
        return functools.partial(LaneFunction, compiled=self._wanted), (self._function,)


def _address(array: Array) -> ctypes.c_void_p:
    return ctypes.c_void_p(array.__array_interface__["data"][0])


# C text that opens and closes the working memory of a generated function
_MEMORY_C = packaged("posture_opt.model", "memory.c")


class RowLoop:
    """``long long posture_opt_loop(…)`` of a C text that may call the functions given, by their names. The text has
    ``po_memory`` with ``po_open(&memory, NAME_work)`` and ``po_close``; a function is called by ``NAME(memory.arg,
    memory.res, memory.iw, memory.w, 0)``. Loops run without Python's lock. functions: by name; all inputs and outputs
    are dense; text: C99; compiled: None compiles where a C compiler is found; False never; True or an error."""

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
        """Run the loop: C-contiguous arrays of doubles are passed by address and written to, numbers by value. Returns
        what the loop returns, zero or more."""
        assert self._library is not None
        returned = int(self._library.handle.posture_opt_loop(*map(_c_argument, arguments)))
        if returned < 0:
            raise MemoryError
        return returned


def _c_argument(argument: Array | int | float) -> Any:
    if isinstance(argument, np.ndarray):
        assert argument.dtype == np.float64
        assert argument.flags.c_contiguous
        return _address(argument)
    return ctypes.c_longlong(argument) if isinstance(argument, int) else ctypes.c_double(argument)
