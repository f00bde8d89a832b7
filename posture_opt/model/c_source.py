"""CasADi functions as C text, for this package's own compiler and for export."""

from __future__ import annotations

import math
import string
from collections.abc import Mapping
from typing import Any

import casadi

from posture_opt.errors import InputError, Issue


def c_source(function: casadi.Function, name: str, descriptions: Mapping[str, str] | None = None) -> tuple[str, str]:
    """Self-contained C99 text of a function and its header: ``int name(const double* in, …, double* out, …)``.

    Args:
        name: of the C function; a C identifier.
        descriptions: unit and meaning of the inputs and outputs by name, for the header.

    Returns:
        The C text (needs only math.h) and the header text. Matrices: inputs column-major, outputs row-major.

    Raises:
        InputError: a name is no C identifier, or one that C keeps for itself.
    """
    _check_names(function, name)
    row = row_function(function, f"{name}_row")
    inputs = [(function.name_in(i), function.size_in(i)) for i in range(function.n_in())]
    outputs = [(function.name_out(i), function.size_out(i)) for i in range(function.n_out())]
    arguments = [f"const double* {key}" for key, _ in inputs] + [f"double* {key}" for key, _ in outputs]
    prototype = f"int {name}({', '.join(arguments)})"
    fields = {
        "name": name,
        "guard": f"{name.upper()}_H",
        "prototype": prototype,
        "input_order": _order(inputs, "column-major"),
        "output_order": f"{_order(outputs, 'row-major')}; NULL where not wanted",
        "inputs": _c_comment(inputs, descriptions or {}),
        "outputs": _c_comment(outputs, descriptions or {}),
        "args": ", ".join(key for key, _ in inputs),
        "results": ", ".join(key for key, _ in outputs),
        "iw": row.sz_iw() + 1,
        "w": row.sz_w() + 1,
        "arg": row.sz_arg() + 1,
        "res": row.sz_res() + 1,
    }
    return c_text([row]) + _WRAPPER_C.substitute(fields), _HEADER_C.substitute(fields)


_KEYWORDS = """
    auto break case char const continue default do double else enum extern float for goto if inline int long main
    register restrict return short signed sizeof static struct switch typedef union unsigned void volatile while
"""


def _check_names(function: casadi.Function, name: str) -> None:
    arguments = [*map(function.name_in, range(function.n_in())), *map(function.name_out, range(function.n_out()))]
    issues = [
        Issue(f"{word!r} is no C identifier that is free", mend="use letters, digits and _, and no word of C itself")
        for word in (name, *arguments)
        if not (word.isascii() and word.isidentifier())
        or word in _KEYWORDS.split()
        or (word == name and hasattr(math, word))
    ]
    if issues:
        raise InputError(issues)


# CasADi's names never end in an underscore: the locals' do.
_WRAPPER_C = string.Template("""
$prototype;
$prototype {
  const double* arg_[$arg] = {$args};
  double* res_[$res] = {$results};
  long long int iw_[$iw];
  double w_[$w];
  return ${name}_row(arg_, res_, iw_, w_, 0);
}
""")
_HEADER_C = string.Template("""/* Written by posture_opt. Link with -lm.
 *
 * Inputs ($input_order):
$inputs
 * Outputs ($output_order):
$outputs
 * Returns 0.
 */
#ifndef $guard
#define $guard
#ifdef __cplusplus
extern "C" {
#endif

$prototype;

#ifdef __cplusplus
}
#endif
#endif
""")


def _order(arguments: list[tuple[str, tuple[int, int]]], major: str) -> str:
    """How the arguments lie in memory: of vectors there is one way only."""
    matrices = any(min(size) > 1 for _, size in arguments)
    return f"matrices {major}" if matrices else "vector" if len(arguments) == 1 else "vectors"


def _c_comment(arguments: list[tuple[str, tuple[int, int]]], descriptions: Mapping[str, str]) -> str:
    lines = []
    for key, (rows, columns) in arguments:
        size = f"{rows * columns}" if 1 in (rows, columns) else f"{rows} x {columns}"
        text = descriptions.get(key, "").replace("*/", "* /")
        lines.append(f" *   {key} ({size}) {text}".rstrip())
    return "\n".join(lines)


def c_text(functions: list[casadi.Function]) -> str:
    """CasADi's C text of the functions, all in one file."""
    generator = casadi.CodeGenerator("posture_opt", {"with_header": False, "verbose": False})
    for function in functions:
        generator.add(function)
    return str(generator.dump())


def row_function(function: casadi.Function, name: str) -> casadi.Function:
    """The same function, dense, its outputs transposed: CasADi's column-major is then NumPy's and C's row-major."""
    kind = casadi.SX if function.is_a("SXFunction") else casadi.MX
    inputs: Any = [kind.sym(f"x{i}", *function.size_in(i)) for i in range(function.n_in())]
    outputs: Any = [casadi.densify(output).T for output in function.call(inputs)]
    return casadi.Function(name, inputs, outputs)
