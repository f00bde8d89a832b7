"""Two documents compared: decisions, names and counts exactly, every number at the precision that it has.

What a number is follows from its key and from what is beside it, and its precision from what it is:

===========  =============================================  ==========================================================
kind         keys                                           precision, and the reason
===========  =============================================  ==========================================================
resampled    ``…interval95``, ``expected95``, ``factor``,   2 % of the larger end: 400 to 2 000 draws give an end no
             ``factor_interval95``                          better, and a draw at the border changes sides by rounding
fitted       ``estimate`` beside ``std``; ``mean``,         1e-6 of that standard error: with small residuals the last
             ``change``, ``difference`` beside              step, which ends below the tolerance of 1e-3 of it,
             ``std_error``; ``bias`` beside ``rms``; ``z``  ends far below, and rounding moves it by 1e-8
effect       ``value`` beside ``std``, and what follows it  1e-4 of the standard error: effects with shapes converge
                                                            linearly, to an offset of 1e-6 of k parameters together
                                                            (√k times that), of which some are correlated by 0.99
optimum      ``sigma_max``, ``radius95``, … of a solution   1e-6 relative: an optimum is flat to first order, so that
                                                            the solver's stationarity of 1e-6 leaves far less
posture      joints, quaternions, covariances, shares, …    1e-3 rad, m or of the largest entry, the square root of
                                                            the above: where the optimum is flat, the joints are no
                                                            better determined, nor what follows them to first order
placement    all of a solution with ``placements``          5e-4: the search ends where batches agree to 1e-3 of the
                                                            variance
probability  ``success_…``                                  1e-5 relative: ten times the spread's, as in a tail a
                                                            share of 2e-4 changes 14 times as much as its spread
miss         ``miss`` of a posture                          1e-8 m: the rows of a target are met to 1e-9
p-value      ``p_value``                                    1e-5 of its logarithm, which is what a statistic moves
other        residuals, singular values, …                  1e-6 of the number, or of the largest in its list
===========  =============================================  ==========================================================

Two optima that are as good (mirrored elbows, a turned tray) are one answer: rounding decides which of them is first.
So lists that are ranked by a number are compared without their order, and where the choice is another one of equal
value, what belongs to the choice is not compared, but its value and the list of alternatives are.

Compared on processors with and without AVX, AVX2, AVX-512 and fused products: nearly all numbers agree to 1e-8.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

RESAMPLED = 2e-2
FITTED = 1e-6
EFFECT = 1e-4
OPTIMUM = 1e-6
FIRST_ORDER = 1e-3
PLACEMENT = 5e-4
PROBABILITY = 1e-5
MISS_M = 1e-8
LOG_P_VALUE = 1e-5
OTHER = 1e-6

WORDS = frozenset({"notes", "words", "undetermined", "reason", "mend", "hint", "label", "text"})
"""Keys whose text is for people: how a thing is said may change, what is found may not."""

RESAMPLED_KEYS = frozenset({"expected95", "factor"})
STANDARD_ERRORS = {
    "estimate": "std", "value": "std", "mean": "std_error", "change": "std_error", "difference": "std_error",
    "bias": "rms",
}  # fmt: skip
"""The key beside a fitted number that says how well the data determine it."""
EFFECT_KEYS = frozenset({"alone", "beyond_geometry", "angle"})
"""What follows the estimate of an effect."""
CHOICE_KEYS = frozenset({
    "posture", "tool", "quaternion_wxyz", "workpiece", "covariance", "covariance_first_order", "basis", "bias",
    "budget", "budget_groups", "validity", "clearance", "orientation", "most_manipulable", "shift", "travel", "peg",
    "joint_travel", "as_listed", "largest_joint_step", "largest_step", "smallest_step", "step", "share",
    "times", "speed", "highest_speed",
})  # fmt: skip
"""What follows the joints of a solution to first order."""
EFFORT_KEYS = frozenset({"starts", "feasible", "tried", "polished", "converged", "distinct", "hits", "batches",
                         "recurred", "solves"})  # fmt: skip
"""How long a search took and how many ways led to the answer: of an arm with freedom left, rounding decides where the
last of hundreds of local searches ends. Not compared, unless all numbers are.
"""
RANKED_KEYS = frozenset({"alternatives", "budget", "budget_groups", "candidates", "effects", "what_would_help",
                         "others", "confounded_with"})  # fmt: skip
SOLUTION_KEYS = frozenset({"solver", "targets", "travel"})
"""Each belongs to documents of solutions, maps and plans; in others, a posture is under ``posture``."""

_HALF_TURN = 1e-6  # of w: such a quaternion has no sign of its own
_ZERO = 1e-12  # rad, m, or a probability: what is meant to be zero and is not
_ZERO_OF_LIST = 1e-18  # m²: the same for the entries of a list, which has its own scale
_STORED = 1e-11  # relative: the documents are written with twelve digits


def differences(old: Any, new: Any, rtol: float | None = None) -> Iterator[str]:
    """A line for every value of ``old`` that ``new`` does not have; what is only in ``new`` is no difference.

    With ``rtol`` every number is compared to that share of itself, or of the largest in its list: for a change of
    code that changes no number, on the machine on which the document was written.
    """
    if rtol is None and isinstance(old, dict) and isinstance(new, dict) and _chosen_otherwise(old, new):
        old, new = _value_of_choice(old), _value_of_choice(new)
    at_posture = isinstance(old, dict) and not SOLUTION_KEYS.isdisjoint(old)
    placed = isinstance(old, dict) and "placements" in old
    yield from _Comparison(rtol, at_posture, placed).differences(old, new, "", "")


@dataclass(frozen=True)
class _Comparison:
    """What is known of the place in a document.

    Args:
        rtol: for every number, instead of what it is.
        at_posture: whether values belong to an optimised posture.
        placed: whether a placement was searched for.
        first_order: whether they follow the joints to first order.
    """

    rtol: float | None
    at_posture: bool
    placed: bool
    first_order: bool = False

    def differences(self, old: Any, new: Any, place: str, key: str, beside: Mapping[str, Any] = {}) -> Iterator[str]:
        if isinstance(old, dict) and isinstance(new, dict):
            yield from self._of_objects(old, new, place)
        elif isinstance(old, list) and isinstance(new, list):
            yield from self._of_lists(old, new, place, key, beside)
        elif is_number(old) and is_number(new) and (isinstance(old, float) or isinstance(new, float)):
            if not self._equal(float(old), float(new), key, beside):
                yield f"{place}: {old!r}, now {new!r}"
        elif old != new or isinstance(old, bool) != isinstance(new, bool):
            yield f"{place}: {old!r}, now {new!r}"

    def _of_objects(self, old: dict[str, Any], new: dict[str, Any], place: str) -> Iterator[str]:
        for key, value in old.items():
            if key in WORDS or (self.rtol is None and key in EFFORT_KEYS):
                continue
            if key not in new:
                yield f"{place}.{key}: gone"
            else:
                at_posture = self.at_posture or key == "posture"
                first_order = self.first_order or (at_posture and key in CHOICE_KEYS and not _is_block(key, value))
                below = _Comparison(self.rtol, at_posture, self.placed, first_order)
                yield from below.differences(value, new[key], f"{place}.{key}", key, old)

    def _of_lists(
        self, old: list[Any], new: list[Any], place: str, key: str, beside: Mapping[str, Any]
    ) -> Iterator[str]:
        if len(old) != len(new):
            yield f"{place}: {len(old)} entries, now {len(new)}"
        elif are_numbers(old) and are_numbers(new):
            if key == "quaternion_wxyz" and abs(old[0]) < _HALF_TURN:
                new = [-v for v in new] if sum(a * b for a, b in zip(old, new, strict=True)) < 0 else new
            before, after = flat(old), flat(new)
            if len(before) != len(after):
                yield f"{place}: {len(before)} numbers, now {len(after)}"
                return
            allowed = self._allowed_of_list(before, key, beside)
            for i, (a, b) in enumerate(zip(before, after, strict=True)):
                if not agree(a, b, allowed + _STORED * abs(a)):
                    yield f"{place}[{i}]: {a!r}, now {b!r}"
        elif self.rtol is None and key in RANKED_KEYS:
            yield from self._without_order(old, new, place, key)
        else:
            for i, (a, b) in enumerate(zip(old, new, strict=True)):
                yield from self.differences(a, b, f"{place}[{i}]", key)

    def _without_order(self, old: list[Any], new: list[Any], place: str, key: str) -> Iterator[str]:
        left = list(range(len(new)))
        for i, value in enumerate(old):
            lines = {j: list(self.differences(value, new[j], f"{place}[{i}]", key)) for j in left}
            same = next((j for j in left if not lines[j]), None)
            if same is not None:
                left.remove(same)
            else:
                yield from min(lines.values(), key=len)

    def _equal(self, old: float, new: float, key: str, beside: Mapping[str, Any]) -> bool:
        if key == "p_value":
            # A statistic moves the logarithm: of a p-value of 1e-200 rounding changes some digits.
            old, new = (math.log(max(p, 1e-300)) for p in (old, new))
            return agree(old, new, (self.rtol or LOG_P_VALUE) * max(abs(old), 1.0))
        if key == "z" and self.rtol is None:  # in standard errors
            return agree(old, new, FITTED + OTHER * abs(old))
        error = beside.get(STANDARD_ERRORS.get(key, ""))
        if self.rtol is None and is_number(error) and math.isfinite(error):
            allowed = EFFECT if key == "value" else FITTED
            return agree(old, new, allowed * abs(error) + _STORED * abs(old) + _ZERO_OF_LIST)
        scale = max(abs(old), 1.0) if self.first_order and self.rtol is None else abs(old)
        return agree(old, new, self._relative(key) * scale + _STORED * abs(old) + _ZERO)

    def _allowed_of_list(self, old: list[float], key: str, beside: Mapping[str, Any]) -> float:
        errors = beside.get(STANDARD_ERRORS.get(key, ""))
        if self.rtol is None and isinstance(errors, list) and errors and are_numbers(errors):
            return FITTED * max(flat(errors)) + _ZERO_OF_LIST
        largest = max((abs(v) for v in old if math.isfinite(v)), default=0.0)
        return self._relative(key) * largest + (MISS_M if key == "miss" and self.rtol is None else _ZERO_OF_LIST)

    def _relative(self, key: str) -> float:
        if self.rtol is not None:
            return self.rtol
        if key.endswith("interval95") or key in RESAMPLED_KEYS:
            return RESAMPLED
        if self.first_order:
            return FIRST_ORDER
        if key in EFFECT_KEYS:
            return EFFECT
        if key.startswith("success_") and not self.placed:
            return PROBABILITY
        if self.placed:
            return PLACEMENT
        return OPTIMUM if self.at_posture else OTHER


def _is_block(key: str, value: Any) -> bool:
    """Whether it holds several answers (``posture`` of a calibration) or the pose of one, whose position is asked."""
    return isinstance(value, dict) and (key == "tool" or any(isinstance(inner, dict) for inner in value.values()))


def _chosen_otherwise(old: dict[str, Any], new: dict[str, Any]) -> bool:
    """Whether a solution is another optimum that is as good: one of the alternatives, or another placement."""
    if not isinstance(old.get("posture"), dict) or not isinstance(new.get("posture"), dict) or "solver" not in old:
        return False
    if "placements" in old and isinstance(new.get("workpiece"), dict):
        return not _same_joints(old["workpiece"], new["workpiece"])
    if _same_joints(old["posture"], new["posture"]):
        return False
    value = old["critical"]["sigma_max"]
    return any(
        _same_joints(other["posture"], new["posture"]) and agree(value, other["sigma_max"], OPTIMUM * value)
        for other in old.get("alternatives", [])
    )


def _same_joints(one: dict[str, float], other: dict[str, float]) -> bool:
    return one.keys() == other.keys() and all(agree(one[k], other[k], FIRST_ORDER) for k in one)


def _value_of_choice(document: dict[str, Any]) -> dict[str, Any]:
    """What optima that are as good have in common."""
    kept = {key: document.get(key) for key in ("name", "task", "status", "method", "combine", "reasons")}
    if "placements" not in document:
        value, alternatives = document["critical"]["sigma_max"], document.get("alternatives", [])
        return kept | {"solver": document["solver"], "sigma_max": value, "alternatives": alternatives}
    features = document["features"]
    values = [feature["critical"]["sigma_max"] for feature in features]
    value = max(values) if document.get("combine") == "worst" else math.sqrt(sum(v * v for v in values) / len(values))
    kept["features"] = [{"name": feature["name"], "status": feature["status"]} for feature in features]
    return kept | {"placements": None, "sigma_max": value}


def agree(a: float, b: float, allowed: float) -> bool:
    """Whether two numbers differ by no more than is allowed, or are the same infinity or both not a number."""
    return a == b or (math.isnan(a) and math.isnan(b)) or abs(a - b) <= allowed


def is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def are_numbers(values: list[Any]) -> bool:
    """Whether a list, of lists perhaps, holds numbers alone."""
    return bool(values) and all(are_numbers(v) if isinstance(v, list) else is_number(v) for v in values)


def flat(values: list[Any]) -> list[float]:
    """The numbers of nested lists in one."""
    return [x for v in values for x in (flat(v) if isinstance(v, list) else [float(v)])]
