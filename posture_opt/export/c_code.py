"""Covariance, objective and its derivatives as C99 that needs math.h alone."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np

from posture_opt.export.export_format import Exported, ExportFormat, ExportSource, objective_or_note
from posture_opt.model.c_rows import literal
from posture_opt.model.c_source import c_source
from posture_opt.model.compiled import BatchFunction
from posture_opt.numerics import Array
from posture_opt.robot.posture import drawn_between
from posture_opt.robot.robot import Robot
from posture_opt.uncertainty.spread_function import spread_expressions

POSTURES = 5
# Of the largest entry of an output: thousands of roundings, and square roots where two variances nearly agree.
TOLERANCE = 1e-10


class CCode(ExportFormat):
    """``NAME.c`` and ``.h`` with the moments of the tool point.

    ``NAME_objective.c`` and ``.h`` have the task's objective with gradient and Hessian, ``NAME_check.c`` a ``main``
    that compares all of them with known numbers. The code needs ``math.h`` alone; q (n,) is in rad and m, outputs are
    SI, world frame.
    """

    summary: ClassVar[str] = "covariance of the tool point, objective, gradient and Hessian as C99, math.h alone"
    default: ClassVar[str] = "tool_covariance"

    kind: Literal["c"] = "c"

    def write(self, source: ExportSource) -> Exported:
        """Headers and sources; a note says why the objective is left out: no task, or several targets."""
        name, problem = self.name or self.default, source.problem
        spread, described = spread_expressions(problem)
        files = _written(name, c_source(spread, name, described, rows=True))
        checked = [CheckedFunction(name, spread, rows=True)]
        objective, notes = objective_or_note(problem)
        if objective is not None:
            # The gradient goes on from the objective, and the Hessian from both.
            files |= _written(
                f"{name}_objective", c_source(objective[0], f"{name}_objective", objective[1], shared=True)
            )
            checked.append(CheckedFunction(f"{name}_objective", objective[0], rows=False))
        return Exported(files | {f"{name}_check.c": check_text(problem.robot, checked)}, notes)


def _written(name: str, texts: tuple[str, str]) -> dict[str, str]:
    text, header = texts
    return {f"{name}.h": header, f"{name}.c": text}


@dataclass(frozen=True)
class CheckedFunction:
    """An exported function ``int name(q, output…)`` and the CasADi function that it was made from.

    Args:
        name: in C; ``function`` takes q (n,) [rad or m].
    """

    name: str
    function: Any
    rows: bool


def check_text(robot: Robot, checked: Sequence[CheckedFunction]) -> str:
    """C99 of a ``main`` that returns 0 where all functions give the numbers of CasADi's interpreter at `POSTURES`."""
    low, high = drawn_between(robot)
    Q = np.random.default_rng(0).uniform(low, high, (POSTURES, robot.n))
    lines = [_CHECK_HEADER, *(f'#include "{each.name}.h"' for each in checked), "", *_array("q", Q), _COMPARE_FUNCTION]
    calls: list[str] = []
    for each in checked:
        lines += _declared(each, Q)
        calls += _calls(each, robot.n)
    return "\n".join([*lines, "", "int main(void) {", "  int wrong = 0;", *calls, _CHECK_FOOTER])


def _declared(each: CheckedFunction, Q: Array) -> Iterator[str]:
    """What is expected of every output, as interpreted: no line of it comes from the generator that is checked.

    Args:
        Q: (k, n) postures [rad or m].
    """
    found = BatchFunction(each.function, compiled=False)(Q)
    outputs = found if isinstance(found, tuple) else (found,)
    for key, values in zip(_keys(each), outputs, strict=True):
        yield from _array(f"{each.name}_{key}", values.reshape(len(Q), -1))


def _calls(each: CheckedFunction, n: int) -> Iterator[str]:
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
    return [each.function.name_out(i) for i in range(each.function.n_out())]


def _array(name: str, values: Array) -> Iterator[str]:
    yield f"static const double {name}[{values.size}] = {{"
    for row in values:
        yield f"  {', '.join(map(literal, row.tolist()))},"
    yield "};"


_CHECK_HEADER = """/* Written by posture_opt: holds the functions against its own numbers.
 *
 *   cc -O3 -std=c99 *.c -o check -lm && ./check
 */
#include <math.h>
#include <stdio.h>"""


_COMPARE_FUNCTION = f"""
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


_CHECK_FOOTER = """  puts(wrong ? "wrong" : "right");
  return wrong;
}
"""
