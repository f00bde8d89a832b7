"""CasADi functions as Python text that needs NumPy alone, for export."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import casadi as ca

_BINARY_TEXT = {
    ca.OP_ADD: "{0} + {1}", ca.OP_SUB: "{0} - {1}", ca.OP_MUL: "{0} * {1}", ca.OP_DIV: "{0} / {1}",
    ca.OP_POW: "{0} ** {1}", ca.OP_CONSTPOW: "{0} ** {1}", ca.OP_FMIN: "np.fmin({0}, {1})",
    ca.OP_FMAX: "np.fmax({0}, {1})", ca.OP_ATAN2: "np.arctan2({0}, {1})", ca.OP_LT: "({0} < {1}) * 1.0",
    ca.OP_LE: "({0} <= {1}) * 1.0", ca.OP_EQ: "({0} == {1}) * 1.0", ca.OP_NE: "({0} != {1}) * 1.0",
    ca.OP_AND: "np.logical_and({0}, {1}) * 1.0", ca.OP_OR: "np.logical_or({0}, {1}) * 1.0",
    ca.OP_IF_ELSE_ZERO: "np.where({0}, {1}, 0.0)", ca.OP_COPYSIGN: "np.copysign({0}, {1})",
    ca.OP_FMOD: "np.fmod({0}, {1})", ca.OP_HYPOT: "np.hypot({0}, {1})",
}  # fmt: skip
"""CasADi's operation on two numbers -> NumPy text of it."""
_UNARY_TEXT = {
    ca.OP_ASSIGN: "{0}", ca.OP_NEG: "-{0}", ca.OP_SQ: "{0} * {0}", ca.OP_TWICE: "2 * {0}", ca.OP_INV: "1 / {0}",
    ca.OP_SQRT: "np.sqrt({0})", ca.OP_SIN: "np.sin({0})", ca.OP_COS: "np.cos({0})", ca.OP_TAN: "np.tan({0})",
    ca.OP_ASIN: "np.arcsin({0})", ca.OP_ACOS: "np.arccos({0})", ca.OP_ATAN: "np.arctan({0})",
    ca.OP_EXP: "np.exp({0})", ca.OP_LOG: "np.log({0})", ca.OP_FABS: "np.abs({0})", ca.OP_SIGN: "np.sign({0})",
    ca.OP_FLOOR: "np.floor({0})", ca.OP_CEIL: "np.ceil({0})", ca.OP_NOT: "np.logical_not({0}) * 1.0",
    ca.OP_TANH: "np.tanh({0})", ca.OP_SINH: "np.sinh({0})", ca.OP_COSH: "np.cosh({0})", ca.OP_ERF: "_erf({0})",
    ca.OP_LOG1P: "np.log1p({0})", ca.OP_EXPM1: "np.expm1({0})",
}  # fmt: skip
"""CasADi's operation on one number -> NumPy text of it."""


def python_source(function: ca.Function, name: str, outputs: Sequence[int] | None = None) -> str:
    """The Python text of ``name(q)``: a tuple of outputs of a function of one vector, for arrays (..., n) too.

    The lines are the steps of the function's expression graph; outputs of shape (m, k) are arrays (..., m, k), vectors
    (..., m), scalars (...).

    Args:
        function: SX, of one vector (n,).
        name: of the Python function.
        outputs: which outputs, by index; all if left out.

    Returns:
        The text of one function, which uses ``np``, ``_shaped`` and, for the error function, ``_erf``.
    """
    x = ca.SX.sym("q", *function.size_in(0))
    found = function.call([x])
    wanted = [ca.densify(ca.SX(found[i])) for i in (outputs or range(len(found)))]
    shapes = [y.shape for y in wanted]
    dense = ca.Function("steps", [x], wanted)
    lines = [f"def {name}(q):", *(f"    {line}" for line in _step_lines(dense))]
    shaped = ", ".join(f"_shaped(q, y{i}, {_shape_text(shape)})" for i, shape in enumerate(shapes))
    return "\n".join([*lines, f"    return {shaped}{',' * (len(shapes) == 1)}", ""])


def _shape_text(size: tuple[int, int]) -> str:
    """The shape of an output without the batch axes, as Python text."""
    rows, columns = size
    return repr((rows, columns) if columns > 1 else (rows,) if rows > 1 else ())


def _step_lines(function: ca.Function) -> Iterator[str]:
    """An assignment for each step, work variables named w0, w1, …; outputs are kept by place, column by column."""
    yield "q = np.asarray(q, dtype=float)"
    for i in range(function.n_out()):
        yield f"y{i} = [0.0] * {function.nnz_out(i)}"
    for k in range(function.n_instructions()):
        operation, into, given = (
            function.instruction_id(k),
            function.instruction_output(k),
            function.instruction_input(k),
        )
        if operation == ca.OP_CONST:
            yield f"w{into[0]} = {float(function.instruction_constant(k))!r}"
        elif operation == ca.OP_INPUT:
            yield f"w{into[0]} = q[..., {given[1]}]"
        elif operation == ca.OP_OUTPUT:
            yield f"y{into[0]}[{into[1]}] = w{given[0]}"
        else:
            text = _UNARY_TEXT.get(operation) or _BINARY_TEXT.get(operation)
            assert text is not None, f"no Python for operation {operation} of CasADi"
            yield f"w{into[0]} = {text.format(*(f'w{g}' for g in given))}"
