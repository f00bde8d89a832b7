"""C99 text that evaluates an SX function at one row, or at many side by side, so that compilers use vector registers.

Sines and cosines come first, all of a row or of a block of rows in one loop without branches: the mathematics library,
asked for one after another, takes longer for them than all the rest does. The rest is straight-line code in which every
row is a lane.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as ca

from posture_opt.files import packaged

SINE_OPERATIONS = (ca.OP_SIN, ca.OP_COS)  # Operations that C text computes for many angles at once


@dataclass(frozen=True)
class Step:
    """One operation of CasADi on the results of earlier steps."""

    operation: int  # CasADi's code of it, ca.OP_…
    arguments: tuple[int, ...] = ()  # numbers of the steps that it works on
    value: float = 0.0  # of a constant; entry: of an input, which one and which of its entries
    entry: tuple[int, int] = (0, 0)


@dataclass(frozen=True, eq=False)
class Steps:
    """The steps of an SX function with dense outputs."""

    steps: tuple[Step, ...]  # (k,) in an order in which they can be done; no two are equal
    outputs: tuple[tuple[int, ...], ...]  # of every output, the step of each of its entries, column by column

    @classmethod
    def of(cls, function: ca.Function) -> Steps:
        """Read CasADi's instructions, whose work variables are written many times, as steps written once."""
        written: dict[Step, int] = {}
        at: dict[int, int] = {}
        outputs = [[0] * function.nnz_out(i) for i in range(function.n_out())]
        for k in range(function.n_instructions()):
            operation, given = function.instruction_id(k), function.instruction_input(k)
            into = function.instruction_output(k)
            if operation == ca.OP_OUTPUT:
                outputs[into[0]][into[1]] = at[given[0]]
                continue
            if operation == ca.OP_INPUT:
                step = Step(operation, entry=(given[0], given[1]))
            elif operation == ca.OP_CONST:
                step = Step(operation, value=float(function.instruction_constant(k)))
            else:
                step = Step(operation, tuple(at[g] for g in given))
            at[into[0]] = written.setdefault(step, len(written))
        return cls(tuple(written), tuple(map(tuple, outputs)))

    def needed(self, wanted: Iterable[int], known: frozenset[int] = frozenset()) -> list[int]:
        """The steps that the wanted ones follow from, in order, not followed beyond the ``known`` ones."""
        found: set[int] = set()
        waiting = [k for k in wanted if k not in known]
        while waiting:
            k = waiting.pop()
            if k not in found:
                found.add(k)
                waiting += [argument for argument in self.steps[k].arguments if argument not in known]
        return sorted(found)

    @cached_property
    def angles(self) -> tuple[tuple[int, ...], ...]:
        """Steps whose sine or cosine is taken, in rounds: an angle depends on sines and cosines of earlier rounds
        alone."""
        depth: list[int] = []
        rounds: list[dict[int, None]] = []
        for step in self.steps:
            below = max((depth[k] for k in step.arguments), default=0)
            if step.operation in SINE_OPERATIONS:
                while len(rounds) <= below:
                    rounds.append({})
                rounds[below][step.arguments[0]] = None
                below += 1
            depth.append(below)
        return tuple(map(tuple, rounds))

    @cached_property
    def angle_numbers(self) -> dict[int, int]:
        """Step of each angle -> its place among all, round after round."""
        return {k: i for i, k in enumerate(k for angles in self.angles for k in angles)}

    @cached_property
    def turns(self) -> frozenset[int]:
        """The steps that are a sine or a cosine."""
        return frozenset(k for k, step in enumerate(self.steps) if step.operation in SINE_OPERATIONS)


LANES = 8  # Rows side by side: two vectors of AVX2, four of SSE2; 32 are no faster, and the block fits the first cache

