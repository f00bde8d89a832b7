"""What the report says of goals that were measured in several postures: which one a model chooses, what is missed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from posture_opt.report.blocks import Block, Table
from posture_opt.report.diagnosed import MODELS
from posture_opt.report.units_text import count, length, number, percent
from posture_opt.report.words import PARTS

if TYPE_CHECKING:
    from posture_opt.diagnosis.measured_goals import Choice, MeasuredGoals

_TITLE = "Comparison of plans, as measured"


def goals_lead(goals: MeasuredGoals | None) -> tuple[str, ...]:
    """What the data say of the choice, in a sentence; nothing where no goal was measured in several postures."""
    if goals is None:
        return ()
    old, new = (goals.sent[name].missed for name in ("nominal", "extended"))
    return (
        f"Over {_goals(goals)}, the tool sent by the model before calibration missed by {_median(old)} in the posture "
        f"that this model chooses; sent by the extended one, by {_median(new)} (medians, as measured).",
    )


def goals_block(goals: MeasuredGoals | None) -> tuple[Block, ...]:
    """Both choices, of the tool sent by each model and of the arm sent as before calibration."""
    if goals is None:
        return ()
    part = PARTS[goals.within]
    sent = (
        f"{_goals(goals)[:1].upper()}{_goals(goals)[1:]}: there the data themselves say what a choice is worth. Each "
        f"model takes the posture where it predicts the least scatter {part}, and sends the tool there; what is then "
        f"missed {part} was measured, on rows held out from the fit. Medians over the goals:"
    )
    left = (
        "Where the tool is still sent by the model before calibration, a better model can predict in which posture "
        "that misses by less:"
    )
    return (
        Block(
            _TITLE,
            (
                sent,
                _table("sent by the model", goals.sent, goals.clearance),
                _worth(goals),
                left,
                _left(goals),
                _told(goals),
            ),
        ),
    )


def _goals(goals: MeasuredGoals) -> str:
    each = "two postures" if goals.postures == 2 * goals.goals else "two postures or more"
    return f"the {count(goals.goals, 'goal')} that were measured in {each}"


def _table(head: str, choices: Mapping[str, Choice], clearance: float | None) -> Table:
    meets = [] if clearance is None else ["fits"]
    headers = (head, "missed there [mm]", "95 % below", *meets, "in the others [mm]", "better chosen")
    return Table(headers, tuple((MODELS[name], *_cells(choice, clearance)) for name, choice in choices.items()))


def _left(goals: MeasuredGoals) -> Table:
    table = _table("chosen with the model", goals.uncorrected, goals.clearance)
    blank = [""] * (len(table.headers) - 4)
    blind = ("any posture", *(_mm(goals.anyhow, q) for q in (0.5, 0.95)), *blank, percent(goals.chance))
    return Table(table.headers, (blind, *table.rows))


def _cells(choice: Choice, clearance: float | None) -> tuple[str, ...]:
    meets = [] if clearance is None else [percent(choice.hits(clearance))]
    return (
        _mm(choice.missed), _mm(choice.missed, 0.95), *meets, _mm(choice.elsewhere), percent(choice.better)
    )  # fmt: skip


def _worth(goals: MeasuredGoals) -> str:
    """Whether the posture of least scatter is the better one, for the extended model."""
    chosen = goals.sent["extended"]
    if abs(chosen.better - goals.chance) <= goals.margin:
        return (
            "With the arm known that well, the predicted scatter no longer tells the better posture: "
            f"{_median(chosen.missed)} are missed in the chosen ones, {_median(chosen.elsewhere)} in the others."
        )
    if chosen.better > goals.chance:
        return f"The scatter that the extended model predicts tells the better posture in {percent(chosen.better)}."
    return (
        "The remaining errors are no scatter of the kind that the extended model predicts: its choice is the "
        f"better one in only {percent(chosen.better)}."
    )


def _told(goals: MeasuredGoals) -> str:
    best = goals.uncorrected["extended"]
    if best.better <= goals.chance + goals.margin:
        return "Here it cannot: its choice is no better than a random one."
    return (
        f"With its effects the model finds the better posture in {percent(best.better)} of the goals, and misses by "
        f"{_median(best.missed)} where the other posture misses by {_median(best.elsewhere)}."
    )


def _median(values: np.ndarray) -> str:
    return length(float(np.median(values)))


def _mm(values: np.ndarray, q: float = 0.5) -> str:
    return number(1e3 * float(np.quantile(values, q)))
