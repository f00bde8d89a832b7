"""Whether two answers are related as their problems are."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import numpy as np

from tests.fuzz.case import Case
from tests.fuzz.run import Run

_POSITION = 1e-9  # of the reach, which is some metres
_VARIANCE = 1e-3  # of the largest: moments are integrated with that accuracy, and other nodes may be chosen
_SIGMA = 1e-3  # of a solve


def unrelated(case: Case, first: Run, second: Run) -> Iterator[str]:
    """What differs though it should not."""
    if first.code != second.code:
        yield f"pair: exit {first.code} and {second.code}: {(second.err or first.err).strip()[:150]}"
        return
    if first.code:
        return
    one, two = json.loads(first.out), json.loads(second.out)
    k, R, t = case.similarity.scale, np.array(case.similarity.turn), np.array(case.similarity.shift)
    if "status" in one:
        a, b = k * one["critical"]["sigma_max"], two["critical"]["sigma_max"]
        if abs(a - b) > _SIGMA * a:
            yield f"pair: sigma {a:.6g} and {b:.6g}"
        return
    p, q = k * R @ np.array(one["tool"]["position"]) + t, np.array(two["tool"]["position"])
    if np.abs(p - q).max() > _POSITION * max(k, 1.0) * 10:
        yield f"pair: positions {p} and {q}"
    yield from _covariances(one, two, k * R)


def _covariances(one: dict[str, Any], two: dict[str, Any], T: np.ndarray) -> Iterator[str]:
    for name in ("covariance", "covariance_first_order"):
        C, D = T @ np.array(one[name]) @ T.T, np.array(two[name])
        if np.abs(C - D).max() > _VARIANCE * np.abs(C).max() + 1e-24:
            yield f"pair: {name} {np.abs(C - D).max() / np.abs(C).max():.2g} apart"
