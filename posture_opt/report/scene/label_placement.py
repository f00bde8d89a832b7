"""Labels next to what they name, with leader lines: none on another, on the arm, or out of the picture.

Greedy: the widest label is placed first, each at the cheapest of 24 directions and nine distances.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from posture_opt.numerics import Array, Mask, turn_of

_DISTANCES_PT = (18.0, 30.0, 45.0, 65.0, 90.0, 120.0, 160.0, 210.0, 270.0)  # from the anchor [pt]
_ANGLES = np.radians(np.arange(0, 360, 15))
_PADDING_PT = 3.0  # about a label [pt]
_ON_LABEL, _ON_ARM, _CROSSING, _OVER_ARM = 1e4, 600.0, 400.0, 0.6  # costs in addition to the distance in pt


@dataclass(frozen=True)
class Label:
    """A text and the point that it names.

    Args:
        anchor: (2,) from the lower left of the picture [pt]; ``size`` (2,) of the text [pt].
    """

    text: str
    anchor: Array
    size: Array


@dataclass(frozen=True)
class PlacedLabel:
    """A label and the middle (2,) of its box [pt]."""

    label: Label
    middle: Array

    @property
    def box(self) -> tuple[float, float, float, float]:
        """Left, low, right, high [pt]."""
        (x, y), (w, h) = self.middle, self.label.size / 2
        return x - w, y - h, x + w, y + h

    @property
    def end(self) -> Array:
        """(2,) where the leader line meets the box [pt]."""
        left, low, right, high = self.box
        return np.clip(
            self.label.anchor,
            [left - _PADDING_PT / 2, low - _PADDING_PT / 2],
            [right + _PADDING_PT / 2, high + _PADDING_PT / 2],
        )


def placed(labels: Sequence[Label], taken: Mask, size: Array) -> list[PlacedLabel]:
    """The labels, the widest first, each where it costs least: away from what is taken, and near its anchor.

    Args:
        taken: (H, W) where the picture shows what must be seen, the first row at the bottom.
        size: (2,) of the picture [pt].
    """
    area = np.pad(np.cumsum(np.cumsum(taken.astype(float), axis=0), axis=1), ((1, 0), (1, 0)))
    found: dict[int, PlacedLabel] = {}
    for k in sorted(range(len(labels)), key=lambda k: -float(labels[k].size[0])):
        others = [labels[j].anchor for j in range(len(labels)) if j != k]
        found[k] = _best(_candidates(labels[k], size), list(found.values()), others, taken, area, size)
    return [found[k] for k in range(len(labels))]


def _candidates(label: Label, size: Array) -> list[PlacedLabel]:
    """Places for a label, in all directions and at growing distances from its anchor, all within the picture."""
    half = label.size / 2 + _PADDING_PT
    found = []
    for distance in _DISTANCES_PT:
        for angle in _ANGLES:
            way = np.array([math.cos(angle), math.sin(angle)])
            # The box is wholly beyond the distance, whichever side it is on.
            middle = label.anchor + way * (distance + np.abs(way) @ half)
            found.append(PlacedLabel(label, np.clip(middle, half, size - half)))
    return found


def _best(
    options: list[PlacedLabel], others: list[PlacedLabel], anchors: list[Array], taken: Mask, area: Array, size: Array
) -> PlacedLabel:
    """The cheapest option; those that are too far or too much on the arm already are not scored further.

    Args:
        others: labels that have their place; ``anchors`` (2,) of all others [pt].
        taken: (H, W) where the picture shows what must be seen; ``area`` its cumulative sums.
    """
    first = [_distance(option) + _ON_ARM * _covered(option.box, area, size) for option in options]
    best, least = options[0], math.inf
    for k in np.argsort(first, kind="stable").tolist():
        if first[k] >= least:
            break
        cost = first[k] + _cost(options[k], others, anchors, taken, size)
        if cost < least:
            best, least = options[k], cost
    return best


def _distance(option: PlacedLabel) -> float:
    """Length of the leader line [pt]."""
    return float(np.linalg.norm(option.end - option.label.anchor))


def _cost(option: PlacedLabel, others: list[PlacedLabel], anchors: list[Array], taken: Mask, size: Array) -> float:
    """The cost of an option without its distance and what it covers of the arm [pt].

    Overlap with labels and anchors weighs most, then crossings of leader lines, then their length over the arm.
    """
    cost = sum(_ON_LABEL * overlap(option.box, other.box, _PADDING_PT) for other in others)
    cost += sum(_ON_LABEL * _inside(anchor, option.box) for anchor in anchors)
    lines = [(other.label.anchor, other.end) for other in others]
    line = (option.label.anchor, option.end)
    cost += sum(_CROSSING * _cross(line, other) for other in lines)
    cost += sum(_CROSSING * _meets(line, other.box) for other in others)
    cost += sum(_CROSSING * _meets(other, option.box) for other in lines)
    return cost + _OVER_ARM * _length_over(line, taken, size)


def overlap(a: tuple[float, ...], b: tuple[float, ...], pad: float = 0.0) -> float:
    """The share of the smaller of two boxes (left, low, right, high) that is in the other, each ``pad`` wider.

    >>> overlap((0.0, 0.0, 2.0, 2.0), (1.0, 1.0, 3.0, 3.0))
    0.25
    """
    wide = min(a[2], b[2]) - max(a[0], b[0]) + 2 * pad
    high = min(a[3], b[3]) - max(a[1], b[1]) + 2 * pad
    smaller = min((box[2] - box[0]) * (box[3] - box[1]) for box in (a, b))
    return max(wide, 0.0) * max(high, 0.0) / smaller


def _inside(point: Array, box: tuple[float, ...]) -> bool:
    """Whether a point (2,) is in a box, or nearly so [pt]."""
    return bool(
        box[0] - _PADDING_PT < point[0] < box[2] + _PADDING_PT
        and box[1] - _PADDING_PT < point[1] < box[3] + _PADDING_PT
    )


def _covered(box: tuple[float, ...], area: Array, size: Array) -> float:
    """The share of a box in which something is taken, by sums over the picture."""
    height, width = area.shape[0] - 1, area.shape[1] - 1
    c0, c1 = (int(np.clip(v / size[0] * width, 0, width)) for v in (box[0], box[2]))
    r0, r1 = (int(np.clip(v / size[1] * height, 0, height)) for v in (box[1], box[3]))
    total = area[r1, c1] - area[r0, c1] - area[r1, c0] + area[r0, c0]
    return float(total / max((r1 - r0) * (c1 - c0), 1))


def _length_over(line: tuple[Array, Array], taken: Mask, size: Array) -> float:
    """The length [pt] of a line over what is taken."""
    height, width = taken.shape
    points = line[0] + np.linspace(0, 1, 20)[:, None] * (line[1] - line[0])
    column, row = np.clip((points / size * [width, height]).astype(int), 0, [width - 1, height - 1]).T
    return float(np.mean(taken[row, column]) * np.linalg.norm(line[1] - line[0]))


def _cross(a: tuple[Array, Array], b: tuple[Array, Array]) -> bool:
    """Whether two segments cross: the ends of each are on different sides of the other."""
    return bool(turn_of(*a, b[0]) * turn_of(*a, b[1]) < 0 and turn_of(*b, a[0]) * turn_of(*b, a[1]) < 0)


def _meets(line: tuple[Array, Array], box: tuple[float, ...]) -> bool:
    """Whether a leader line passes through the box of another label."""
    points: Any = line[0] + np.linspace(0, 1, 30)[:, None] * (line[1] - line[0])
    inside = (points > [box[0], box[1]]) & (points < [box[2], box[3]])
    return bool(np.any(np.all(inside, axis=1)))
