"""The error budget: one line a source, or a line for those whose errors cancel.

Shares are of the variance along one axis: they add up to 100 %, and a share of 60 % removed leaves 63 % of σ.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from posture_opt.model.arm import Arm
from posture_opt.report.parts.parts import sigma_of
from posture_opt.report.text.blocks import Block, Table
from posture_opt.report.text.words import source_size, source_words
from posture_opt.statements.notation import percent
from posture_opt.uncertainty.spread.budget_groups import SHARE_TOLERANCE, ShareGroup

if TYPE_CHECKING:
    from posture_opt.selection.problem_data import ProblemData

_MIN_SHARE = 0.01  # of the variance: what lies below is lumped
_MAX_LINES = 12
_MAX_NAMED_SOURCES = 3  # sources of a group that are named


def budget_block(problem: ProblemData, groups: Sequence[ShareGroup], sentence: str) -> Block:
    """Where a variance comes from: the sentence that says which, the shares, and what a line of several sources is.

    Args:
        groups: sources with their shares, those that correlate in one group.
        sentence: which variance it is, for example along the worst axis across the direction.
    """
    together = any(len(group.parameters) > 1 for group in main_groups(groups)[0])
    note = ("Sources on one line are correlated and partly cancel: only their combined share is meaningful.",)
    table = budget_table(problem.arm, groups, sigma_of(problem))
    items = (sentence, table, *(note if together else ()))
    return Block("Error budget", items, figure="budget", brief=())


def main_fact(groups: Sequence[ShareGroup]) -> tuple[str, str]:
    """The largest contributions in one line: at most three sources with their shares of the variance [%]."""
    largest = [
        f"{named(group.parameters)} {_share(group.share)}" for group in groups[:_MAX_NAMED_SOURCES] if group.share > 0
    ]
    return "Main contributions", ", ".join(largest) or "none"


def main_groups(groups: Sequence[ShareGroup]) -> tuple[list[ShareGroup], list[ShareGroup]]:
    """The lines that are shown one by one, and those that are lumped: none or at least two.

    Shown are groups of at least 1 % of the variance, twelve at most, and always the first one.
    """
    shown = [group for group in groups if group.share >= _MIN_SHARE][:_MAX_LINES] or list(groups[:1])
    rest = [group for group in groups if group not in shown]
    return ([*shown, *rest], []) if len(rest) == 1 else (shown, rest)


def budget_table(arm: Arm, groups: Sequence[ShareGroup], sigma: Mapping[str, float]) -> Table:
    """Shares of the sources in a variance, cumulated; the small ones lumped.

    One row a source, the largest first: words, name in the file, standard deviation, share [%], sum so far [%]. A
    group of correlated sources is one row without a standard deviation. Shares below 1 % are lumped.

    Args:
        sigma: standard deviation [rad or m] by parameter.
    """
    shown, rest = main_groups(groups)
    rows, total = [], 0.0
    for group in shown:
        total += group.share
        (first, *others) = group.parameters
        size = "" if others else source_size(first, sigma.get(first, math.nan), arm)
        rows.append((group_words(group, arm), named(group.parameters), size, _share(group.share), percent(total)))
    if rest:
        lumped = sum(group.share for group in rest)
        rows.append((others_words(rest), "", "", _share(lumped), percent(total + lumped)))
    return Table(("source", "parameter", "standard deviation", "share", "cumulative"), tuple(rows), text_columns=2)


def group_words(group: ShareGroup, arm: Arm) -> str:
    """A source in words; several that correlate by name, the first of many."""
    words = named([source_words(name, arm) for name in group.parameters])
    return words if len(group.parameters) == 1 else f"{words} (correlated)"


def others_words(groups: Sequence[ShareGroup]) -> str:
    """How many sources are lumped."""
    return f"{sum(len(group.parameters) for group in groups)} others"


def named(parameters: Sequence[str]) -> str:
    """Names as the file has them, the first few of many."""
    more = len(parameters) - _MAX_NAMED_SOURCES
    return ", ".join([*parameters[:_MAX_NAMED_SOURCES], *([f"{more} more"] if more > 0 else [])])


def _share(share: float) -> str:
    """A share of a variance; what is below zero by rounding or next to nothing is zero."""
    return percent(0.0 if -SHARE_TOLERANCE < share < 0 else share)
