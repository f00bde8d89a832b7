"""``Actions``: what the controls of the page call."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from posture_opt.numerics import Array
from posture_opt.problem.plain_data import Plain
from posture_opt.problem.problem import Problem


@dataclass(frozen=True)
class Actions:
    """What the controls call.

    Args:
        moved: with the place (3,) [m] that the target was typed to.
        changed: with a group of keys and key -> value of the problem file; returns whether they fit.
        turned: with the posture (n,) [rad or m] that the joints were set to; with None, to go back to the best.
        redraw: when other layers are asked for.
        chosen: with the place (3,) [m] of the obstacle that was chosen; None for none.
        save: writes the problem, returns what to say of it; ``report`` the report of the answer, ``picture`` what one
            browser shows.
        asked: the problem that is asked at the moment.
        command: the command line that gives the answer.
    """

    moved: Callable[[Array], None]
    changed: Callable[[str, dict[str, Plain]], bool]
    turned: Callable[[tuple[float, ...] | None], None]
    redraw: Callable[[], None]
    chosen: Callable[[Array | None], None]
    save: Callable[[], str]
    report: Callable[[], str]
    picture: Callable[[Any], str]
    asked: Callable[[], Problem]
    command: Callable[[], str]
