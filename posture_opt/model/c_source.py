"""CasADi functions as C text, for this package's own compiler and for export, and as Python text for export."""

from __future__ import annotations

import math
import string
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import casadi as ca

from posture_opt.errors import InputError, Issue
from posture_opt.files import packaged
from posture_opt.model.c_rows import CFunction, Steps, one_text, preamble_text, rows_text
from posture_opt.texts import one_line


def c_source(
    function: ca.Function,
    name: str,
    descriptions: Mapping[str, str] | None = None,
    *,
    rows: bool = False,
    shared: bool = False,
) -> tuple[str, str]:
    """Self-contained C99 text of an SX function and its header: ``int name(const double* in, …, double* out, …)``.
    rows: whether there is also ``int name_rows(long long rows, …)``, for many inputs at once. Returns the C text (needs
    the mathematics library alone) and the header text. Matrices: inputs column-major, outputs row-major."""
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
    return [(key, rows * columns) for key, (rows, columns) in arguments]


# Name that CasADi accepts; it refuses names that C takes: of a leading or a double underscore, and some words
_CASADI_NAME = "f"
_FILE_COMMENT = "/* Written by posture_opt: C99, to be linked with -lm. */\n#include <float.h>\n#include <math.h>\n"
_ROWS_COMMENT = """ * {name}_rows does the same for many: every array has that many rows, one after another.
 * The digits are the same; compiled with -O3 it is three times as fast.
"""
# Of C, then those of C++, which includes the header too
_KEYWORDS = """
    auto break case char const continue default do double else enum extern float for goto if inline int long main
    register restrict return short signed sizeof static struct switch typedef union unsigned void volatile while
    and bool catch class delete explicit export false friend mutable namespace new not operator or private protected
    public template this throw true try typename using virtual xor
"""


def _check_names(function: ca.Function, name: str) -> None:
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


def c_file(package: str, file: str, numbers: Mapping[str, float]) -> str:
    """The text of a C file in a package, behind the numbers that it shares with Python, as macros."""
    return "".join(f"#define {name} {value!r}\n" for name, value in numbers.items()) + packaged(package, file)


def c_text(functions: list[ca.Function]) -> str:
    """CasADi's C text of the functions, all in one file."""
    generator = ca.CodeGenerator("posture_opt", {"with_header": False, "verbose": False})
    for function in functions:
        generator.add(function)
    return str(generator.dump())


def row_function(function: ca.Function, name: str) -> ca.Function:
    """Dense, with transposed outputs: CasADi's column-major is then NumPy's and C's row-major."""
    kind = ca.SX if function.is_a("SXFunction") else ca.MX
    inputs: Any = [kind.sym(f"x{i}", *function.size_in(i)) for i in range(function.n_in())]
    outputs: Any = [ca.densify(output).T for output in function.call(inputs)]
    return ca.Function(name, inputs, outputs)


# CasADi's operation -> NumPy text of it
_OPERATIONS = {
    ca.OP_ADD: "{0} + {1}", ca.OP_SUB: "{0} - {1}", ca.OP_MUL: "{0} * {1}", ca.OP_DIV: "{0} / {1}",
    ca.OP_POW: "{0} ** {1}", ca.OP_CONSTPOW: "{0} ** {1}", ca.OP_FMIN: "np.fmin({0}, {1})",
    ca.OP_FMAX: "np.fmax({0}, {1})", ca.OP_ATAN2: "np.arctan2({0}, {1})", ca.OP_LT: "({0} < {1}) * 1.0",
    ca.OP_LE: "({0} <= {1}) * 1.0", ca.OP_EQ: "({0} == {1}) * 1.0", ca.OP_NE: "({0} != {1}) * 1.0",
    ca.OP_AND: "np.logical_and({0}, {1}) * 1.0", ca.OP_OR: "np.logical_or({0}, {1}) * 1.0",
    ca.OP_IF_ELSE_ZERO: "np.where({0}, {1}, 0.0)", ca.OP_COPYSIGN: "np.copysign({0}, {1})",
    ca.OP_FMOD: "np.fmod({0}, {1})", ca.OP_HYPOT: "np.hypot({0}, {1})",
    ca.OP_ASSIGN: "{0}", ca.OP_NEG: "-{0}", ca.OP_SQ: "{0} * {0}", ca.OP_TWICE: "2 * {0}", ca.OP_INV: "1 / {0}",
    ca.OP_SQRT: "np.sqrt({0})", ca.OP_SIN: "np.sin({0})", ca.OP_COS: "np.cos({0})", ca.OP_TAN: "np.tan({0})",
    ca.OP_ASIN: "np.arcsin({0})", ca.OP_ACOS: "np.arccos({0})", ca.OP_ATAN: "np.arctan({0})",
    ca.OP_EXP: "np.exp({0})", ca.OP_LOG: "np.log({0})", ca.OP_FABS: "np.abs({0})", ca.OP_SIGN: "np.sign({0})",
    ca.OP_FLOOR: "np.floor({0})", ca.OP_CEIL: "np.ceil({0})", ca.OP_NOT: "np.logical_not({0}) * 1.0",
    ca.OP_TANH: "np.tanh({0})", ca.OP_SINH: "np.sinh({0})", ca.OP_COSH: "np.cosh({0})", ca.OP_ERF: "_erf({0})",
    ca.OP_LOG1P: "np.log1p({0})", ca.OP_EXPM1: "np.expm1({0})",
}  # fmt: skip


def python_source(function: ca.Function, name: str, outputs: Sequence[int] | None = None) -> str:
    """The Python text of ``name(q)``, arrays (..., n), by the steps of an SX function of one vector (n,). Outputs are
    arrays (..., m, k), vectors (..., m) or scalars (...); the text uses ``np``, ``_shaped`` and ``_erf``."""
    x = ca.SX.sym("q", *function.size_in(0))
    found = function.call([x])
    wanted = [ca.densify(ca.SX(found[i])) for i in (outputs or range(len(found)))]
    shapes = [y.shape for y in wanted]
    dense = ca.Function("steps", [x], wanted)
    lines = [f"def {name}(q):", *(f"    {line}" for line in _step_lines(dense))]
    sizes = [(rows, columns) if columns > 1 else (rows,) if rows > 1 else () for rows, columns in shapes]
    shaped = ", ".join(f"_shaped(q, y{i}, {size!r})" for i, size in enumerate(sizes))
    return "\n".join([*lines, f"    return {shaped}{',' * (len(shapes) == 1)}", ""])


def _step_lines(function: ca.Function) -> Iterator[str]:
    yield "q = np.asarray(q, dtype=float)"
    for i in range(function.n_out()):
        yield f"y{i} = [0.0] * {function.nnz_out(i)}"
    for k in range(function.n_instructions()):
        operation = function.instruction_id(k)
        into, given = function.instruction_output(k), function.instruction_input(k)
        if operation == ca.OP_CONST:
            yield f"w{into[0]} = {float(function.instruction_constant(k))!r}"
        elif operation == ca.OP_INPUT:
            yield f"w{into[0]} = q[..., {given[1]}]"
        elif operation == ca.OP_OUTPUT:
            yield f"y{into[0]}[{into[1]}] = w{given[0]}"
        else:
            text = _OPERATIONS.get(operation)
            assert text is not None, f"no Python for operation {operation} of CasADi"
            yield f"w{into[0]} = {text.format(*(f'w{g}' for g in given))}"
