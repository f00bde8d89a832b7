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
        turned: with the posture (n,) [rad or m] that the joints were set to; with None, to go back to the best.
        chosen: with the place (3,) [m] of the obstacle that was chosen; None for none.
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
