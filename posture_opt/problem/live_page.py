"""``LivePage``: what a program holds of a page on which the best posture follows the target."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from posture_opt.robot.posture import Posture
from posture_opt.selection.answer.solution import Solution


class LivePage(Protocol):
    """A live page in a browser, as `Problem.explore` starts it."""

    @property
    def url(self) -> str:
        """Its address."""

    @property
    def target(self) -> tuple[float, float, float]:
        """Where the tool point is asked for, x, y, z [m], world; it can be set, and the page follows."""

    @target.setter
    def target(self, position: Sequence[float]) -> None: ...

    @property
    def posture(self) -> Posture | None:
        """The posture of the latest answer; None while none is feasible."""

    @property
    def solution(self) -> Solution | None:
        """The latest answer; None while none is feasible."""

    def close(self) -> None:
        """End the page, and everything that it computes."""