# CasADi's operation -> C text of it; an operation that is missing here is a defect
_OPERATIONS = {
    ca.OP_ADD: "{0} + {1}", ca.OP_SUB: "{0} - {1}", ca.OP_MUL: "{0} * {1}", ca.OP_DIV: "{0} / {1}",
    ca.OP_ASSIGN: "{0}", ca.OP_NEG: "-{0}", ca.OP_SQ: "{0} * {0}", ca.OP_TWICE: "2.0 * {0}", ca.OP_INV: "1.0 / {0}",
    ca.OP_POW: "pow({0}, {1})", ca.OP_CONSTPOW: "pow({0}, {1})", ca.OP_FMIN: "fmin({0}, {1})",
    ca.OP_FMAX: "fmax({0}, {1})", ca.OP_ATAN2: "atan2({0}, {1})", ca.OP_LT: "({0} < {1} ? 1.0 : 0.0)",
    ca.OP_LE: "({0} <= {1} ? 1.0 : 0.0)", ca.OP_EQ: "({0} == {1} ? 1.0 : 0.0)", ca.OP_NE: "({0} != {1} ? 1.0 : 0.0)",
    ca.OP_AND: "({0} != 0.0 && {1} != 0.0 ? 1.0 : 0.0)", ca.OP_OR: "({0} != 0.0 || {1} != 0.0 ? 1.0 : 0.0)",
    ca.OP_NOT: "({0} == 0.0 ? 1.0 : 0.0)", ca.OP_IF_ELSE_ZERO: "({0} != 0.0 ? {1} : 0.0)",
    ca.OP_COPYSIGN: "copysign({0}, {1})", ca.OP_FMOD: "fmod({0}, {1})", ca.OP_HYPOT: "hypot({0}, {1})",
    ca.OP_SIGN: "({0} > 0.0 ? 1.0 : {0} < 0.0 ? -1.0 : {0})", ca.OP_FABS: "fabs({0})", ca.OP_SQRT: "sqrt({0})",
    ca.OP_TAN: "tan({0})", ca.OP_ASIN: "asin({0})", ca.OP_ACOS: "acos({0})", ca.OP_ATAN: "atan({0})",
    ca.OP_EXP: "exp({0})", ca.OP_LOG: "log({0})", ca.OP_FLOOR: "floor({0})", ca.OP_CEIL: "ceil({0})",
    ca.OP_TANH: "tanh({0})", ca.OP_SINH: "sinh({0})", ca.OP_COSH: "cosh({0})", ca.OP_ERF: "erf({0})",
    ca.OP_LOG1P: "log1p({0})", ca.OP_EXPM1: "expm1({0})",
}  # fmt: skip

# C text of the sines and cosines of many angles; its comment has method and sources
_SINES = packaged("posture_opt.model", "sines.c")

# GCC on x86-64 and Linux: a second version for processors with AVX2, chosen when the program starts. Neither has fused
# multiply-add, so both give the same digits.
_CLONES = """
#if defined(__x86_64__) && defined(__linux__) && defined(__GLIBC__) && defined(__GNUC__) && !defined(__clang__)
#define PO_CLONES __attribute__((target_clones("avx2", "default")))
#else
#define PO_CLONES
#endif
"""


@dataclass(frozen=True)
class CFunction:
    """The interface of a function in C: its name, and name and size of its inputs and outputs."""

    name: str
    inputs: tuple[tuple[str, int], ...]
    outputs: tuple[tuple[str, int], ...]

    @property
    def prototype(self) -> str:
        """Declaration of the function for one row: an array an input, then an array an output."""
        return f"int {self.name}({self.arguments})"

    @property
    def rows_prototype(self) -> str:
        """Declaration of the function for many rows, each array with that many rows."""
        return f"int {self.name}_rows(long long rows, {self.arguments})"

    @property
    def arguments(self) -> str:
        """The parameters of both, inputs first."""
        return ", ".join(
            [*(f"const double* {key}" for key, _ in self.inputs), *(f"double* {k}" for k, _ in self.outputs)]
        )

    @property
    def keys(self) -> tuple[str, ...]:
        """The names of the outputs, in order."""
        return tuple(key for key, _ in self.outputs)


def one_text(steps: Steps, face: CFunction, shared: bool) -> str:
    """The C text of the function for one row."""
    writer = _Writer(steps, tuple(key for key, _ in face.inputs), 1)
    lines = [*writer.turns(), *(writer.chained(face.keys) if shared else writer.alone(face.keys))]
    ignored = [f"  (void){key};" for key, _ in face.inputs]
    return "\n".join([f"{face.prototype};", f"{face.prototype} {{", *ignored, *lines, "  return 0;", "}", ""])


def preamble_text(steps: Steps) -> str:
    """What functions for one row and for many need before them: the sines, and the choice of vector instructions."""
    return f"{_CLONES}{_SINES if steps.angles else ''}"


def rows_text(steps: Steps, face: CFunction) -> str:
    """The C text for many rows, `LANES` at a time; a block that is not full repeats its last row."""
    writer = _Writer(steps, tuple(key for key, _ in face.inputs), LANES)
    every = [*face.inputs, *face.outputs]
    inputs = [f"const double* restrict {key}" for key, _ in face.inputs]
    block = ", ".join([*inputs, *(f"double* restrict {key}" for key in face.keys)])
    lines = [f"PO_CLONES static void {face.name}_block({block}) {{", *(f"  (void){key};" for key, _ in face.inputs)]
    lines += [*writer.turns(), *writer.alone(face.keys), "}", ""]
    lines += [f"{face.rows_prototype};", f"{face.rows_prototype} {{"]
    lines += [f"  double {', '.join(f'{key}_[{max(size, 1) * LANES}]' for key, size in every)};"]
    lines += [f"  for (long long row_ = 0; row_ < rows; row_ += {LANES}) {{"]
    lines += [f"    const int count_ = rows - row_ < {LANES} ? (int)(rows - row_) : {LANES};"]
    for key, size in face.inputs:  # a block that is not full repeats its last row
        lines += [f"    for (int l_ = 0; l_ < {LANES}; ++l_) for (int i_ = 0; i_ < {size}; ++i_)"]
        lines += [f"      {key}_[i_ * {LANES} + l_] = {key}[(row_ + (l_ < count_ ? l_ : count_ - 1)) * {size} + i_];"]
    wanted = [*(f"{key}_" for key, _ in face.inputs), *(f"{key} ? {key}_ : 0" for key in face.keys)]
    lines += [f"    {face.name}_block({', '.join(wanted)});"]
    for key, size in face.outputs:
        lines += [f"    if ({key}) for (int l_ = 0; l_ < count_; ++l_) for (int i_ = 0; i_ < {size}; ++i_)"]
        lines += [f"      {key}[(row_ + l_) * {size} + i_] = {key}_[i_ * {LANES} + l_];"]
    return "\n".join([*lines, "  }", "  return 0;", "}", ""])


