"""The expression graph of a CasADi function as numbered steps, each written once: what C text is made from."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import casadi as ca

SINE_OPERATIONS = (ca.OP_SIN, ca.OP_COS)
"""Operations that C text computes for many angles at once."""


@dataclass(frozen=True)
class Step:
    """One operation of CasADi on the results of earlier steps.

    Args:
        operation: CasADi's code of it, ``ca.OP_…``.
        arguments: numbers of the steps that it works on.
        value: of a constant; ``entry``: of an input, which one and which of its entries.
    """

    operation: int
    arguments: tuple[int, ...] = ()
    value: float = 0.0
    entry: tuple[int, int] = (0, 0)


@dataclass(frozen=True, eq=False)
class Steps:
    """The steps of an SX function with dense outputs.

    Args:
        steps: (k,) in an order in which they can be done; no two are equal.
        outputs: of every output, the step of each of its entries, column by column.
    """

    steps: tuple[Step, ...]
    outputs: tuple[tuple[int, ...], ...]

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
        """The steps that the wanted ones follow from, in order.

        Args:
            wanted: numbers of steps.
            known: steps that have been computed already, and are not followed further.
        """
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
        """The steps whose sine or cosine is taken, in rounds: an angle depends on sines and cosines of earlier
        rounds alone.
        """
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
