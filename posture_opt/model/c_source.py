"""CasADi functions as C text, for this package's own compiler and for export."""

from __future__ import annotations

import math
import string
from collections.abc import Mapping
from typing import Any

import casadi

from posture_opt.errors import InputError, Issue
from posture_opt.model.c_rows import CFunction, one_text, preamble_text, rows_text
from posture_opt.model.steps import Steps
from posture_opt.texts import one_line


def c_source(
    function: casadi.Function,
    name: str,
    descriptions: Mapping[str, str] | None = None,
    *,
    rows: bool = False,
    shared: bool = False,
) -> tuple[str, str]:
    """Self-contained C99 text of an SX function and its header: ``int name(const double* in, …, double* out, …)``.

    Args:
        function: SX, of any sparsity.
        name: of the C function; a C identifier.
        descriptions: unit and meaning of the inputs and outputs by name, for the header.
        rows: whether there is also ``int name_rows(long long rows, …)``, for many inputs at once.
        shared: whether outputs use what the ones before them have computed; else each is computed alone.

    Returns:
        The C text (needs the mathematics library alone) and the header text. Matrices: inputs column-major, outputs
        row-major.

    Raises:
        InputError: a name is no C identifier, or one that C keeps for itself.

    Example:
        >>> x = casadi.SX.sym("x")
        >>> text, header = c_source(casadi.Function("f", [x], [x * x], ["x"], ["y"]), "square")
        >>> "int square(const double* x, double* y);" in header
        True
    """
    _check_names(function, name)
    steps = Steps.of(row_function(function, _CASADI_NAME))
    inputs = [(function.name_in(i), function.size_in(i)) for i in range(function.n_in())]
    outputs = [(function.name_out(i), function.size_out(i)) for i in range(function.n_out())]
    shape = CFunction(name, tuple(_argument_sizes(inputs)), tuple(_argument_sizes(outputs)))
    parts = [
        _FILE_COMMENT,
        preamble_text(steps),
        one_text(steps, shape, shared),
        *([rows_text(steps, shape)] if rows else []),
    ]
    fields = {
        "guard": f"{name.upper()}_H",
        "prototypes": "".join(f"{prototype};\n" for prototype in (shape.prototype, shape.rows_prototype)[: 1 + rows]),
        "input_order": _memory_order(inputs, "column-major"),
        "output_order": f"{_memory_order(outputs, 'row-major')}; NULL where not wanted",
        "inputs": _c_comment(inputs, descriptions or {}),
        "outputs": _c_comment(outputs, descriptions or {}),
        "rows": _ROWS_COMMENT.format(name=name) if rows else "",
    }
    return "\n".join(parts), _HEADER_TEMPLATE.substitute(fields)


def _argument_sizes(arguments: list[tuple[str, tuple[int, int]]]) -> list[tuple[str, int]]:
    """Name and number of entries of each argument."""
    return [(key, rows * columns) for key, (rows, columns) in arguments]


_CASADI_NAME = "f"
"""Name that CasADi accepts; it refuses names that C takes: of a leading or a double underscore, and some words."""
_FILE_COMMENT = "/* Written by posture_opt: C99, to be linked with -lm. */\n#include <float.h>\n#include <math.h>\n"
_ROWS_COMMENT = """ * {name}_rows does the same for many: every array has that many rows, one after another.
 * The digits are the same; compiled with -O3 it is three times as fast.
"""
_KEYWORDS = """
    auto break case char const continue default do double else enum extern float for goto if inline int long main
    register restrict return short signed sizeof static struct switch typedef union unsigned void volatile while
    and bool catch class delete explicit export false friend mutable namespace new not operator or private protected
    public template this throw true try typename using virtual xor
"""
"""Of C, then those of C++, which includes the header too."""


def _check_names(function: casadi.Function, name: str) -> None:
    """Refuse names that C cannot have or has already.

    Raises:
        InputError: all of them at once.
    """
    arguments = [*map(function.name_in, range(function.n_in())), *map(function.name_out, range(function.n_out()))]
    issues = [
        Issue(f"{word!r} is no C identifier that is free", hint="use letters, digits and _, and no word of C itself")
        for word in (name, *arguments)
        if not (word.isascii() and word.isidentifier())
        or word in _KEYWORDS.split()
        or (word == name and hasattr(math, word))
    ]
    if issues:
        raise InputError(issues)


_HEADER_TEMPLATE = string.Template("""/* Written by posture_opt. Link with -lm.
 *
 * Inputs ($input_order):
$inputs
 * Outputs ($output_order):
$outputs
 * Returns 0.
$rows */
#ifndef $guard
#define $guard
#ifdef __cplusplus
extern "C" {
#endif

$prototypes
#ifdef __cplusplus
}
#endif
#endif
""")


def _memory_order(arguments: list[tuple[str, tuple[int, int]]], major: str) -> str:
    """How the arguments are laid out in memory: of vectors there is one way only."""
    matrices = any(min(size) > 1 for _, size in arguments)
    return f"matrices {major}" if matrices else "vector" if len(arguments) == 1 else "vectors"


def _c_comment(arguments: list[tuple[str, tuple[int, int]]], descriptions: Mapping[str, str]) -> str:
    """One line an argument: name, size, unit and meaning; ``*/`` in it cannot end the comment."""
    lines = []
    for key, (rows, columns) in arguments:
        size = f"{rows * columns}" if 1 in (rows, columns) else f"{rows} x {columns}"
        text = one_line(descriptions.get(key, "")).replace("*/", "* /")
        lines.append(f" *   {key} ({size}) {text}".rstrip())
    return "\n".join(lines)


def c_text(functions: list[casadi.Function]) -> str:
    """CasADi's C text of the functions, all in one file."""
    generator = casadi.CodeGenerator("posture_opt", {"with_header": False, "verbose": False})
    for function in functions:
        generator.add(function)
    return str(generator.dump())


def row_function(function: casadi.Function, name: str) -> casadi.Function:
    """The same function, dense, its outputs transposed: CasADi's column-major is then NumPy's and C's row-major.

    Args:
        function: SX or MX.
        name: of the new one; CasADi refuses some words of C.
    """
    kind = casadi.SX if function.is_a("SXFunction") else casadi.MX
    inputs: Any = [kind.sym(f"x{i}", *function.size_in(i)) for i in range(function.n_in())]
    outputs: Any = [casadi.densify(output).T for output in function.call(inputs)]
    return casadi.Function(name, inputs, outputs)
