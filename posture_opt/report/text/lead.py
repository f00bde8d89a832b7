"""The lead of a report: the statements of the first screen, the gravest first, within its limits."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Sequence

from posture_opt.statements import SEVERITIES, Statement, by_severity

WIDTH = 100
"""Columns of a file, and where no terminal says how wide it is."""
MAX_LINES, MAX_WORDS = 8, 90
"""Of a lead of `WIDTH` columns, its title not counted."""

Line = tuple[str, str]
"""A label, mostly empty, and a sentence."""


def lead(statements: Sequence[Statement]) -> tuple[tuple[Statement, ...], tuple[Statement, ...]]:
    """The statements of the first screen, and those of the same weight that it has no room for.

    The first result is the headline and comes first; then dangers, cautions and results in this order. Where there is
    no room for all, they count in the order dangers, second result, cautions, further results.

    Args:
        statements: of a result; notes and details are in neither part.
    """
    of = {severity: [one for one in statements if one.severity == severity] for severity in SEVERITIES}
    headline, results = next(iter(of["result"]), None), of["result"][1:]
    shown, rest = of["result"][:1], list[Statement]()
    for one in (*of["danger"], *results[:1], *of["caution"], *results[1:]):
        (shown if fits(ordered([*shown, one], headline)) else rest).append(one)
    return ordered(shown, headline), by_severity(rest)


def ordered(statements: Iterable[Statement], headline: Statement | None) -> tuple[Statement, ...]:
    """The headline, then the others, the gravest first."""
    return tuple(sorted(by_severity(statements), key=lambda one: one is not headline))


def fits(statements: Sequence[Statement]) -> bool:
    """Whether statements are a lead within its limits."""
    lines = lines_of(statements)
    words = sum(len(f"{label} {text}".split()) for label, text in lines)
    return words <= MAX_WORDS and sum(row.count("\n") + 1 for row in written(lines, WIDTH)) <= MAX_LINES


def lines_of(statements: Iterable[Statement]) -> tuple[Line, ...]:
    """Label and sentence of each statement."""
    return tuple((one.label, one.text) for one in statements)


def written(lines: Sequence[Line], width: int) -> list[str]:
    """Lines as text: labels in a column of their own, sentences without a label as wide as all."""
    column = max((len(label) for label, _ in lines), default=0) + 2
    return [
        textwrap.fill(
            text,
            width,
            initial_indent=f"{label:<{column}}" if label else "",
            subsequent_indent=" " * column if label else "",
            break_on_hyphens=False,
        )
        for label, text in lines
    ]
