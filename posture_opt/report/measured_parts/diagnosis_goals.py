"""What the report says of goals that were measured in several postures: which one a model chooses, what is missed.

They show by measurement what planning with a better model is worth: for each goal, one of its postures is the one that
the model would have chosen.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from posture_opt.report.measured_parts.diagnosis_sizes import MODELS
from posture_opt.report.text.blocks import Block, Table
from posture_opt.report.text.words import PARTS
from posture_opt.statements.notation import count, length, percent
from posture_opt.units import number

if TYPE_CHECKING:
    from posture_opt.diagnosis.measured_goals import Choice, MeasuredGoals

_TITLE = "Comparison of plans, as measured"


def goals_lead(goals: MeasuredGoals | None) -> tuple[str, ...]:
    """What the data say of the choice, in a sentence; nothing where no goal was measured in several postures.

    Compared are medians of measured errors: posture and command from the model before calibration, and from that with
    effects.
    """
    if goals is None:
        return ()
    old, new = (goals.sent[name].missed for name in ("nominal", "extended"))
    return (
        f"Over {_goals(goals)}, the tool missed by {_median(old)} (median) with posture and commands of the model "
        f"before calibration, and by {_median(new)} with those of the model with effects.",
    )


def goals_block(goals: MeasuredGoals | None) -> tuple[Block, ...]:
    """Both choices, of the tool sent by each model and of the arm sent as before calibration.

    First table: each model chooses the posture and computes the command. Second table: commands of the model before
    calibration, so that only the choice differs; its first row is a posture chosen at random. Medians over the goals
    [mm].
    """
    if goals is None:
        return ()
    part = PARTS[goals.within]
    sent = (
        f"{_goals(goals)[:1].upper()}{_goals(goals)[1:]} show directly what a choice is worth. Each model "
        f"chooses the posture for which it predicts the least scatter {part} and commands the tool there; the error "
        f"{part} was measured, on rows held out from the fit. Medians over the targets:"
    )
    left = (
        "If the commands still come from the model before calibration, a better model can predict which posture has "
        "the smaller error:"
    )
    return (
        Block(
            _TITLE,
            (
                sent,
                _table("commanded by the model", goals.sent, goals.clearance),
                _worth(goals),
                left,
                _left(goals),
                _times_better(goals),
            ),
            brief=(),
        ),
    )


def _goals(goals: MeasuredGoals) -> str:
    """How many targets were measured in several postures."""
    each = "two postures" if goals.postures == 2 * goals.goals else "two postures or more"
    return f"the {count(goals.goals, 'target')} measured in {each}"


def _table(head: str, choices: Mapping[str, Choice], clearance: float | None) -> Table:
    """A row for each model: the error in the posture that it chooses, and how often that is the better one."""
    meets = [] if clearance is None else ["fits"]
    headers = (head, "error there [mm]", "95 % below", *meets, "in the others [mm]", "chose the better")
    return Table(headers, tuple((MODELS[name], *_cells(choice, clearance)) for name, choice in choices.items()))


def _left(goals: MeasuredGoals) -> Table:
    """The table of what is left without corrections, with a row for a posture chosen at random.

    A model whose row does not beat that one has no use for choosing postures here.
    """
    table = _table("chosen with the model", goals.uncorrected, goals.clearance)
    blank = [""] * (len(table.headers) - 4)
    blind = ("any posture", *(_mm(goals.anyhow, q) for q in (0.5, 0.95)), *blank, percent(goals.chance))
    return Table(table.headers, (blind, *table.rows))


def _cells(choice: Choice, clearance: float | None) -> tuple[str, ...]:
    """The numbers of one model."""
    meets = [] if clearance is None else [percent(choice.hits(clearance))]
    return (
        _mm(choice.missed), _mm(choice.missed, 0.95), *meets, _mm(choice.elsewhere), percent(choice.better)
    )  # fmt: skip


def _worth(goals: MeasuredGoals) -> str:
    """Whether the posture of least scatter is the better one, for the extended model.

    Compared with choosing at random, within the margin that so many goals allow.
    """
    chosen = goals.sent["extended"]
    if abs(chosen.better - goals.chance) <= goals.margin:
        return (
            "With the arm known this well, the predicted scatter no longer separates the postures: the error is "
            f"{_median(chosen.missed)} in the chosen ones, {_median(chosen.elsewhere)} in the others."
        )
    if chosen.better > goals.chance:
        return f"The scatter that the model with effects predicts finds the better posture in {percent(chosen.better)}."
    return (
        "The residual errors are not scatter of the kind that the model with effects predicts: its choice is the "
        f"better one in only {percent(chosen.better)}."
    )


def _times_better(goals: MeasuredGoals) -> str:
    """Whether a better model finds the better posture where commands come from the model before calibration."""
    best = goals.uncorrected["extended"]
    if best.better <= goals.chance + goals.margin:
        return "Here it cannot: its choice is no better than a random one."
    return (
        f"The model with effects finds the better posture for {percent(best.better)} of the targets, with an error of "
        f"{_median(best.missed)} where the other posture has {_median(best.elsewhere)}."
    )


def _median(values: np.ndarray) -> str:
    """The median of some errors (k,) [m]."""
    return length(float(np.median(values)))


def _mm(values: np.ndarray, q: float = 0.5) -> str:
    """A quantile of some errors (k,) [m], in mm."""
    return number(1e3 * float(np.quantile(values, q)))