@dataclass(frozen=True)
class _Writer:
    """Lines of C for steps; names of its own end in an underscore, so that arguments may have any that do not."""

    steps: Steps  # the expression graph
    inputs: tuple[str, ...]  # names of the input arrays
    lanes: int  # rows side by side; 1 for a function of one row

    def turns(self) -> Iterator[str]:
        """Lines that fill the sines and cosines of all angles, a round at a time."""
        numbers = self.steps.angle_numbers
        if not numbers:
            return
        size = len(numbers) * self.lanes
        yield f"  double angle_[{size}], sine_[{size}], cosine_[{size}];"
        for angles in self.steps.angles:
            yield f"  {self.loop}{{"
            yield from self.body(self.steps.needed(angles, self.steps.turns))
            yield from (f"    angle_[{self.place(numbers[k])}] = {self.of(k)};" for k in angles)
            yield "  }"
            first, count = numbers[angles[0]] * self.lanes, len(angles) * self.lanes
            yield f"  po_sines(angle_ + {first}, sine_ + {first}, cosine_ + {first}, {count});"

    def alone(self, outputs: Sequence[str]) -> Iterator[str]:
        """Each output in a block of its own."""
        for key, entries in zip(outputs, self.steps.outputs, strict=True):
            yield f"  if ({key}) {self.loop}{{"
            yield from self.body(self.steps.needed(entries, self.steps.turns))
            yield from (f"    {key}[{self.place(i)}] = {self.of(k)};" for i, k in enumerate(entries))
            yield "  }"

    def chained(self, outputs: Sequence[str]) -> Iterator[str]:
        """The outputs one after another, as far as any is wanted."""
        known = set(self.steps.turns)
        for i, (key, entries) in enumerate(zip(outputs, self.steps.outputs, strict=True)):
            if i:
                yield f"  if (!({' || '.join(outputs[i:])})) return 0;"
            needed = self.steps.needed(entries, frozenset(known))
            known.update(needed)
            yield from self.body(needed)
            yield f"  if ({key}) {{"
            yield from (f"    {key}[{j}] = {self.of(k)};" for j, k in enumerate(entries))
            yield "  }"

    def body(self, needed: Sequence[int]) -> Iterator[str]:
        """A constant for each step, in the order in which they can be computed."""
        for k in needed:
            step = self.steps.steps[k]
            if step.operation not in (ca.OP_CONST, ca.OP_INPUT):
                text = _OPERATIONS.get(step.operation)
                assert text is not None, f"no C for operation {step.operation} of CasADi"
                yield f"    const double v{k}_ = {text.format(*map(self.of, step.arguments))};"

    def of(self, k: int) -> str:
        """A step as an operand: a number, an input, a sine, or the constant that holds it."""
        step = self.steps.steps[k]
        if step.operation == ca.OP_CONST:
            return literal(step.value)
        if step.operation == ca.OP_INPUT:
            return f"{self.inputs[step.entry[0]]}[{self.place(step.entry[1])}]"
        if k in self.steps.turns:
            array = "sine_" if step.operation == ca.OP_SIN else "cosine_"
            return f"{array}[{self.place(self.steps.angle_numbers[step.arguments[0]])}]"
        return f"v{k}_"

    @property
    def loop(self) -> str:
        """The loop over lanes; nothing for a single row."""
        return f"for (int l_ = 0; l_ < {self.lanes}; ++l_) " if self.lanes > 1 else ""

    def place(self, entry: int) -> str:
        return f"{entry * self.lanes} + l_" if self.lanes > 1 else str(entry)


def literal(value: float) -> str:
    """A double in C, in the shortest text that reads back exactly."""
    if math.isnan(value):
        return "NAN"
    text = "INFINITY" if math.isinf(value) else repr(abs(value))
    return f"(-{text})" if math.copysign(1.0, value) < 0 else text
