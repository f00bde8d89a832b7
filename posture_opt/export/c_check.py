"""A C program that holds exported functions against this package's own numbers.

It travels with the functions: who compiles them for another processor sees there whether they are right.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from posture_opt.model.c_rows import literal
from posture_opt.model.compiled import BatchFunction
from posture_opt.numerics import Array
from posture_opt.robot.joint_ranges import drawn_between
from posture_opt.robot.robot import Robot

POSTURES = 5
TOLERANCE = 1e-10
"""Of the largest entry of an output: thousands of roundings, and square roots where two variances nearly agree."""


@dataclass(frozen=True)
class CheckedFunction:
    """An exported function ``int name(q, output…)`` and the CasADi function that it was made from.

    Args:
        rows: whether ``name_rows`` is there too, for many postures in one call.
    """

    name: str
    function: Any
    rows: bool


def check_text(robot: Robot, checked: Sequence[CheckedFunction]) -> str:
    """C99 of a ``main`` that returns 0 where all functions give the numbers of CasADi's interpreter at `POSTURES`."""
    low, high = drawn_between(robot)
    Q = np.random.default_rng(0).uniform(low, high, (POSTURES, robot.n))
    lines = [_HEAD, *(f'#include "{each.name}.h"' for each in checked), "", *_array("q", Q), _COMPARE]
    calls: list[str] = []
    for each in checked:
        lines += _declared(each, Q)
        calls += _calls(each, robot.n)
    return "\n".join([*lines, "", "int main(void) {", "  int wrong = 0;", *calls, _END])


def _declared(each: CheckedFunction, Q: Array) -> Iterator[str]:
    """What is expected of every output, as interpreted: no line of it comes from the generator that is checked."""
    found = BatchFunction(each.function, compiled=False)(Q)
    outputs = found if isinstance(found, tuple) else (found,)
    for key, values in zip(_keys(each), outputs, strict=True):
        yield from _array(f"{each.name}_{key}", values.reshape(len(Q), -1))


def _calls(each: CheckedFunction, n: int) -> Iterator[str]:
    """Lines of ``main``: every output alone, for one posture and for all at once."""
    keys = _keys(each)
    for key in keys:
        size = each.function.numel_out(keys.index(key))
        wanted = ", ".join("out" if other == key else "0" for other in keys)
        yield f"  {{ double out[{size}], all[{POSTURES * size}];"
        yield f"    for (int i = 0; i < {POSTURES}; ++i) {{"
        yield f"      wrong |= {each.name}(q + {n} * i, {wanted});"
        yield f"      for (int j = 0; j < {size}; ++j) all[{size} * i + j] = out[j];"
        yield "    }"
        yield f'    wrong |= compare("{each.name}", "{key}", all, {each.name}_{key}, {POSTURES * size});'
        if each.rows:
            wanted = wanted.replace("out", "all")
            yield f"    wrong |= {each.name}_rows({POSTURES}, q, {wanted});"
            yield f'    wrong |= compare("{each.name}_rows", "{key}", all, {each.name}_{key}, {POSTURES * size});'
        yield "  }"


def _keys(each: CheckedFunction) -> list[str]:
    """The names of the outputs, in their order."""
    return [each.function.name_out(i) for i in range(each.function.n_out())]


def _array(name: str, values: Array) -> Iterator[str]:
    """A constant array of C, a line for each row of the values, every digit kept."""
    yield f"static const double {name}[{values.size}] = {{"
    for row in values:
        yield f"  {', '.join(map(literal, row.tolist()))},"
    yield "};"


_HEAD = """/* Written by posture_opt: holds the functions against its own numbers.
 *
 *   cc -O3 -std=c99 *.c -o check -lm && ./check
 */
#include <math.h>
#include <stdio.h>"""
_COMPARE = f"""
/* 0 where the largest difference is below {TOLERANCE:g} of the largest number. */
static int compare(const char* function, const char* output, const double* found, const double* expected, int count) {{
  double largest = 0.0, apart = 0.0;
  for (int i = 0; i < count; ++i) {{
    const double difference = fabs(found[i] - expected[i]);
    if (fabs(expected[i]) > largest) largest = fabs(expected[i]);
    if (!(difference <= apart)) apart = difference;
  }}
  const int wrong = !(apart <= {TOLERANCE:g} * largest);
  printf("%s, %s: largest difference %.1e of %.3e%s\\n", function, output, apart, largest, wrong ? ", WRONG" : "");
  return wrong;
}}
"""
_END = """  puts(wrong ? "wrong" : "right");
  return wrong;
}
"""
